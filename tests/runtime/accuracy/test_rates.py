"""Bounds on frequencies and decay rates: above the eigenvalues, and not far above."""

import functools
from collections.abc import Callable

import numpy as np
import pytest
from scipy import linalg

from tensegrity_codegen.runtime.accuracy.rates import find_fastest, find_fastest_of_batch, find_rates
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tests.models import load
from tests.runtime.build import cable, make_structure
from tests.runtime.stiff_bars import class_two, pendulums, prism_of_ratio

WANTED = ("member_law", "mass_matrix", "tangent_stiffness", "damping_matrix")


@functools.cache
def model_of(make: Callable[[float], Structure]) -> CompiledModel:
    structure = make(1e3)
    wanted = WANTED if structure.damping.any() else WANTED[:3]
    return load(structure, *wanted)


def stiff(structure: Structure) -> tuple[int, ...]:
    return tuple(np.flatnonzero(~structure.tension_only).tolist())


@pytest.mark.parametrize("make", [prism_of_ratio, class_two, pendulums])
def test_no_eigenvalue_is_above_the_bounds_and_the_largest_is_near(
    make: Callable[[float], Structure],
) -> None:
    model, structure = model_of(make), make(1e3)
    rates = find_rates(model, stiff(structure), {})
    assert rates is not None
    mass = model.compute("mass_matrix").toarray()
    squares = linalg.eigvalsh(model.compute("tangent_stiffness").toarray(), mass)
    assert np.sqrt(squares[-1]) <= rates.frequency <= 2.5 * np.sqrt(squares[-1])
    assert 0.0 < rates.slow_frequency < 0.2 * rates.frequency
    if structure.damping.any():
        damping = linalg.eigvalsh(model.compute("damping_matrix").toarray(), mass)
        assert damping[-1] <= rates.decay <= 3.0 * damping[-1]
        assert rates.slow_decay < 0.1 * rates.decay
    else:
        assert (rates.decay, rates.slow_decay) == (0.0, 0.0)


def test_ratio_and_meeting_members_are_told() -> None:
    prism = find_rates(model_of(prism_of_ratio), (0, 4, 8), {})
    chain = find_rates(model_of(class_two), (0, 1, 2, 3), {})
    assert prism is not None
    assert chain is not None
    assert (prism.stiffness_ratio, prism.meeting) == (pytest.approx(1e3), 1)
    assert (chain.stiffness_ratio, chain.meeting) == (pytest.approx(1e5 / 60.0), 2)


def test_a_library_without_laws_has_no_rates() -> None:
    assert find_rates(load(prism_of_ratio(1e3), "member_tension"), (), {}) is None


def test_a_force_that_jumps_at_the_start_is_no_stiffness() -> None:
    """A damped cable at its rest length: slack on one side, 3000 N/m and 1.5 N on the other."""
    place = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    one = make_structure(place, [cable(0, 1, 1.0, 3000.0, damping=0.5)], anchored={0: "xyz", 1: "yz"})
    model = load(one, "acceleration", batch_width=8)
    state = np.array([1.0, 3.0])
    motion = Motion(model, state, np.array([0.0, 1.0]))
    assert find_fastest(motion) == pytest.approx(np.sqrt(3000.0 / 2.0), rel=1e-4)
    both = Motion(model, np.array([state, [1.1, 3.0]]), np.array([0.0, 1.0]))
    assert find_fastest_of_batch(both) == pytest.approx(np.sqrt([1500.0, 3000.0]), rel=1e-4)
