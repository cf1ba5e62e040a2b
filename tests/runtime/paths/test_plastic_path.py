"""Load paths and equilibria of plastic members: loops, a limit point, members that turn back."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.contacts.rest_memory import REST_QUANTITIES
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import LoadPath
from tensegrity_codegen.runtime.paths.model_path import build_path
from tensegrity_codegen.runtime.paths.watches import watch_slack, watch_yield
from tensegrity_codegen.runtime.sensitivity.sensitivity import equilibrium_sensitivity
from tensegrity_codegen.runtime.sensitivity.static_system import REST_LENGTH_QUANTITIES
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.constrained_problems import BAR_EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tensegrity_codegen.tables.laws.plastic import Plastic
from tests.ground_cases import make_block
from tests.models import load, simulator
from tests.plastic_cases import make_mass, with_plastic
from tests.runtime.build import bar, cable, make_structure

LAW = Plastic()


def load_statics(structure: Structure, *more: str, **request: Any) -> CompiledModel:
    quantities = (*EQUILIBRIUM_QUANTITIES, *REST_QUANTITIES, "member_extension", *more)
    loaded = tuple(range(structure.n_nodes))
    return load(structure, *quantities, parameters={"node_load": loaded}, **request)


def follow(model: CompiledModel, force: Any, start: Any, least: float, most: float, **more: Any) -> LoadPath:
    internal = more.pop("internal", None)
    path = build_path(model, np.array(force), {} if internal is None else {"internal": internal})
    return follow_path(path, start, least=least, most=most, watches=watch_yield(path), **more)


@pytest.mark.parametrize(
    ("isotropic", "back", "yields"), [(0.0, -65.0, (50.0, -35.0, 35.0)), (1.0, -92.0, (50.0, -65.0))]
)
def test_a_path_there_and_back_remembers(isotropic: float, back: float, yields: tuple[float, ...]) -> None:
    """65 N at x = 0.02, back to -0.02, and 45 N at x = 0 where hardening is kinematic."""
    model = load_statics(make_mass(0.1, isotropic))
    force = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    start, internal, least, events = model.nominal("coordinate").ravel(), None, 0.0, []
    for most, x in ((65.0, 0.02), (back, -0.02), (45.0, 0.0))[: 3 if isotropic == 0.0 else 2]:
        path = follow(model, force, start, least, most, internal=internal)
        assert path.status == "completed"
        assert path.coordinate[-1, 0] - 1.0 == pytest.approx(x, abs=1e-13)
        assert path.internal is not None
        start, internal, least = path.coordinate[-1], path.internal[-1], most
        events += [event.load_factor for event in path.find_events("yield")]
    assert events == pytest.approx(yields, rel=1e-10)


@pytest.mark.parametrize("isotropic", [0.0, 0.5])
@pytest.mark.parametrize("largest", [0.1, 0.03])
def test_a_shallow_truss_snaps_through_with_members_that_yield_and_turn(
    isotropic: float, largest: float
) -> None:
    """F(w) = 2 t w / l by symmetry; bars are compressed until w = 0, where they turn, and yield again."""
    half, height, k = 1.0, 0.2, 1e4
    rest = float(np.hypot(half, height))
    truss = make_structure(
        [[-half, 0, 0], [0, 0, height], [half, 0, 0]],
        [bar(0, 1, rest, k), bar(1, 2, rest, k)],
        anchored={0: "xyz", 1: "xy", 2: "xyz"},
    )
    model = load_statics(with_plastic(truss, 100.0, 0.2, isotropic))
    force = [[0.0] * 3, [0.0, 0.0, -100.0], [0.0] * 3]
    start = model.nominal("coordinate").ravel()
    path = follow(model, force, start, 0.0, 3.0, floor=-100.0, control=StepControl(largest=largest))
    assert path.status == "completed"
    assert [event.kind for event in path.events] == ["yield", "limit", "limit", "yield"]
    values: dict[str, Any] = {
        "yield_elongation": 0.01,
        "hardening": 0.2,
        "isotropic": isotropic,
        "plastic": 0.0,
        "accumulated": 0.0,
    }
    before = height
    for w, factor in zip(path.coordinate[:, 0], path.load_factor, strict=True):
        for height_between in [0.0, w] if before > 0.0 > w else [w]:
            x = float(np.hypot(half, height_between)) - rest
            q, a = LAW.settle(x, values, np.where)
            values |= {"plastic": float(q), "accumulated": float(a)}
        tension = k * (float(np.hypot(half, w)) - rest - values["plastic"])
        assert -100.0 * factor == pytest.approx(2 * tension * w / float(np.hypot(half, w)), abs=1e-10)
        before = w
    assert path.internal is not None
    assert path.internal[-1, :2] == pytest.approx([values["plastic"], values["accumulated"]], abs=1e-12)


def test_springs_that_yield_one_after_the_other_share_a_load() -> None:
    """Slopes 2300, 1500, 1000 and 100 N/m between yields at x = 0.01, 0.02 and 0.03: 23, 38 and 48 N."""
    place = [[0, 0, 0], [-1, 0, 0], [2, 0, 0], [1, 0, 0]]
    springs = [bar(0, 3, 1.0, 1000.0), bar(1, 3, 2.0, 500.0), bar(2, 3, 1.0, 800.0)]
    held = {0: "xyz", 1: "xyz", 2: "xyz", 3: "yz"}
    line = with_plastic(
        make_structure(place, springs, anchored=held), [30.0, 10.0, 8.0], np.array([0.1, 0.0, 0.0])
    )
    model = load_statics(line)
    force = np.zeros((4, 3))
    force[3, 0] = 58.0
    path = follow(model, force, model.nominal("coordinate").ravel(), 0.0, 1.0)
    assert [event.names for event in path.events] == [("e2",), ("e1",), ("e0",)]
    loads = [58.0 * event.load_factor for event in path.events]
    assert loads == pytest.approx([23.0, 38.0, 48.0], rel=1e-9)
    assert path.coordinate[-1, 0] == pytest.approx(1.13, abs=1e-12)
    alone = find_equilibrium(model, arguments={"node_load": force})
    assert alone.coordinate == pytest.approx([1.13], abs=1e-10)
    assert alone.member_tension == pytest.approx([40.0, 10.0, -8.0], rel=1e-8)


def test_an_equilibrium_goes_on_from_its_internal_states() -> None:
    model = load_statics(make_mass())
    force = np.array([[0.0, 0.0, 0.0], [65.0, 0.0, 0.0]])
    found = find_equilibrium(model, arguments={"node_load": force})
    assert found.coordinate - 1.0 == pytest.approx([0.02], abs=1e-12)
    assert found.member_tension == pytest.approx([65.0], rel=1e-9)
    assert found.plastic_elongation == {"e0": pytest.approx(0.0135, abs=1e-12)}
    assert found.as_evidence()["plastic_elongation"] == found.plastic_elongation
    back = find_equilibrium(model, arguments={"node_load": 0.0 * force, **found.internal_argument})
    assert back.coordinate - 1.0 == pytest.approx([0.0135], abs=1e-12)
    tension = model.compute("member_tension", coordinate=back.coordinate, **back.internal_argument)
    assert tension == pytest.approx([0.0], abs=1e-8)


def test_a_yielded_cable_goes_slack_on_a_path_where_it_has_grown() -> None:
    """Two cables along x pull a node apart; after one has yielded it is slack at rest length + q."""
    place = [[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]]
    cables = [cable(0, 1, 0.999, 1e4), cable(1, 2, 0.999, 1e4)]
    pair = make_structure(place, cables, anchored={0: "xyz", 1: "yz", 2: "xyz"})
    model = load_statics(with_plastic(pair, [50.0, 0.0]))
    path = build_path(model, np.array([[0.0] * 3, [1.0, 0, 0], [0.0] * 3]))
    there = follow_path(
        path,
        model.nominal("coordinate").ravel(),
        most=80.0,
        watches=[*watch_yield(path), watch_slack(path, ["e0", "e1"])],
    )
    assert there.internal is not None
    q, x = float(there.internal[-1, 0]), float(there.coordinate[-1, 0])
    assert x + 0.001 - q == pytest.approx(80.0 / 1e4, rel=1e-9)
    rest = build_path(model, np.array([[0.0] * 3, [1.0, 0, 0], [0.0] * 3]), {"internal": there.internal[-1]})
    back = follow_path(
        rest,
        there.coordinate[-1],
        least=80.0,
        most=-30.0,
        watches=[*watch_yield(rest), watch_slack(rest, ["e0", "e1"])],
    )
    slack = {event.names: event.coordinate[0] for event in back.find_events("slack", "taut")}
    assert slack["e0",] == pytest.approx(q - 0.001, abs=1e-10)


def test_rigid_bars_carry_plastic_cables_along_a_path() -> None:
    """A rigid rod hung on two plastic cables: each takes half of the load."""
    rod = make_structure(
        [[0, 0, 0.0], [1, 0, 0.0], [0, 0, 1.0], [1, 0, 1.0]],
        [bar(0, 1, 1.0, 0.0), cable(0, 2, 1.0, 2000.0), cable(1, 3, 1.0, 2000.0)],
        anchored={0: "xy", 1: "y", 2: "xyz", 3: "xyz"},
    )
    structure = with_plastic(rod, [0.0, 12.0, 12.0], 0.1)
    quantities = (*BAR_EQUILIBRIUM_QUANTITIES, *REST_QUANTITIES, "member_extension")
    model = load(structure, *quantities, parameters={"node_load": (0, 1)}, formulation="rigid_bar")
    force = [[0.0, 0.0, -1.0], [0.0, 0.0, -1.0]]
    path = build_path(model, np.array(force), {"node_load": np.array([[0, 0, -1.0]] * 2)})
    begun = find_equilibrium(model, arguments={"node_load": np.array([[0, 0, -1.0]] * 2)})
    found = follow_path(path, begun.coordinate, most=15.0, watches=watch_yield(path))
    assert found.status == "completed"
    assert found.find_events("yield")[0].load_factor == pytest.approx(11.0, rel=1e-8)
    assert found.internal is not None
    assert found.internal[-1, :2] == pytest.approx([0.9 * 4.0 / 200.0] * 2, rel=1e-8)
    alone = find_equilibrium(model, arguments={"node_load": np.array([[0, 0, -16.0]] * 2)})
    assert alone.coordinate == pytest.approx(found.coordinate[-1], abs=1e-9)


def test_equilibria_of_plastic_members_on_the_ground_are_refused() -> None:
    block = with_plastic(make_block([0.0, 0.0, -1e-4]), 50.0)
    model = load(block, *EQUILIBRIUM_QUANTITIES, *REST_QUANTITIES)
    with pytest.raises(FormulationError, match="equilibria on the ground"):
        find_equilibrium(model)


def test_sensitivities_of_plastic_members_are_refused() -> None:
    model = load_statics(make_mass(), *REST_LENGTH_QUANTITIES)
    with pytest.raises(FormulationError, match="plastic members"):
        equilibrium_sensitivity(model, find_equilibrium(model))


def test_a_motion_begins_at_an_equilibrium_with_what_members_remember() -> None:
    mass = make_mass().with_changes(node_velocity=np.zeros((2, 3)))
    statics, motion = load_statics(mass), simulator(mass, "rk853", parameters={"node_load": (0, 1)})
    force = np.array([[0.0, 0.0, 0.0], [65.0, 0.0, 0.0]])
    found = find_equilibrium(statics, arguments={"node_load": force})
    rest = simulate(
        motion,
        0.05,
        samples=3,
        method="rk853",
        coordinate=found.coordinate,
        arguments={"node_load": force, **found.internal_argument},
    )
    assert np.abs(rest.coordinate - found.coordinate).max() < 1e-10


@pytest.mark.parametrize("internal", [[np.nan, 0.0, 0.0, 0.0], [0.0, 0.0]])
def test_internal_states_that_cannot_be_are_refused(internal: list[float]) -> None:
    model = load_statics(make_mass())
    with pytest.raises(InvalidValueError, match="internal"):
        find_equilibrium(model, arguments={"internal": internal})
