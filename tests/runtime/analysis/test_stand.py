"""Standing of models, and the cables that tip them."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.analysis.stand import find_tips, stand
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import equilibrium_quantities, find_equilibrium
from tensegrity_codegen.system.errors import FormulationError, UnknownNameError
from tests.ground_cases import make_ground, make_icosahedron
from tests.models import load


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    """An icosahedron on a facet whose feet are the nodes 0, 4 and 8."""
    ico = make_icosahedron()
    cables = tuple(np.flatnonzero(~ico.is_bar).tolist())
    names = equilibrium_quantities("rigid_bar")
    return load(ico, *names, formulation="rigid_bar", parameters={"rest_length": cables})


def test_an_equilibrium_stands_with_its_forces(model: CompiledModel) -> None:
    found = stand(model, find_equilibrium(model))
    assert (found.verdict, found.distribution) == ("stands", "equilibrium")
    assert found.foot == ("n0", "n4", "n8")
    side = np.linalg.norm(found.place[0] - found.place[1])
    assert found.tipping_margin == pytest.approx(side / np.sqrt(12), rel=1e-10)  # radius of the inner circle
    assert stand(model).verdict == "stands"  # as drawn


def test_loads_count(model: CompiledModel) -> None:
    assert stand(model).is_standing
    ico = make_icosahedron()
    high = int(ico.node_position[:, 2].argmax())
    force = np.zeros((12, 3))
    force[high] = [4.0, 0.0, 0.0]
    other = load(ico.with_changes(node_load=force), "member_tension", formulation="rigid_bar")
    assert stand(other).verdict == "tips"


@pytest.mark.parametrize(("friction", "verdict"), [(0.05, "slides"), (0.23, "slides"), (0.24, "stands")])
def test_the_friction_among_the_arguments_counts(friction: float, verdict: str) -> None:
    # The feet are pushed by 0.2335 of the weight; the scene itself has the friction that it is built with.
    ico = make_icosahedron()
    force = np.zeros((12, 3))
    weight = float((ico.node_mass.sum() + ico.member_mass.sum()) * -ico.gravity[2])
    force[[0, 4, 8], 0] = 0.2335 * weight / 3
    rough = ico.with_changes(node_load=force, ground=make_ground(12, friction=0.4))
    pushed = load(rough, "contact_force", formulation="rigid_bar", parameters={"ground": (2,)})
    found = stand(pushed, arguments={"ground": [friction]})
    assert (found.friction, found.verdict) == (friction, verdict)
    assert found.friction_needed == pytest.approx(0.2335, rel=1e-6)


def test_a_cable_of_the_facet_tips_it_at_a_known_length(model: CompiledModel) -> None:
    """Known from a prototype to 12 digits; then the third foot carries nothing."""
    structure = make_icosahedron()
    side = [
        name
        for name, ends in zip(structure.member_name, structure.connectivity.tolist(), strict=True)
        if set(ends) <= {0, 4, 8}
    ]
    (tip,) = find_tips(model, side[:1])
    assert tip.status == "tips"
    assert tip.rest_length == pytest.approx(0.122612517578, abs=1e-12)
    np.testing.assert_allclose(np.sort(tip.force[:, 2]), [0.0, 2.120638, 3.765362], atol=5e-7)
    lifted = tip.foot[int(tip.force[:, 2].argmin())]
    assert set(tip.edge) == set(tip.foot) - {lifted}


@pytest.mark.thorough
def test_feet_slip_while_a_cable_is_shortened() -> None:
    """With friction it tips later than without; all feet slip on the way, and |F| = mu N holds."""
    ico = make_icosahedron()
    rough = {"friction": 0.1, "stick_stiffness": 2e4, "stick_damping": 20.0}
    structure = ico.with_changes(ground=make_ground(12, stiffness=2e4, **rough))
    row = [k for k, ends in enumerate(ico.connectivity.tolist()) if set(ends) <= {0, 4, 8}][:1]
    names = equilibrium_quantities("rigid_bar")
    model = load(structure, *names, formulation="rigid_bar", parameters={"rest_length": tuple(row)})
    (tip,) = find_tips(model)
    assert tip.status == "tips"
    assert 0.1215 < tip.rest_length < 0.122612517578
    friction = np.linalg.norm(tip.force[:, :2], axis=1)
    assert np.all(friction <= 0.1 * tip.force[:, 2] + 1e-6)
    assert np.linalg.norm(tip.force.sum(axis=0) - [0.0, 0.0, 12 * 0.05 * 9.81]) < 1e-6


def test_wrong_models_and_names_are_refused(model: CompiledModel) -> None:
    with pytest.raises(UnknownNameError, match="cable"):
        find_tips(model, ["none"])
    without = load(make_icosahedron().with_changes(ground=None), "member_tension", formulation="rigid_bar")
    with pytest.raises(FormulationError, match="nothing to stand on"):
        stand(without)
