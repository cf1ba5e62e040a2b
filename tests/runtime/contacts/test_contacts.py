"""Contacts in statics: forces are gradients of the energy, and stiffness their derivative."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.statics.equilibrium import build_problem, equilibrium_quantities
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tests.ground_cases import make_prism
from tests.models import load

STEP = 1e-7


@pytest.fixture(scope="module")
def problem() -> StaticProblem:
    """A prism whose lower feet are pressed 0.1 mm into the ground and moved along it."""
    prism = make_prism(exponent=1.5, friction=0.4)
    elastic = prism.with_changes(spring_constant=np.where(prism.is_rigid, 1e4, prism.spring_constant))
    low = elastic.with_changes(node_position=elastic.node_position - [0.0, 0.0, 0.5])
    return build_problem(load(low, *equilibrium_quantities("node_position")))


@pytest.mark.parametrize("limited", [False, True])
def test_the_stiffness_is_the_derivative_of_the_forces(problem: StaticProblem, limited: bool) -> None:
    contacts = problem.contacts
    assert contacts is not None
    start = problem.model.nominal("coordinate").ravel()
    rng = np.random.default_rng(5)
    contacts.begin(problem.node_position(start) + np.array([0.0, 0.0, 1e-5 * limited]))
    contacts.limited = contacts.exact = limited
    here = start + 1e-5 * rng.normal(size=len(start)) - 1e-4 * contacts.ground.normal[problem.axis]
    way = rng.normal(size=len(start))
    slips = contacts.bristles(problem.node_position(here))[1]
    assert slips.any() == limited
    ahead, behind = (problem.residual(here + sign * STEP * way) for sign in (1, -1))
    change = (ahead - behind) / (2 * STEP)
    stiffness = problem.stiffness(here)
    np.testing.assert_allclose(-stiffness @ way, change, atol=1e-5 * np.abs(change).max())
    if not limited:
        energy = [problem.find_point(here + sign * STEP * way) for sign in (1, -1)]
        slope = (energy[0].energy - energy[1].energy) / (2 * STEP)  # type: ignore[union-attr]
        assert -problem.residual(here) @ way == pytest.approx(slope, rel=1e-6)


def test_friction_never_exceeds_its_limit(problem: StaticProblem) -> None:
    contacts = problem.contacts
    assert contacts is not None
    start = problem.node_position(problem.model.nominal("coordinate").ravel())
    contacts.begin(start)
    contacts.limited = True
    for size in (1e-6, 1e-4, 1e-2):
        force = contacts.forces(start + np.array([size, 2 * size, -1e-4]))
        along = np.linalg.norm(force[:, :2], axis=1)
        assert np.all(along <= 0.4 * force[:, 2] * (1 + 1e-12))
