"""Plans that are found: steps, tensions, clearances, residuals of prisms, an icosahedron and a tower."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.control.planning.step_problem import Program
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.scene.formats.import_ntrt import import_ntrt
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.applied_inputs import actuate_members
from tests.cases import thorough
from tests.control.planning.structures import (
    CLASSES,
    actuate,
    assemble,
    build_icosahedron,
    build_mast,
    build_passing_bars,
    build_prism,
    build_tower,
    compile_plan,
    limit,
    prestress,
    transform,
)

PRISM9 = limit(actuate(build_prism(150.0, opposite=False)))
PRISM12 = limit(actuate(build_prism(155.0)))


@cache
def find(which: str, target: str) -> PlanResult:
    return plan(compile_plan({"9": PRISM9, "12": PRISM12}[which]), target)


def check(found: PlanResult, structure: Any, *, steps: int, least: float, clearance: float) -> None:
    """Check a plan against its limits at every point, and against what the plan is expected to keep."""
    assert found.status == "found", found.message
    assert found.n_steps <= steps
    assert found.progress[0] == 0.0
    assert found.progress[-1] == 1.0
    assert np.all(np.diff(found.progress) > 0)
    cable = ~structure.is_bar
    limits = structure.limits
    short = limits.least_tension[cable] - found.member_tension[:, cable]
    assert np.all(short <= 1e-6 * limits.least_tension[cable])
    assert np.all(found.bar_distance >= limits.clearance * (1 - 1e-6))
    assert found.member_tension[:, cable].min() >= least
    assert found.bar_distance.min() >= clearance
    assert found.smallest_eigenvalue.min() > 0.0
    mu = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    assert found.residual.max() <= 1e-9 * mu.max() / mu[cable].min()
    np.testing.assert_allclose(found.target[-1], found.goal, rtol=1e-7, atol=1e-6)


def test_the_twist_of_a_prism_with_12_cables() -> None:
    found = find("12", "twist=165")
    check(found, PRISM12, steps=40, least=2.4, clearance=0.019)
    np.testing.assert_allclose(found.target[[0, -1], 0], [155.0, 165.0], rtol=1e-7)
    assert found.rest_length.shape == (found.n_steps + 1, 12)
    np.testing.assert_allclose(found.rest_length - found.rest_length[0], found.change, atol=1e-15)


@pytest.mark.parametrize("target", thorough("height=350mm", "tilt=10", "height=0.25"))
def test_tilt_and_height_of_a_prism_with_9_cables(target: str) -> None:
    check(find("9", target), PRISM9, steps=40, least=6.5, clearance=0.035)


def test_the_points_are_equilibria_by_the_search_for_equilibria() -> None:
    found, model = find("12", "twist=165"), compile_plan(PRISM12)
    middle = found.n_steps // 2
    arguments = dict(zip(found.actuator_name, found.change[middle], strict=True))
    again = find_equilibrium(model, coordinate=found.node_position[middle].ravel(), arguments=arguments)
    np.testing.assert_allclose(again.member_tension, found.member_tension[middle], rtol=1e-7, atol=1e-8)


@pytest.mark.thorough
@pytest.mark.parametrize("edge", [(0, 1), (1, 2), (2, 0)])
def test_the_centre_of_mass_of_an_icosahedron_goes_past_an_edge(edge: tuple[int, int]) -> None:
    structure, facet = build_icosahedron()
    structure = limit(actuate(structure))
    model = compile_plan(structure, "support_reaction")
    first, second = (facet[k] for k in edge)
    far = structure.node_name.index(facet[3 - sum(edge)])
    found = plan(model, f"past_edge({first}, {second})=10mm")
    check(found, structure, steps=80, least=25.0, clearance=0.1)
    ends = [structure.node_name.index(name) for name in (first, second)]
    for position, change, past in zip(found.node_position, found.change, found.target[:, 0], strict=True):
        free = position[~structure.node_anchored].ravel()
        reaction = model.compute("support_reaction", coordinate=free, input=change)
        vertical = reaction.reshape(-1, 3)[sorted([*ends, far]).index(far), 2]
        along = position[ends[1]] - position[ends[0]]
        outward = np.cross(along, [0.0, 0.0, 1.0]) / np.linalg.norm(along)
        arm = abs((position[far] - position[ends[0]]) @ outward)
        assert vertical * arm == pytest.approx(-2.4 * 9.81 * past, abs=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("targets", [{"tilt": 20.0}, {'rotation("t5_*")': (0.0, 20.0, 0.0)}])
def test_the_top_of_a_tower_tilts_by_20_degrees(targets: dict[str, Any]) -> None:
    structure = limit(actuate(build_tower()))
    check(plan(compile_plan(structure), targets), structure, steps=50, least=3.5, clearance=0.015)


@pytest.mark.thorough
def test_the_top_of_a_tower_tilts_by_60_degrees() -> None:
    structure = limit(actuate(build_tower()))
    check(plan(compile_plan(structure), "tilt=60"), structure, steps=50, least=3.0, clearance=0.007)


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["tilt=160", "tilt=-120,120"])
def test_the_top_of_a_mast_turns_upside_down(target: str) -> None:
    check(
        plan(compile_plan(build_mast()), target),
        build_mast(),
        steps=30,
        least=1.0 - 1e-6,
        clearance=0.002 * (1 - 1e-6),
    )


@pytest.mark.parametrize("steps", [3, *thorough(10)])
def test_a_bar_goes_round_one_that_symmetrical_changes_only_push_it_against(steps: int) -> None:
    structure = build_passing_bars()
    found = plan(compile_plan(structure), {"moving1.x": 0.2, "moving2.x": 0.2}, steps=steps)
    check(found, structure, steps=20, least=1.0 - 1e-6, clearance=0.01 * (1 - 1e-6))
    again = plan(compile_plan(structure), {"moving1.x": 0.2, "moving2.x": 0.2}, steps=steps)
    np.testing.assert_array_equal(again.change, found.change)


@pytest.mark.thorough
@pytest.mark.parametrize("twist", [176, 179, 181, 191])
def test_the_bars_of_a_prism_pass_each_other_by_unequal_changes(twist: int) -> None:
    found = find("12", f"twist={twist}")
    check(found, PRISM12, steps=40, least=1.0 - 1e-6, clearance=0.002 * (1 - 1e-6))


@pytest.mark.thorough
def test_a_tower_turns_by_unequal_changes() -> None:
    found = plan(compile_plan(build_mast()), 'rotation("t3_*").z=170')
    check(found, build_mast(), steps=40, least=1.0 - 1e-6, clearance=0.002 * (1 - 1e-6))


@pytest.mark.thorough
def test_a_path_goes_on_after_a_few_steps_that_make_little_progress() -> None:
    structure = limit(actuate(build_prism(155.0)), most=30.0)
    found = plan(compile_plan(structure), "twist=150.5")
    check(found, structure, steps=40, least=1.0 - 1e-6, clearance=0.002)
    assert found.member_tension[:, ~structure.is_bar].max() <= 30.0 * (1 + 1e-6)
    assert np.diff(found.progress).min() < 0.4 / 20


@pytest.mark.thorough
def test_the_top_of_a_tower_tilts_by_its_verticals_alone() -> None:
    structure = limit(actuate(build_tower(), "vertical"))
    found = plan(compile_plan(structure), "tilt=20")
    check(found, structure, steps=50, least=1.0 - 1e-6, clearance=0.002 * (1 - 1e-6))
    assert found.change.shape[1] == 15


SHARED = Path(__file__).parents[4] / "shared" / "data" / "ntrt"


@pytest.mark.thorough
@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared structures are not beside the checkout")
@pytest.mark.parametrize("vector", [(20.0, 0, 0), (0, 20.0, 0), (0, 0, 20.0), (50.0, 0, 0)])
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_an_imported_spine_turns_its_last_vertebra(scale: float, vector: tuple[float, ...]) -> None:
    file = SHARED / "Spines" / "TetrahedralSpine.yaml"
    structure = assemble(import_ntrt(file, length_scale=scale).document)
    held = np.array([name.startswith("t1_") for name in structure.node_name])
    structure = structure.with_changes(node_anchored=np.repeat(held[:, None], 3, axis=1))
    structure = limit(actuate(prestress(structure, 100.0)))
    found = plan(compile_plan(structure), {'rotation("t6_*")': vector})
    check(found, structure, steps=60, least=30.0, clearance=6.0 * scale)


def test_the_plan_does_not_depend_on_place_direction_order_and_names() -> None:
    generator = np.random.default_rng(1)
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    order = generator.permutation(PRISM9.n_members)
    moved = transform(PRISM9, turn, np.array([600.0, -500.0, 625.0]), order)
    here, there = (plan(compile_plan(item), "tilt=10", steps=3) for item in (PRISM9, moved))
    assert there.n_steps == here.n_steps
    columns = [there.actuator_name.index(name) for name in here.actuator_name]
    np.testing.assert_allclose(there.change[:, columns], here.change, atol=1e-6 * np.abs(here.change).max())
    np.testing.assert_allclose(there.member_tension[:, np.argsort(order)], here.member_tension, rtol=1e-6)


def test_several_targets_at_once() -> None:
    found = plan(compile_plan(PRISM12), {"twist": 160.0, "height": 0.31}, steps=5)
    check(found, PRISM12, steps=40, least=1.0, clearance=0.002)
    np.testing.assert_allclose(found.target[-1], [160.0, 0.31], rtol=1e-7)


def test_a_target_is_an_expression() -> None:
    target = 'member_length["opposite1"] - member_length["opposite2"]'
    found = plan(compile_plan(PRISM12), {target: 0.01})
    check(found, PRISM12, steps=40, least=1.0, clearance=0.002)


def test_a_target_is_a_rest_length() -> None:
    found = plan(compile_plan(PRISM12), 'rest_length("opposite1")=0.37')
    assert found.status == "found"
    column = found.actuator_name.index("pull_opposite1")
    assert found.rest_length[-1, column] == pytest.approx(0.37, rel=1e-7)


def test_a_target_that_is_reached_already_needs_no_step() -> None:
    found = plan(compile_plan(PRISM12), "twist=155")
    assert (found.status, found.n_steps) == ("found", 0)


def test_a_twist_that_begins_at_half_a_turn_is_no_rigid_motion() -> None:
    shape = {"kind": "icosahedron", "bar_length": 1.0, "prestress": 40.0}
    structure = assemble({"name": "ball", "classes": CLASSES, "shape": shape})
    pairs = {frozenset(pair) for pair in structure.connectivity[~structure.is_bar].tolist()}
    count = structure.n_nodes
    facet = next(
        (i, j, k)
        for i in range(count)
        for j in range(i)
        for k in range(j)
        if {frozenset(pair) for pair in ((i, j), (j, k), (k, i))} <= pairs
    )
    place = structure.node_position - structure.node_position.mean(axis=0)
    opposite = [int(np.linalg.norm(place + place[k], axis=1).argmin()) for k in facet]
    top, base = ("[" + ", ".join(structure.node_name[k] for k in nodes) + "]" for nodes in (opposite, facet))
    found = plan(compile_plan(limit(actuate(structure))), {f"twist({top}, {base})": 170.0}, steps=3)
    assert abs(found.target[0, 0]) == pytest.approx(180.0)
    assert found.status == "found"


def test_times_follow_from_the_slowest_actuator_of_each_step() -> None:
    structure = limit(actuate(build_prism(155.0), rate=0.002))
    found = plan(compile_plan(structure), "twist=157", steps=3)
    assert found.time is not None
    rate = np.abs(np.diff(found.change, axis=0)).max(axis=1) / np.diff(found.time)
    np.testing.assert_allclose(rate, 0.002, rtol=1e-9)
    slower = plan(compile_plan(structure), "twist=157", steps=3, duration=2 * float(found.time[-1]))
    assert slower.time is not None
    np.testing.assert_allclose(slower.time, 2 * found.time, rtol=1e-12)


def test_a_path_goes_on_where_the_progress_of_the_first_step_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Program, "find_unlimited_progress", lambda *_: 0.0)
    found = plan(compile_plan(PRISM12), "twist=160", steps=12)
    check(found, PRISM12, steps=40, least=1.0, clearance=0.002)


# Plans of rigid bars, bodies, planar scenes and both stiffness laws.


def read_example(name: str, *names: str) -> tuple[Any, Any]:
    structure, request = assemble_scene(parse_scene(tomllib.loads(list_examples()[name])))
    actuated, _ = actuate_members(structure.with_changes(inputs=()), names)
    return actuated, request


def check_points(found: PlanResult) -> None:
    assert found.status == "found", found.message
    assert found.residual.max() < 1e-9
    np.testing.assert_allclose(found.target[-1], found.goal, rtol=1e-7)


@pytest.mark.thorough
def test_rigid_bars_and_stiff_bars_have_nearly_the_same_plan() -> None:
    stiff = build_prism(155.0)
    shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "twist": 155.0}
    classes = {"bar": {"kind": "bar", "radius": 0.005}, "cable": {**CLASSES["cable"], "prestress": 1.0}}
    shape |= {"opposite_class": "cable", "node_mass": 0.1}
    rigid = assemble({"name": "prism", "classes": classes, "shape": shape})
    rigid = rigid.with_changes(rest_length=np.where(rigid.is_bar, rigid.rest_length, stiff.rest_length))
    found = plan(compile_plan(limit(actuate(rigid)), formulation="rigid_bar"), "twist=160", steps=5)
    check_points(found)
    other = plan(compile_plan(limit(actuate(stiff))), "twist=160", steps=5)
    np.testing.assert_allclose(found.change, other.change, atol=2e-4)
    np.testing.assert_allclose(found.member_tension[-1], other.member_tension[-1], rtol=0.02)


def test_constant_modulus_instead_of_constant_stiffness() -> None:
    structure = build_prism(155.0)
    modulus = structure.spring_constant * structure.rest_length
    other = structure.with_changes(spring_constant=0 * modulus, axial_stiffness=modulus)
    check_points(plan(compile_plan(limit(actuate(other))), "twist=158", steps=2))


def test_a_planar_structure_moves_a_node() -> None:
    structure, _ = read_example("planar", "cables")
    found = plan(compile_plan(structure), "d.z - c.z=0.05", steps=5)
    check_points(found)
    assert "no equilibrium" in found.warnings[0]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "target"),
    [("lin_prism", 'node_position["bar3_B", "z"]=0.35'), ("svd_tower", 'rest_length("saddle1")=0.51')],
)
def test_bodies(name: str, target: str) -> None:
    structure, request = read_example(name, "cables")
    model = compile_plan(structure, "node_position", formulation=request.formulation)
    check_points(plan(model, target, steps=5))


@pytest.mark.thorough
def test_a_settled_start_keeps_cables_taut() -> None:
    structure, _ = read_example("prism", "cables")  # with gravity and a load
    found = plan(compile_plan(structure), "tilt=40", steps=10)
    cable = ~structure.is_bar
    assert found.member_tension[:, cable].min() > -1e-6
    if found.status == "blocked":
        assert found.block is not None
        assert {item.limit for item in found.block.binding} <= {"least_tension", "least_stiffness"}
