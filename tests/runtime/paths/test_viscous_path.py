"""Equilibria and load paths of viscous members: those of softer springs, with the states that hold them."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.contacts.rest_memory import RELAXED_QUANTITIES, REST_QUANTITIES
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.continuation import follow_path
from tensegrity_codegen.runtime.paths.model_path import build_path
from tensegrity_codegen.runtime.paths.watches import watch_slack, watch_yield
from tensegrity_codegen.runtime.sensitivity.sensitivity import equilibrium_sensitivity
from tensegrity_codegen.runtime.sensitivity.static_system import REST_LENGTH_QUANTITIES
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tests.ground_cases import make_block
from tests.models import load, simulator
from tests.plastic_cases import with_plastic
from tests.runtime.build import cable, make_structure
from tests.viscous_cases import make_net, with_viscous


def load_statics(structure: Structure, *more: str, **request: Any) -> CompiledModel:
    return load(structure, *EQUILIBRIUM_QUANTITIES, *RELAXED_QUANTITIES, *more, **request)


def soften(structure: Structure) -> Structure:
    """Return the structure with elastic springs h mu in place of viscous members."""
    share = structure.member_value("relaxed_fraction")
    stiffness = structure.spring_constant * np.where(share > 0, share, 1.0)
    return structure.with_changes(law_parameter={}, spring_constant=stiffness)


def test_equilibria_and_sensitivities_are_those_of_relaxed_springs() -> None:
    net = make_net()
    models = [load_statics(net, *REST_LENGTH_QUANTITIES)]
    models.append(load(soften(net), *EQUILIBRIUM_QUANTITIES, *REST_LENGTH_QUANTITIES))
    found, soft = (find_equilibrium(model) for model in models)
    assert found.coordinate == pytest.approx(soft.coordinate, abs=1e-12)
    assert found.member_tension == pytest.approx(soft.member_tension, abs=1e-9)
    assert found.energy == pytest.approx(soft.energy, rel=1e-12)
    assert found.smallest_eigenvalue == pytest.approx(soft.smallest_eigenvalue, rel=1e-9)
    by_rest, by_soft = (
        equilibrium_sensitivity(model, at).node for model, at in zip(models, (found, soft), strict=True)
    )
    assert by_rest == pytest.approx(by_soft, abs=1e-10)


def test_a_motion_begins_at_an_equilibrium_with_its_states() -> None:
    """Both ways: a motion from an equilibrium rests, and one with damping comes to it."""
    net = make_net().with_changes(node_velocity=np.zeros((5, 3)))
    found = find_equilibrium(load_statics(net))
    start = {"coordinate": found.coordinate, "arguments": found.internal_argument}
    rest = simulate(simulator(net, "rk853"), 0.5, samples=3, method="rk853", rtol=1e-10, **start)  # type: ignore[arg-type]
    assert np.abs(rest.coordinate - found.coordinate).max() < 1e-10
    damped = net.with_changes(damping=np.full(6, 60.0))
    slow = simulate(simulator(damped, "rk853"), 60.0, samples=3, method="rk853", rtol=1e-10)
    assert slow.coordinate[-1] == pytest.approx(found.coordinate, abs=1e-8)
    assert found.internal is not None
    assert slow.internal is not None
    assert slow.internal[-1, :5] == pytest.approx(found.internal[:5], abs=1e-8)


def test_a_load_path_there_and_back_forgets_its_way() -> None:
    """Two cables pull a node apart; one goes slack at its rest length, on the way there and back."""
    place = [[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]]
    cables = [cable(0, 1, 0.99, 1e4), cable(1, 2, 0.99, 1e4)]
    pair = make_structure(place, cables, anchored={0: "xyz", 1: "yz", 2: "xyz"})
    viscous = with_viscous(pair, [0.5, 2.0], [0.2, 0.4])
    model = load_statics(viscous, "member_extension", parameters={"node_load": (0, 1, 2)})
    path = build_path(model, np.array([[0.0] * 3, [1.0, 0, 0], [0.0] * 3]))
    watches = [watch_slack(path, ["e0", "e1"])]
    there = follow_path(path, model.nominal("coordinate").ravel(), most=80.0, watches=watches)
    assert there.status == "completed"
    # h mu x of each: 2000 (0.01 + x) - 4000 (0.01 - x) = F while both pull
    assert there.find_events("slack")[0].load_factor == pytest.approx(2000 * 0.02, rel=1e-9)
    assert there.coordinate[-1] == pytest.approx([80.0 / 2000 - 0.01], abs=1e-12)
    assert there.internal is not None
    assert there.internal[-1] == pytest.approx([0.8 * 80.0 / 2000, 0.0, 0.0], abs=1e-12)
    back = follow_path(path, there.coordinate[-1], least=80.0, most=0.0, watches=watches)
    assert back.coordinate[-1] == pytest.approx([20.0 / 6000], abs=1e-12)


def test_viscous_and_plastic_members_share_a_load_path() -> None:
    """A plastic cable of 1e4 N/m that yields at 50 N, h = 0.1, beside a viscous one of 0.4 times 1e4 N/m."""
    place = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]
    members = [cable(0, 1, 1.0, 1e4), cable(0, 1, 1.0, 1e4)]
    both = make_structure(place, members, anchored={0: "xyz", 1: "yz", 2: "xyz"})
    both = with_viscous(with_plastic(both, [50.0, 0.0]), [0.0, 1.0], 0.4)
    model = load_statics(both, *REST_QUANTITIES, "member_extension", parameters={"node_load": (0, 1, 2)})
    path = build_path(model, np.array([[0.0] * 3, [1.0, 0, 0], [0.0] * 3]))
    found = follow_path(path, model.nominal("coordinate").ravel(), most=145.0, watches=watch_yield(path))
    assert [event.load_factor for event in found.events] == pytest.approx([50.0 + 20.0], rel=1e-9)
    assert found.coordinate[-1, 0] - 1.0 == pytest.approx(0.005 + 75.0 / 5000.0, abs=1e-12)
    assert found.internal is not None
    names = model.manifest.internal_name
    assert found.internal[-1, names.index("e0_plastic")] == pytest.approx(0.9 * 0.015, abs=1e-12)
    assert found.internal[-1, names.index("e1_viscous")] == pytest.approx(0.6 * 0.02, abs=1e-12)


def test_equilibria_of_viscous_members_on_the_ground_are_refused() -> None:
    model = load_statics(with_viscous(make_block([0.0, 0.0, -1e-4]), 1.0, 0.5))
    with pytest.raises(FormulationError, match="members with memory"):
        find_equilibrium(model)
