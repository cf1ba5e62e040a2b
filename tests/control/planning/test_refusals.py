"""Plans that are refused: paths that are blocked, proofs that there is no plan, and wrong input."""

import tomllib
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.control.pages.plans import binding_table, describe_plan
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import Binding, Contradiction, PlanResult
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    SingularStiffnessError,
    StructureError,
    TensegrityError,
    UnknownNameError,
    UnstableError,
)
from tests.cases import thorough
from tests.control.planning.structures import (
    CLASSES,
    actuate,
    assemble,
    build_passing_bars,
    build_prism,
    compile_plan,
    limit,
)

PRISM = build_prism(155.0)
OPPOSITE = [f"opposite{i}" for i in (1, 2, 3)]


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return compile_plan(limit(actuate(PRISM)))


def find_blocked(structure: Any, target: str | list[str], **options: Any) -> PlanResult:
    found = plan(compile_plan(structure), target, **options)
    assert found.status == "blocked"
    assert found.block is not None
    assert "Another path may exist" in found.message
    return found


def test_a_path_that_the_clearance_of_bars_ends_names_it_and_not_a_lack_of_progress() -> None:
    """Eight full steps come before the one that the bars forbid."""
    shape = {"kind": "prism", "bars": 4, "bottom_radius": 0.12, "height": 0.25, "twist": 150.0}
    shape |= {"opposite_class": "cable", "prestress": 15.0}
    classes = CLASSES | {"cable": {"kind": "cable", "spring_constant": 1500.0}}
    prism = assemble({"name": "four", "classes": classes, "shape": shape})
    free = limit(actuate(prism), least=0.5, clearance=0.003, most=80.0)
    found = find_blocked(free, ["twist=193.209", "height=0.2976"], attempts=0)
    assert found.progress[-1] == pytest.approx(0.428, abs=0.001)
    assert len(found.progress) > 9
    assert "height = 0.270375 m of 0.2976: the limits leave no progress; binding: clearance of 0.003 m" in (
        found.message
    )
    assert found.message.endswith("Another path may exist: more `attempts` look for it")
    assert len(names(found, "clearance")) == 4


def names(found: PlanResult, limit: str) -> list[str]:
    assert found.block is not None
    return sorted(item.name for item in found.block.binding if item.limit == limit)


# --- blocked ---------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("twist", [179, 191])
def test_the_twist_by_six_motors_is_blocked_by_the_bars(twist: int, motors: CompiledModel) -> None:
    found = plan(motors, {"twist": twist}, steps=8)
    assert found.status == "blocked"
    assert 174.0 < found.target[-1, 0] < 175.0
    assert names(found, "clearance") == ["bar1 and bar2", "bar1 and bar3", "bar2 and bar3"]
    assert found.bar_distance[-1].min() == pytest.approx(0.002, rel=1e-6)
    assert "the limits leave little progress" in found.message
    assert "further steps are possible, and `least_progress` 0 takes them" in found.message
    assert "2 paths that begin with other changes end no further" in found.message


def test_the_verticals_alone_are_blocked_by_the_least_tension() -> None:
    found = find_blocked(limit(actuate(PRISM, "vertical")), "twist=165")
    assert 158.0 < found.target[-1, 0] < 159.0
    assert names(found, "least_tension") == OPPOSITE
    assert found.block is not None
    assert abs(found.block.least_progress) < 1e-6
    assert all(item.multiplier > 0 for item in found.block.binding)


def test_the_largest_tension_blocks_the_way_to_a_low_prism() -> None:
    structure = limit(actuate(PRISM, "vertical"), most=21.0)
    found = find_blocked(structure, "height=0.27", steps=5)
    assert names(found, "most_tension")
    assert found.member_tension[:, ~structure.is_bar].max() <= 21.0 * (1 + 1e-6)


@pytest.mark.thorough
def test_the_cause_of_a_rejected_step_is_reported() -> None:
    """A target with a jump, to a value in the jump: steps across it miss it, whatever their size."""
    jump = "moving1.x + 0.005 * (moving1.x + 0.15) / abs(moving1.x + 0.15)"
    found = find_blocked(build_passing_bars(), f"{jump}=-0.15", steps=5)
    assert found.target[-1, 0] == pytest.approx(-0.155, abs=1e-4)
    assert found.block is not None
    assert found.block.binding == ()
    assert "the corrections of the step do not converge" in found.message
    assert " is missed by " in found.message


@pytest.mark.thorough
def test_the_range_of_the_actuators_blocks_the_way_to_170_degrees() -> None:
    found = find_blocked(limit(actuate(PRISM, within=0.01)), "twist=170")
    assert 162.0 < found.target[-1, 0] < 163.5
    assert {name.rstrip("123") for name in names(found, "range")} >= {"pull_opposite", "pull_vertical"}
    assert np.abs(found.change).max() <= 0.01 * (1 + 1e-6)


@pytest.mark.thorough
def test_the_multiplier_is_the_progress_for_a_unit_of_the_limit() -> None:
    structure = actuate(PRISM, "vertical")
    found = find_blocked(limit(structure), "twist=165")
    assert found.block is not None
    gained = 0.01 * sum(item.multiplier for item in found.block.binding)
    eased = find_blocked(limit(structure, least=0.99), "twist=165")
    assert eased.progress[-1] - found.progress[-1] == pytest.approx(gained, rel=0.01)


def test_places_and_lengths_far_away_may_be_in_millimetres(model: CompiledModel) -> None:
    for target in ("height=270", 'member_length["vertical1"]=270'):
        (text,) = plan(model, target, attempts=0, max_steps=1).warnings
        assert "is 270 m, farther away than the structure is large" in text
        assert text.endswith("is it 270 mm?")
    for target in ("twist=165", 'member_tension["vertical1"]=20', "height=270mm"):
        assert plan(model, target, attempts=0, max_steps=1).warnings == ()


def test_the_nearest_node_is_suggested(model: CompiledModel) -> None:
    with pytest.raises(UnknownNameError) as caught:
        plan(model, "t11.z=0.3")
    assert caught.value.hint == "did you mean 't1'?"


def test_limits_are_listed_by_what_one_per_cent_of_them_gains() -> None:
    """A multiplier of 1/m is larger than one of 1/N, and says less."""
    binding = (
        Binding("most_tension", "a", 400.0, 0.0, "N", 1e-5),
        Binding("range", "b", 0.01, 0.0, "m", 3e-3),
    )
    found = find_blocked(limit(actuate(PRISM, "vertical")), "twist=165")
    assert found.block is not None
    gains = [item.multiplier * item.bound for item in found.block.binding]
    assert gains == pytest.approx(sorted(gains, reverse=True), rel=1e-5)
    table = binding_table(replace(found, block=replace(found.block, binding=binding)), "prism")
    assert table is not None
    assert table.ranking == (("most progress for one per cent of the limit", [0, 1]),)


def test_a_target_that_nothing_moves_is_named() -> None:
    prism = build_prism(150.0, opposite=False)  # its twist is stationary
    found = find_blocked(limit(actuate(prism)), "twist=155")
    assert "no actuator changes twist here, to first order" in found.message
    assert found.n_steps == 0
    assert found.block is not None
    assert found.block.binding == ()


def test_too_few_actuators_for_the_targets_are_counted(model: CompiledModel) -> None:
    pair = ["pull_vertical1", "pull_opposite1"]
    found = plan(model, {"tilt": 10.0, "twist": 160.0, "height": 0.29}, actuators=pair)
    assert found.status == "blocked"
    assert "the targets have 4 components (tilt.towards, tilt.sideways, twist, height)" in found.message
    assert "the actuators (2) change only 2 of them independently" in found.message
    assert plan(model, "twist=155.5", actuators=pair[:1], steps=2).n_steps > 0


@pytest.fixture(scope="module")
def motors() -> CompiledModel:
    """Return the example scene with a motor of wide range on each of six cables."""
    document = tomllib.loads(list_examples()["prism12"])
    for actuator in document["actuators"]:
        actuator["range"] = [0.01, 1.0]
    return compile_plan(assemble(document))


@pytest.mark.thorough
@pytest.mark.parametrize("goal", [0.0, 0.002])
def test_a_path_goes_as_far_whatever_the_distance_of_the_target(goal: float, motors: CompiledModel) -> None:
    found = plan(motors, {"height": goal})
    assert found.status == "blocked"
    assert 0.02 < found.target[-1, 0] < 0.04
    assert names(found, "clearance") == ["bar1 and bar2", "bar1 and bar3", "bar2 and bar3"]


@pytest.mark.parametrize("steps", [1, *thorough(2, 20)])
def test_few_steps_reach_the_target_too(steps: int, motors: CompiledModel) -> None:
    found = plan(motors, "height=0.15", steps=steps)
    assert found.status == "found", found.message


@pytest.mark.thorough
def test_a_node_between_two_ropes_is_blocked_by_the_range_or_by_the_size_of_steps() -> None:
    cable = {"class": "cable", "rest_length": 1.0}
    nodes = {"a": {"position": [-1.0, 0.0, 1.0], "anchored": True}}
    nodes |= {"b": {"position": [1.0, 0.0, 1.0], "anchored": True}, "m": {"position": [0.0, 0.0, 0.5]}}
    nodes |= {"c": {"position": [0.0, 1.0, 0.0], "anchored": True}}
    nodes |= {"d": {"position": [0.0, -1.0, 0.0], "anchored": True}}
    ends = {f"{name}m": {**cable, "nodes": [name, "m"]} for name in "abcd"}
    ropes = actuate(assemble({"name": "ropes", "classes": CLASSES, "nodes": nodes, "members": ends}))
    found = plan(compile_plan(limit(ropes)), "m.z=1.5")  # above all anchors
    assert found.status == "blocked"
    assert 0.6 < found.target[-1, 0] < 1.0
    assert found.block is not None
    assert found.block.binding or "a step changes rest lengths by" in found.message


# --- infeasible ------------------------------------------------------------------------------------


@pytest.mark.parametrize("tension", [5.0, 0.0])
def test_no_plan_starts_from_a_prism_of_9_cables_at_160_degrees(tension: float) -> None:
    shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "twist": 160.0}
    classes = {**CLASSES, "cable": {**CLASSES["cable"], "prestress": tension}}
    structure = limit(actuate(assemble({"name": "prism", "classes": classes, "shape": shape})))
    model = compile_plan(structure)
    matrix = equilibrium_matrix(structure.node_position, structure.connectivity)
    for limits in (None, Limits()):
        found = plan(model, "twist=165", limits=limits)
        assert found.status == "infeasible"
        assert "no plan starts from the stated shape" in found.message
        assert "equilibrium SCENE -o NEW.toml" in found.message
        assert isinstance(found.certificate, Certificate)
        assert found.target.shape == (1, 1)
        np.testing.assert_allclose(found.node_position[0], structure.node_position, atol=1e-12)
        elongation = matrix.T @ found.certificate.displacement
        np.testing.assert_allclose(elongation[~structure.is_bar], -1.0, atol=1e-9)
        assert np.abs(elongation[structure.is_bar]).max() < 1e-9


def build_two_cables(x: float, rest: tuple[float, float], right: float = 1.0) -> Structure:
    """Return a node with 10 N downwards that hangs from two cables, in a plane."""
    document = {
        "name": "hung",
        "nodes": {
            "l": {"position": [-1.0, 0.0, 1.0], "anchored": True},
            "r": {"position": [right, 0.0, 1.0], "anchored": True},
            "m": {"position": [x, 0.0, 0.0], "anchored": "y"},
        },
        "members": {
            name: {"kind": "cable", "nodes": [end, "m"], "spring_constant": 1000.0, "rest_length": length}
            for name, end, length in zip(("cl", "cr"), "lr", rest, strict=True)
        },
        "loads": [{"node": "m", "force": [0.0, 0.0, -10.0]}],
    }
    return actuate(assemble(document))


def require(least: float) -> Limits:
    return Limits(
        least_tension=np.full(2, least),
        most_tension=np.full(2, np.inf),
        yield_stress=np.full(2, np.inf),
        buckling=np.zeros(2),
    )


def test_a_shape_that_slack_cables_permit_is_no_contradiction() -> None:
    """The node hangs straight below l; the other cable is slack, and may be."""
    model = compile_plan(build_two_cables(-1.0, (0.99, 3.0), right=0.0))
    targets = {"m.x": -1.0, "m.z": 0.2}
    for limits in (None, require(0.0)):
        found = plan(model, targets, limits=limits, steps=4)
        assert found.status == "found"
        assert found.member_tension[:, 1].max() == 0.0
    needed = plan(model, targets, limits=require(0.5))
    assert needed.status == "infeasible"
    assert isinstance(needed.certificate, Certificate)
    assert needed.certificate.shortening == (1,)


def test_the_shape_below_an_anchor_is_allowed_and_the_one_beyond_is_not() -> None:
    lengths = np.hypot([1.1, 0.9], 1.0)
    tension = 10.0 * np.array([0.45, 0.55]) * lengths
    structure = build_two_cables(0.1, tuple(lengths - tension / 1000.0))
    model = compile_plan(structure)
    edge = plan(model, {"m.x": 1.0, "m.z": 0.0}, steps=10)
    assert edge.status == "found"
    assert abs(edge.member_tension[-1, 0]) < 1e-5
    beyond = plan(model, {"m.x": 1.1, "m.z": 0.0}, steps=10)
    assert beyond.status == "infeasible"
    proof = beyond.certificate
    assert isinstance(proof, Certificate)
    vector = np.array([[2.1, -1.0], [0.1, -1.0]])
    elongation = vector @ proof.displacement / np.linalg.norm(vector, axis=1)
    assert elongation.max() < 1e-9
    assert proof.displacement @ [0.0, -10.0] == pytest.approx(proof.load_work)
    assert proof.load_work > 0.01
    assert "no cable in compression" in beyond.message
    # Not linear in the coordinates: another shape may have these lengths too, so that nothing is proved.
    far = {'member_length["cl"]': float(np.hypot(2.1, 1.0)), 'member_length["cr"]': float(np.hypot(0.1, 1.0))}
    assert plan(model, far, steps=10).status == "blocked"


def test_a_neutral_start_is_not_called_unstable_and_limits_come_first() -> None:
    loose = PRISM.with_changes(rest_length=PRISM.member_length())  # of 12 cables, without prestress
    model = compile_plan(limit(actuate(loose)))
    with pytest.raises(StructureError, match="the start is outside the limits") as caught:
        plan(model, "twist=160")
    assert "violated by 1 N" in str(caught.value)
    assert "and 9 more" in str(caught.value)
    with pytest.raises(SingularStiffnessError, match="neutral: nothing resists 9 independent motions"):
        plan(model, "twist=160", limits=Limits())


def test_a_bar_on_end_is_an_unstable_start() -> None:
    document = {
        "name": "column",
        "nodes": {
            "foot": {"position": [0.0, 0.0, 0.0], "anchored": True},
            "top": {"position": [0.0, 0.0, 1.0]},
            "far": {"position": [3.0, 0.0, 1.0], "anchored": True},
        },
        "members": {
            "bar": {"kind": "bar", "nodes": ["foot", "top"], "spring_constant": 1e4, "rest_length": 1.001},
            "cable": {"kind": "cable", "nodes": ["top", "far"], "spring_constant": 1e3, "rest_length": 4.0},
        },
        "loads": [{"node": "top", "force": [0.0, 0.0, -10.0]}],
    }
    with pytest.raises(UnstableError, match="the start is an unstable equilibrium"):
        plan(compile_plan(actuate(assemble(document))), "top.z=1.1")


def test_targets_that_fix_a_shape_without_prestress_have_no_plan() -> None:
    shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "anchor_bottom": True}
    structure = assemble({"name": "held", "classes": CLASSES, "shape": {**shape, "prestress": 20.0}})
    turned = assemble({"name": "held", "classes": CLASSES, "shape": {**shape, "twist": 160.0}})
    targets = {
        f"t{i}.{axis}": float(turned.node_position[2 + i, "xyz".index(axis)])
        for i in (1, 2, 3)
        for axis in "xyz"
    }
    found = plan(compile_plan(limit(actuate(structure))), targets)
    assert found.status == "infeasible"
    assert isinstance(found.certificate, Certificate)
    assert found.certificate.is_verified


@pytest.mark.parametrize(
    ("target", "limit_name", "given", "allowed"),
    [
        ('member_length["opposite1"]=0.5', "most_tension", 130.4, 30.0),
        ('rest_length("opposite1")=0.5', "range", 0.5, 0.3696),
        ('member_tension["opposite1"]=0.5', "least_tension", 0.5, 1.0),
        ('bar_distance["bar1_bar2"]=0.001', "clearance", 0.001, 0.002),
        ('member_length["opposite1"]=0.3', "range", 0.3, 0.3496),
        ('member_length["bar1"]=-0.3', "least_value", -0.3, 0.0),
        ("height=-0.1", "least_value", -0.1, 0.0),
        ("height([t1, t2, t3], [b1, b2, b3])=-3mm", "least_value", -0.003, 0.0),
    ],
)
def test_limits_of_one_member_contradict_a_target(
    target: str, limit_name: str, given: float, allowed: float
) -> None:
    model = compile_plan(limit(actuate(PRISM, within=0.01), most=30.0))
    if "bar_distance" in target:
        target = target.replace("bar1_bar2", model.manifest.bar_pair_name[0])
    found = plan(model, target)
    assert found.status == "infeasible"
    proof = found.certificate
    assert isinstance(proof, Contradiction)
    assert proof.limit == limit_name
    assert proof.given == pytest.approx(given, rel=1e-3)
    assert proof.allowed == pytest.approx(allowed, rel=1e-3)
    assert f"{proof.allowed:.6g}" in found.message
    # All arrays have a row, the start.
    assert found.n_steps == 0
    assert found.progress.tolist() == [0.0]
    assert found.binding == ((),)
    np.testing.assert_allclose(found.rest_length, [PRISM.rest_length[~PRISM.is_bar]])
    np.testing.assert_allclose(found.node_position, [PRISM.node_position], atol=1e-9)
    assert found.residual[0] < 1e-6
    assert describe_plan(found)["targets"][0]["start"] == found.target[0, 0]


@pytest.mark.parametrize(
    ("targets", "is_exact"),
    [
        ({"t1.z": 0.6}, False),
        ({"t1.x": 0.15, "t1.y": 0.0, "t1.z": 0.4}, True),
        ({"t1.x": -0.05, "t1.y": -0.05, "t1.z": 0.2}, True),
    ],
)
def test_a_node_off_the_sphere_of_its_bar_is_infeasible(targets: dict[str, float], is_exact: bool) -> None:
    shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "anchor_bottom": True}
    structure = assemble({"name": "held", "classes": CLASSES, "shape": {**shape, "prestress": 20.0}})
    found = plan(compile_plan(limit(actuate(structure))), targets)
    assert found.status == "infeasible"
    proof = found.certificate
    assert isinstance(proof, Contradiction)
    assert (proof.name, proof.limit) == ("bar1", "balance")
    assert abs(proof.given) > abs(proof.allowed) > 1000.0
    assert ("or more" in found.message) != is_exact
    assert all(name in found.message for name in targets)


def test_a_node_whose_name_begins_with_height_may_be_below_zero() -> None:
    structure = build_two_cables(0.1, (1.48, 1.34))
    names = tuple(name.replace("m", "height1") for name in structure.node_name)
    model = compile_plan(structure.with_changes(node_name=names))
    assert plan(model, "height1.z=-0.05", steps=2).status == "found"


# --- wrong input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "error", "part"),
    [
        ("twst=160", UnknownNameError, "did you mean 'twist'"),
        ("t9.z=0.3", UnknownNameError, "t9"),
        ('member_length["oposite1"]=0.3', UnknownNameError, "oposite1"),
        ('rotation("q*")=0,0,5', UnknownNameError, "q*"),
        ("twist=abc", InvalidValueError, "twist=abc"),
        ("twist=nan", InvalidValueError, "twist=nan"),
        ("twist", InvalidValueError, "twist"),
        ("twist=160mm", InvalidValueError, "mm"),
        ("tilt=1,2,3", InvalidValueError, "2 numbers"),
        ("twist([t1, t2, t3], [b1, b2])=160", InvalidValueError, "on a line"),
        ("height([t1], [b1, b1, b2])=1", InvalidValueError, "twice"),
        ("past_edge(b1)=1", InvalidValueError, "two nodes"),
        ("centre_of_mass.x=0.1", FormulationError, "mass"),
        ("twist - height=1", InvalidValueError, "by itself"),
        ("t1.z=0.35", InvalidValueError, "as a whole"),
        ('rotation("t*")=0,0,5', InvalidValueError, "as a whole"),
    ],
)
def test_a_wrong_target_is_named(
    target: str, error: type[Exception], part: str, model: CompiledModel
) -> None:
    with pytest.raises(error) as caught:
        plan(model, target)
    assert part in str(caught.value)
    assert caught.value.exit_code == 2  # type: ignore[attr-defined]


def test_a_target_given_twice_is_refused(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="given twice"):
        plan(model, ["twist=160", "twist = 161"])


def test_no_actuators() -> None:
    structure = build_two_cables(0.1, (1.48, 1.34)).with_changes(actuators=(), inputs=())
    with pytest.raises(StructureError, match="no actuators") as caught:
        plan(compile_plan(structure), "m.z=0.1")
    assert "[[actuators]]" in str(caught.value)


@pytest.mark.parametrize(("chosen", "part"), [(["pull_top9"], "unknown"), (["pull_top1"] * 2, "twice")])
def test_wrong_names_of_actuators(chosen: list[str], part: str, model: CompiledModel) -> None:
    with pytest.raises((UnknownNameError, InvalidValueError), match=part):
        plan(model, "twist=160", actuators=chosen)


@pytest.mark.parametrize(
    ("structure", "part"),
    [
        (limit(actuate(PRISM), least=5.0), "least tension of opposite1: violated by 2.54072 N"),
        (limit(actuate(PRISM), most=19.0), "largest tension of vertical1: violated by 1 N"),
        (limit(actuate(PRISM), clearance=0.05), "clearance of bar1 and bar2: violated by 0.00946"),
    ],
)
def test_a_start_outside_the_limits_is_refused_with_the_amount(structure: Any, part: str) -> None:
    with pytest.raises(StructureError, match="the start is outside the limits") as caught:
        plan(compile_plan(structure), "twist=160")
    assert part.split(" of ")[0] in str(caught.value)
    assert part.split(": ")[1] in str(caught.value)


@pytest.mark.parametrize(
    "options", [{"steps": 0}, {"max_steps": 1.5}, {"duration": -1.0}, {"least_progress": 1.0}]
)
def test_wrong_options(options: dict[str, Any], model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(options))):
        plan(model, "twist=160", **options)


WRONG: list[Any] = [None, True, "x", b"x", float("nan"), -1e300, 1 + 2j, [], {}, [1, "a"], object(), {1: 2}]
WRONG += [np.zeros((2, 2)), np.array(["a"]), np.full(15, 1j), np.full(15, np.nan), [[1], [1, 2]], 10**400]
WRONG += [np.float32(3), np.datetime64("2020"), range(3), 2.5, "1", {"twist": None}, [np.zeros((2, 2))]]


@pytest.mark.parametrize(
    "name",
    [
        "targets",
        "actuators",
        "limits",
        "steps",
        "max_steps",
        "least_progress",
        "duration",
        "progress",
        "arguments",
    ],
)
def test_wrong_arguments_raise_named_errors(name: str, model: CompiledModel) -> None:
    refused = 0
    for value in WRONG:
        given = {"targets": "twist=155.1", "steps": 1, "max_steps": 1, name: value}
        if name == "arguments":
            given[name] = {"input": value}
        with suppress(TensegrityError):
            plan(model, given.pop("targets"), **given)
            continue
        refused += 1
    assert refused >= 20


@pytest.mark.parametrize("name", [item.name for item in fields(Limits)])
def test_wrong_limits_raise_named_errors(name: str, model: CompiledModel) -> None:
    assert model.structure is not None
    refused = 0
    for value in WRONG:
        with suppress(TensegrityError):
            limits = replace(model.structure.limits, **{name: value})
            plan(model, "twist=155.1", limits=limits, steps=1, max_steps=1)
            continue
        refused += 1
    assert refused >= 20
    with pytest.raises(InvalidValueError, match=f"limits.{name}"):
        plan(model, "twist=156", limits=replace(model.structure.limits, **{name: "x"}))


def test_a_duration_that_the_rates_do_not_permit() -> None:
    model = compile_plan(limit(actuate(PRISM, rate=0.001)))
    with pytest.raises(InvalidValueError, match="more time"):
        plan(model, "twist=157", duration=0.5)
