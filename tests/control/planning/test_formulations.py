"""Plans of rigid bars, bodies, planar scenes and both stiffness laws."""

import tomllib
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.cli.scene_files import list_examples
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.actuate import actuate_members
from tests.control.planning.structures import CLASSES, actuate, assemble, build_prism, compile_plan, limit


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
    check_points(plan(compile_plan(limit(actuate(other))), "twist=160", steps=5))


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


def test_a_settled_start_keeps_cables_taut() -> None:
    structure, _ = read_example("prism", "cables")  # with gravity and a load
    found = plan(compile_plan(structure), "tilt=40", steps=10)
    cable = ~structure.is_bar
    assert found.member_tension[:, cable].min() > -1e-6
    if found.status == "blocked":
        assert found.block is not None
        assert {item.limit for item in found.block.binding} <= {"least_tension", "least_stiffness"}
