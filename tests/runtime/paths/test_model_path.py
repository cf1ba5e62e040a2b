"""Load paths of compiled scenes: slack against bisection, contact in closed form, energy, LIN's prism."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from tensegrity_codegen.pipeline.analyses import equilibrium_quantities
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import LoadPath
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.paths.watches import watch_contact, watch_slack
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, spring

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples"


def load_model(subject: Structure | BodySystem, request: ModelRequest, *more: str) -> Any:
    quantities = (*equilibrium_quantities(subject, request), *more)
    nodes = tuple(range(subject.n_nodes))
    return build_library(subject, request.wanting(*quantities, parameters={"node_load": nodes})).load()


def pattern_of(subject: Structure | BodySystem, **loads: tuple[float, float, float]) -> np.ndarray:
    pattern = np.zeros((subject.n_nodes, 3))
    for name, force in loads.items():
        pattern[subject.node_name.index(name)] = force
    return pattern


def follow(path: ModelPath, subject: Structure | BodySystem, most: float, **options: Any) -> LoadPath:
    cables = [name for name, bar_ in zip(subject.member_name, subject.is_bar, strict=True) if not bar_]
    start = find_equilibrium(path.model, arguments={"node_load": path.base}).coordinate
    watches = [watch_slack(path, cables), watch_contact(path, stops=options.pop("stops", True))]
    return follow_path(path, start, most=most, watches=watches, neutral=path.neutral_motions(), **options)


@pytest.fixture(scope="module")
def prism() -> tuple[Structure, Any]:
    structure, request = load_scene(EXAMPLES / "prism.toml")
    assert isinstance(structure, Structure)
    structure = structure.with_changes(node_load=np.zeros((6, 3)))
    return structure, load_model(structure, request, "member_extension", "bar_distance")


@pytest.mark.thorough
def test_slack_loads_equal_those_of_bisection(prism: tuple[Structure, Any]) -> None:
    structure, model = prism
    path = ModelPath(model, pattern_of(structure, t1=(0, 0, 1)))
    found = follow(path, structure, 40.0)
    events = found.find_events("slack")
    assert [event.names for event in events] == [("bottom1",), ("bottom3",)]
    for event in events:
        row = structure.member_name.index(event.names[0])
        low, high = event.load_factor - 0.01, event.load_factor + 0.01
        start = event.coordinate
        for _ in range(40):
            middle = (low + high) / 2
            load = {"node_load": path.base + middle * path.pattern}
            at = find_equilibrium(model, coordinate=start, arguments=load, tolerance=1e-11).coordinate
            taut = path.compute("member_extension", at, middle)[row] > 0
            low, high = (middle, high) if taut else (low, middle)
        assert event.load_factor == pytest.approx((low + high) / 2, rel=1e-9)


@pytest.mark.thorough
def test_a_symmetrical_load_makes_events_come_in_threes(prism: tuple[Structure, Any]) -> None:
    structure, model = prism
    up = dict.fromkeys(("t1", "t2", "t3"), (0.0, 0.0, 1.0))
    found = follow(ModelPath(model, pattern_of(structure, **up)), structure, 40.0)
    assert [(event.kind, event.names) for event in found.events] == [
        ("slack", ("bottom1", "bottom2", "bottom3")),
        ("slack", ("top1", "top2", "top3")),
        ("contact", ("bar1_bar2", "bar1_bar3", "bar2_bar3")),
    ]
    assert found.status == "stopped"


@pytest.mark.thorough
def test_work_of_the_load_is_the_change_of_energy(prism: tuple[Structure, Any]) -> None:
    """The work is integrated over the load by Gauss's rule, with the equilibria as its nodes."""
    structure, model = prism
    path = ModelPath(model, pattern_of(structure, t1=(0, 0, -1)))
    found = follow(path, structure, 5.0)
    assert found.status == "completed"
    node, weight = leggauss(12)
    direction = path.load_vector(found.coordinate[0], 0.0)

    def energy(load: float, q: np.ndarray) -> float:
        return float(path.compute("potential_energy", q, load) + load * direction @ q)

    # Work: integral of lambda F . dq = [lambda F . q] - integral of F . q dlambda.
    mean = 0.0
    for x, w in zip(2.5 * (node + 1), 2.5 * weight, strict=True):
        arguments = {"node_load": path.base + x * path.pattern}
        at = find_equilibrium(
            model, coordinate=found.coordinate[0], arguments=arguments, tolerance=1e-12
        ).coordinate
        mean += w * direction @ at
    work = 5.0 * direction @ found.coordinate[-1] - mean
    change = energy(5.0, found.coordinate[-1]) - energy(0.0, found.coordinate[0])
    assert work == pytest.approx(change, rel=1e-9)


def test_two_bars_touch_where_springs_let_them() -> None:
    """Springs of 50 N/m hold two nodes 1 m above a bar; radii of 0.05 m: contact at 2 * 50 * 0.9 N."""
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1], [0, 0, 2], [1, 0, 2]],
        [bar(0, 1, 1.0), bar(2, 3, 1.0), spring(2, 4, 1.0, 50.0), spring(3, 5, 1.0, 50.0)],
        anchored={0: "xyz", 1: "xyz", 2: "xy", 3: "xy", 4: "xyz", 5: "xyz"},
    ).with_changes(radius=np.array([0.05, 0.05, 0, 0]))
    model = load_model(structure, ModelRequest(()), "member_extension", "bar_distance")
    path = ModelPath(model, pattern_of(structure, n2=(0, 0, -0.5), n3=(0, 0, -0.5)))
    found = follow(path, structure, 200.0)
    assert (found.status, found.message.split(" at ")[0]) == ("stopped", "contact of e0_e1")
    assert found.load_factor[-1] == pytest.approx(90, rel=1e-12)
    on = follow(path, structure, 200.0, stops=False)
    # The axes meet at 100 N, where the distance is -0.1 m, and part again.
    assert [(event.kind, event.names) for event in on.events] == [
        ("contact", ("e0_e1",)),
        ("separation", ("e0_e1",)),
    ]
    assert on.events[1].load_factor == pytest.approx(110, rel=1e-12)
    assert on.coordinate[-1] == pytest.approx([-1, -1], rel=1e-9)


@pytest.fixture(scope="module", params=[False, True], ids=["linear springs", "tension only"])
def lin_prism(request: pytest.FixtureRequest) -> tuple[BodySystem, Any]:
    system, wanted = load_scene(EXAMPLES / "lin_prism.toml")
    assert isinstance(system, BodySystem)
    system = system.with_changes(tension_only=np.full(system.n_members, request.param))
    return system, load_model(system, wanted, "member_extension", "bar_distance", "bar_distance_case")


def test_the_largest_load_of_the_prism_of_lin(lin_prism: tuple[BodySystem, Any]) -> None:
    """LIN 3.2 asks for the load at which bars touch, and does not give it: B3 pressed down."""
    system, model = lin_prism
    path = ModelPath(model, pattern_of(system, bar3_B=(0, 0, -1)))
    found = follow(path, system, 20.0)
    slack, contact = found.events
    assert (slack.kind, slack.names) == ("slack", ("side2",))
    assert slack.load_factor == pytest.approx(13.168844, abs=1e-6)
    assert (contact.kind, contact.names) == ("contact", ("bar2_bar3",))
    expected = 13.576837 if system.tension_only[0] else 13.611547
    assert contact.load_factor == pytest.approx(expected, abs=1e-6)
    assert path.compute("bar_distance", contact.coordinate, contact.load_factor)[2] == pytest.approx(
        0, abs=1e-12
    )


@pytest.mark.thorough
@pytest.mark.parametrize("force", [(0, 0, -1.0), (1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0)])
def test_events_do_not_depend_on_the_steps(
    lin_prism: tuple[BodySystem, Any], force: tuple[float, float, float]
) -> None:
    system, model = lin_prism
    path = ModelPath(model, pattern_of(system, bar3_B=force))
    coarse, fine = (
        follow(path, system, 60.0, stops=False, control=StepControl(largest=size, most_steps=4000))
        for size in (0.2, 0.03)
    )
    assert [(e.kind, e.names) for e in coarse.events] == [(e.kind, e.names) for e in fine.events]
    loads = [[event.load_factor for event in found.events] for found in (coarse, fine)]
    np.testing.assert_allclose(*loads, rtol=1e-10)
    assert coarse.find_events("limit")
    for q, load in zip(coarse.coordinate, coarse.load_factor, strict=True):
        assert np.abs(path.residual(q, load)).max() < 1e-12


def test_the_load_vector_of_bodies_is_the_derivative_of_the_force(lin_prism: tuple[BodySystem, Any]) -> None:
    system, model = lin_prism
    path = ModelPath(model, pattern_of(system, bar3_B=(1.0, 2.0, -3.0), bar1_B=(0.5, 0, 0)))
    q = model.nominal("coordinate") + 0.1
    change = path.residual(q, 2.0) - path.residual(q, 1.0)
    np.testing.assert_allclose(path.load_vector(q, 1.0), change, atol=1e-12)
    assert path.neutral_motions() is None


def test_what_a_model_lacks_is_said(prism: tuple[Structure, Any]) -> None:
    structure, model = prism
    fixed = build_library(structure, ModelRequest(EQUILIBRIUM_QUANTITIES)).load()
    with pytest.raises(FormulationError, match="change at run time"):
        ModelPath(fixed, np.ones((6, 3)))
    forces = {"node_load": tuple(range(6))}
    poor = build_library(structure, ModelRequest(("node_residual",), parameters=forces)).load()
    with pytest.raises(FormulationError, match="lacks functions") as caught:
        ModelPath(poor, np.ones((6, 3)))
    assert caught.value.given == "tangent_stiffness"
    enough = ("node_residual", "tangent_stiffness")
    bare = ModelPath(
        build_library(structure, ModelRequest(enough, parameters=forces)).load(), np.ones((6, 3))
    )
    with pytest.raises(FormulationError):
        watch_slack(bare, ["top1"])
    with pytest.raises(FormulationError):
        watch_contact(bare)
    path = ModelPath(model, np.ones((6, 3)))
    with pytest.raises(UnknownNameError, match="unknown name"):
        watch_slack(path, ["top9"])
    with pytest.raises(UnknownNameError):
        watch_contact(path, ["bar1_bar9"])


@pytest.mark.parametrize("pattern", [np.zeros((6, 3)), np.ones((5, 3)), np.full((6, 3), np.nan)])
def test_a_pattern_that_is_no_load_is_refused(prism: tuple[Structure, Any], pattern: np.ndarray) -> None:
    with pytest.raises(InvalidValueError):
        ModelPath(prism[1], pattern)


@pytest.mark.thorough
def test_a_load_may_turn_back_where_a_cable_goes_slack(prism: tuple[Structure, Any]) -> None:
    """The stiffness jumps from positive to negative, without any zero between."""
    structure, model = prism
    structure = structure.with_changes(node_load=load_scene(EXAMPLES / "prism.toml")[0].node_load)
    base = {"node_load": structure.node_load}
    path = ModelPath(model, pattern_of(structure, t1=(0, 0, -1)), base)
    found = follow(path, structure, 9.0, stops=False)
    assert [(event.kind, event.names) for event in found.events] == [
        ("contact", ("bar1_bar2",)),
        ("slack", ("bottom1",)),
        ("limit", ("load",)),
    ]
    slack, limit = found.events[1:]
    assert slack.load_factor == limit.load_factor == found.load_factor.max()
    assert found.smallest_eigenvalue[limit.point - 1] > 0.1
    assert found.smallest_eigenvalue[limit.point + 1] < -1
    # Just below it there is an equilibrium next to the path, just above it none for far around.
    moved = []
    for load in (limit.load_factor - 1e-4, limit.load_factor + 1e-4):
        arguments = {"node_load": path.base + load * path.pattern}
        at = find_equilibrium(model, coordinate=limit.coordinate, arguments=arguments, raise_on_failure=False)
        moved.append(np.abs(at.member_length - path.compute("member_length", limit.coordinate, load)).max())
    assert moved[0] < 1e-4
    assert moved[1] > 1e-2


@pytest.mark.thorough
def test_a_floating_structure_turns_to_stay_in_balance() -> None:
    structure, request = load_scene(EXAMPLES / "icosahedron.toml")
    assert isinstance(structure, Structure)
    structure = structure.with_changes(node_load=np.zeros((12, 3)), gravity=np.zeros(3))
    model = load_model(structure, request, "member_extension", "bar_distance")
    rest = find_equilibrium(model, tolerance=1e-12)
    ends = [structure.node_name.index(name) for name in ("n10", "n8")]
    line = rest.node_position[ends[0]] - rest.node_position[ends[1]]
    pull = tuple(line / np.linalg.norm(line))
    pattern = pattern_of(structure, n10=pull, n8=tuple(-x for x in pull))
    found = follow(ModelPath(model, pattern), structure, 50.0, stops=False)
    assert found.status == "completed"
    assert found.find_events("bifurcation", "limit") == ()
    # Pushed together instead, it would rather turn round: unstable from the start, and followed all the same.
    pushed = follow(ModelPath(model, -pattern), structure, 5.0, stops=False)
    assert pushed.status == "completed"
    assert [(event.kind, event.load_factor) for event in pushed.events] == [("stability", 0.0)]
    assert pushed.smallest_eigenvalue[-1] < 0


def cable_dome() -> tuple[ReferenceModel, np.ndarray]:
    """Three sectors about an axis, two hoops of nodes on posts, anchored outside; 1 kN on the upper nodes."""
    angle = 2 * np.pi * np.arange(3) / 3
    outer, middle = (np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1) for r in (8.0, 4.0))
    place = np.zeros((11, 3))  # upper and lower node on the axis, anchors, upper and lower hoop
    place[0, 2], place[1, 2] = 1.4, -0.6
    place[2:5, :2] = outer
    place[5:, :2] = np.tile(middle, (2, 1))
    place[5:8, 2], place[8:, 2] = 1.0, -1.2
    members = [bar(1, 0, 2.000232861309073, 1e8 / 2.000232861309073)]
    for k in range(3):
        anchor, upper, lower = 2 + k, 5 + k, 8 + k
        ropes = {
            (anchor, upper): 4.112823566700908,
            (upper, 0): 4.012126752569139,
            (anchor, lower): 4.167329031363734,
            (upper, 1): 4.305882290359844,
            (lower, 8 + (k + 1) % 3): 6.920128132273389,
        }
        members += [cable(*ends, rest, 2e7 / rest) for ends, rest in ropes.items()]
        members.append(bar(lower, upper, 2.2002668215444054, 1e8 / 2.2002668215444054))
    model = ReferenceModel(make_structure(place, members, anchored=dict.fromkeys((2, 3, 4), "xyz")))
    load = np.zeros_like(model.nominal("node_load"))
    load[[0, 5, 6, 7], 2] = -1000.0
    return model, load


@pytest.mark.parametrize("step", [0.05, *thorough(0.3, 0.1, 0.02)])
def test_a_bifurcation_of_a_symmetric_dome_is_found_whatever_the_step(step: float) -> None:
    model, load = cable_dome()
    path = ModelPath(model, load)
    start = find_equilibrium(model, tolerance=1e-12).coordinate
    way = follow_path(path, start, most=13.5, control=StepControl(largest=step))
    assert (way.status, [event.kind for event in way.events]) == ("completed", ["bifurcation"])
    assert way.events[0].load_factor == pytest.approx(11.3227456828, rel=1e-7)


def test_a_dome_that_is_not_quite_symmetric_turns_away_near_the_bifurcation() -> None:
    """0.1 N across beside loads of 1 kN: no eigenvalue crosses zero, the path tells where one is near."""
    model, load = cable_dome()
    load[5, 1] = 0.1
    start = find_equilibrium(model, tolerance=1e-12).coordinate
    way = follow_path(ModelPath(model, load), start, most=13.5, control=StepControl(largest=0.05))
    assert (way.status, way.events, way.stable_up_to) == ("completed", (), None)
    assert way.near_bifurcation == pytest.approx(11.3227456828, rel=1e-2)
    assert "near a bifurcation at load factor 11.3" in way.describe_stability(10)[0]
    early = follow_path(ModelPath(model, load), start, most=11.0)
    assert (early.near_bifurcation, early.describe_stability(10)) == (None, [])


@pytest.mark.parametrize("before", [1.6e-6, *thorough(1e-4, 1e-5, 1e-6)])
def test_a_path_that_begins_just_before_a_bifurcation_finds_it(before: float) -> None:
    model, load = cable_dome()
    path = ModelPath(model, load)
    near = 11.3227456828 - before
    start = find_equilibrium(model, arguments={"node_load": near * load}, tolerance=1e-12).coordinate
    way = follow_path(path, start, least=near, most=13.5)
    assert (way.status, [event.kind for event in way.events]) == ("completed", ["bifurcation"])
    assert way.events[0].load_factor == pytest.approx(11.3227456828, rel=1e-7)
