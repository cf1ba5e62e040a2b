"""Equilibria on the ground, against closed forms, motions that come to rest, and turned copies."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
from tensegrity_codegen.runtime.statics.equilibrium import equilibrium_quantities, find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.on_ground import Feet
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import ConvergenceError
from tests.cases import thorough
from tests.ground_cases import (
    GRAVITY,
    make_belt,
    make_block,
    make_ground,
    make_icosahedron,
    make_prism,
    make_rod,
    make_slope,
)
from tests.models import load, simulator
from tests.runtime.build import bar, make_structure

Array = NDArray[np.float64]


def build(structure: Structure, *more: str, **request: Any) -> CompiledModel:
    formulation = "rigid_bar" if structure.is_rigid.any() else "node_position"
    names = (*equilibrium_quantities(formulation), *more)
    return load(structure, *names, formulation=formulation, **request)


def settle(structure: Structure, **options: Any) -> tuple[Equilibrium, Feet]:
    found = find_equilibrium(build(structure), raise_on_failure=False, **options)
    assert found.feet is not None
    return found, found.feet


def tilt(structure: Structure, degrees: float, **ground: Any) -> Structure:
    """Return a structure whose weight is turned as that on a slope is."""
    angle = np.radians(degrees)
    weight = GRAVITY * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    assert structure.ground is not None
    return structure.with_changes(gravity=weight, ground=replace(structure.ground, **ground))


def make_elastic(structure: Structure) -> Structure:
    """Return a structure with elastic bars, whose equilibria are found sooner than with rigid ones."""
    return structure.with_changes(spring_constant=np.where(structure.is_bar, 1e5, structure.spring_constant))


def test_a_block_on_a_slope_is_off_by_its_weight_over_the_stiffness() -> None:
    slope, down = make_slope(np.radians(20.0))
    found, feet = settle(slope)
    offset = GRAVITY * np.sin(np.radians(20.0)) / 1e5  # m g sin / kt
    assert found.node_position[0] @ down == pytest.approx(offset, rel=1e-12)
    np.testing.assert_allclose(feet.force, [[0.0, 0.0, GRAVITY]], atol=1e-12)
    assert feet.state == ("stick",)
    assert np.linalg.norm(feet.internal) == pytest.approx(offset, rel=1e-12)


def test_a_block_slides_on_a_slope_that_is_steeper_than_friction() -> None:
    with pytest.raises(ConvergenceError, match="feet n0 slip") as caught:
        find_equilibrium(build(make_slope(np.radians(30.0))[0]))
    assert caught.value.evidence["status"] == "slides"


@pytest.mark.parametrize(
    ("spring_constant", "stiffness"), [(1e7, 1e8), (1e9, 1e8), *thorough((1e6, 1e8), (1e9, 1e6), (1e8, 1e9))]
)
def test_stiff_frames_stand_on_stiff_ground(spring_constant: float, stiffness: float) -> None:
    """Rounding keeps the residual of such frames above the tolerance of 1e-9 of the largest member force."""
    ends = [(0, 2), (1, 2), (0, 1)]
    place = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.8]]
    bars = [
        bar(i, j, float(np.hypot(*np.subtract(place[i], place[j])[::2])), spring_constant) for i, j in ends
    ]
    frame = make_structure(place, bars, gravity=(0.0, 0.0, -GRAVITY), axes="xz", mass=[1.0, 1.0, 2.0])
    ground = make_ground(3, stiffness=stiffness, stick_stiffness=stiffness, friction=0.6)
    found, feet = settle(frame.with_changes(ground=ground))
    assert found.status in ("converged", "rounding_limited")
    thrust = GRAVITY * 0.5 / 0.8 / (1 + 2 * spring_constant / stiffness)  # what the lower bar does not take
    assert feet.force[:2, 2] == pytest.approx(2 * GRAVITY, rel=1e-7)
    assert feet.force[:2, 0] == pytest.approx([thrust, -thrust], rel=50.0 / spring_constant)  # strains


def test_a_search_that_runs_out_of_iterations_does_not_say_that_the_structure_tips() -> None:
    """Its three feet are a millimetre apart in height: one touches first, and it stands in the end.

    A guide holds one node along x, so that it does not turn onto its feet before.
    """
    prism = make_elastic(make_prism())
    place = prism.node_position + np.outer([0.0, 1e-3, 2e-3, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    guide = np.zeros((6, 3), dtype=bool)
    guide[3, 0] = True
    model = build(prism.with_changes(node_position=place, node_anchored=guide))
    short = find_equilibrium(model, max_iterations=1, raise_on_failure=False)
    assert (short.status, short.message) == (
        "iteration_limit",
        "no convergence within the allowed iterations",
    )
    assert find_equilibrium(model, raise_on_failure=False).is_found


@pytest.mark.parametrize("degrees", [0.2, 3.0, 12.0])
def test_a_structure_that_is_let_down_on_one_foot_stands_on_three(degrees: float) -> None:
    """Turned by up to 15 degrees it falls back onto its facet, in the shape that it has there."""
    prism = make_elastic(make_prism())
    level, _ = settle(prism)
    turn = Rotation.from_euler("xz", [degrees, 25.0], degrees=True).as_matrix()
    found, feet = settle(prism.with_changes(node_position=prism.node_position @ turn.T))
    assert found.is_found
    assert feet.state[:3] == ("stick",) * 3
    assert found.member_tension == pytest.approx(level.member_tension, rel=1e-6)


def test_a_block_above_the_ground_rests_on_it() -> None:
    found, feet = settle(make_block([0.3, 0.2, 0.5]))
    assert feet.penetration[0] == pytest.approx(GRAVITY / 1e5, rel=1e-12)
    np.testing.assert_allclose(found.node_position[0, :2], [0.3, 0.2], atol=1e-15)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_an_icosahedron_stands_on_a_facet(exponent: float) -> None:
    """The centre is that of the motion which settles there (p = 1)."""
    ico = tilt(make_icosahedron(), 0.0, exponent=exponent)
    found, feet = settle(ico)
    closed = feet.penetration > 0
    np.testing.assert_allclose(feet.force[closed], np.tile([0.0, 0.0, 1.962], (3, 1)), atol=1e-11)
    assert found.neutral_motion_names == ("slide along x", "slide along y", "turn about z")
    if exponent == 1.0:
        assert found.node_position[:, 2].mean() == pytest.approx(0.2083229558, abs=6e-11)
        assert found.smallest_eigenvalue > 1.0


def test_an_equilibrium_with_friction_is_at_rest() -> None:
    """A motion from its coordinates and bristles does not move."""
    prism = tilt(make_prism(), 10.0)
    found, feet = settle(prism, tolerance=1e-13)
    assert "slip" not in feet.state
    model = simulator(prism, "rk853", formulation="rigid_bar")
    bristles = {"internal": feet.internal}
    start = found.coordinate
    motion = simulate(model, 0.2, samples=2, method="rk853", coordinate=start, arguments=bristles)
    assert np.abs(motion.velocity[-1]).max() < 1e-10
    np.testing.assert_allclose(motion.coordinate[-1], found.coordinate, atol=1e-11)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_turned_and_renumbered_copies_rest_alike(friction: float) -> None:
    found, feet = settle(make_prism(friction=friction))
    assert set(feet.state[:3]) == {"slip" if friction == 0.2 else "stick"}
    limit = friction * feet.force[:, 2]
    assert np.all(np.linalg.norm(feet.force[:, :2], axis=1) <= limit * (1 + 1e-12))
    order = np.array([3, 0, 5, 1, 2, 4])
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    copy, other = settle(make_prism(turn, order, friction=friction))
    np.testing.assert_allclose(copy.node_position, (found.node_position @ turn.T)[order], atol=1e-12)
    np.testing.assert_allclose(other.force, (feet.force @ turn.T)[order], atol=1e-11)


@pytest.mark.parametrize("rigid", [False, *thorough(True)])
def test_feet_that_slip_state_what_twice_the_steps_change(rigid: bool) -> None:
    prism = make_prism(friction=0.35)
    found, feet = settle(tilt(prism if rigid else make_elastic(prism), 10.0))
    assert feet.state[:3] == ("slip", "stick", "stick")
    assert 0.0 < feet.change < 1e-8
    assert found.message.startswith("feet slip on the way, and the forces of feet depend on the steps")


def test_what_tips_or_slides_is_no_equilibrium() -> None:
    rough = {"friction": 0.5, "stick_stiffness": 2e4, "stick_damping": 20.0}
    over, _ = settle(tilt(make_icosahedron(), 40.0, **rough))
    assert (over.status, over.is_found) == ("tips", False)
    assert "edge between" in over.message
    away, _ = settle(tilt(make_icosahedron(), 10.0))
    assert away.status == "slides"
    fallen, _ = settle(make_elastic(make_rod()))
    assert fallen.status == "tips"
    turned = re.fullmatch(r"tips over: it turns by ([\d.]+) degrees before it rests", fallen.message)
    assert turned is not None  # by how much depends on which way rounding lets it fall
    assert float(turned[1]) > 30.0
    up, _ = settle(make_icosahedron().with_changes(gravity=np.array([0.0, 0.0, 1.0])))
    assert up.status == "lifts_off"


@pytest.mark.thorough
def test_a_rigid_rod_tips_too() -> None:
    fallen, _ = settle(make_rod())
    assert fallen.status == "tips"
    turned = re.fullmatch(r"tips over: it turns by ([\d.]+) degrees before it rests", fallen.message)
    assert turned is not None  # by how much depends on which way rounding lets it fall
    assert float(turned[1]) > 30.0


def test_frictionless_leaves_friction_out() -> None:
    found, feet = settle(make_prism(), frictionless=True)
    assert feet.state[:3] == ("slide",) * 3
    assert not feet.force[:, :2].any()
    assert not feet.internal.any()
    assert len(found.neutral_motion_names) == 3


def test_a_belt_drags_what_is_held() -> None:
    """x = mu N / k (the spring holds it), 0.4 * 10 N / (100 N/m)."""
    found, feet = settle(make_belt(0.2))
    assert found.node_position[0, 0] == pytest.approx(0.04, rel=1e-12)
    np.testing.assert_allclose(feet.force, [[4.0, 0.0, 10.0]], atol=1e-12)
    assert feet.state == ("slip",)


def test_a_belt_carries_what_is_free() -> None:
    belt = np.array([0.1, 0.0, 0.0])
    found, _ = settle(make_prism(velocity=belt))
    rest, _ = settle(make_prism())
    np.testing.assert_allclose(found.node_position, rest.node_position, atol=1e-14)
    assert "belt" in found.message


def test_many_equilibria_are_those_of_each_alone() -> None:
    """A prism pushed harder and harder; the last load tips it, and disturbs no other case."""
    prism = make_prism(friction=0.5)
    prism = prism.with_changes(node_position=prism.node_position - [0.0, 0.0, 0.5])
    model = build(prism, parameters={"node_load": (3,)})
    loads = np.array([[[0.0, 0.0, 0.0]], [[0.2, 0.0, 0.0]], [[20.0, 0.0, 0.0]]])
    found = find_equilibria(model, arguments={"node_load": loads})
    assert found.status[:2] == ("converged",) * 2
    assert found.status[2] in ("tips", "slides", "no_equilibrium")
    for k in range(2):
        alone = find_equilibrium(model, arguments={"node_load": loads[k]})
        np.testing.assert_array_equal(found.node_position[k], alone.node_position)


def test_feet_at_one_place_with_a_slack_cable_between_them() -> None:
    """A frame, and a weight at its left foot: each sinks in by itself, and the cable stays slack."""
    place = {"left": [0.0, 0.0], "weight": [0.0, 0.0], "right": [1.0, 0.0], "top": [0.5, 1.0]}
    mass = {"left": 1.0, "weight": 2.0, "right": 1.0, "top": 2.0}
    bar = {"kind": "bar", "spring_constant": 1e5}
    ends = {"base": ["left", "right"], "west": ["left", "top"], "east": ["right", "top"]}
    link = {"kind": "cable", "spring_constant": 100.0, "rest_length": 0.5, "nodes": ["left", "weight"]}
    scene = {
        "name": "folded",
        "axes": "xz",
        "gravity": [0.0, -9.81],
        "nodes": {name: {"position": place[name], "mass": mass[name]} for name in place},
        "members": {name: bar | {"nodes": pair} for name, pair in ends.items()} | {"link": link},
        "ground": {"stiffness": 1e4, "friction": 0.5},
    }
    model = compile_scene(scene, for_=("equilibrium", "simulate"))
    found = find_equilibrium(model)
    assert (found.status, found.tension("link")) == ("converged", 0.0)
    for node in ("left", "weight", "right"):  # each carries 2 kg
        assert found.position(node)[2] == pytest.approx(-2 * 9.81 / 1e4, abs=1e-9)
    start = {"coordinate": found.coordinate, "arguments": found.internal_argument}
    motion = simulate(model, 0.01, samples=3, **start)
    assert motion.status == "ok"
    np.testing.assert_allclose(motion.node_position[-1], found.node_position, atol=1e-8)
