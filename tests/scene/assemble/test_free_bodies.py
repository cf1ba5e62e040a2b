"""Rigid bodies beside nodes and members: masses and inertias of parts, places, names, and what is refused."""

import copy
import math
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import SceneError
from tensegrity_codegen.tables.body_places import compute_spins, place_bodies


def scene(**body: Any) -> dict[str, Any]:
    """Return a scene of one body on a cable from an anchored node."""
    table = {"kind": "rigid", "mass": 2.0, "inertia": [2e-3, 3e-3, 4e-3], "position": [0.1, 0.2, 0.3]}
    table |= {"points": {"tip": [0.0, 0.1, 0.2]}} | body
    table = {key: value for key, value in table.items() if value is not None}
    cable = {"kind": "cable", "nodes": ["roof", "rod.tip"], "spring_constant": 10.0, "rest_length": 1.0}
    return {
        "name": "hanging",
        "gravity": [0, 0, -9.81],
        "nodes": {"roof": {"position": [0, 0, 2], "anchored": True}},
        "bodies": {"rod": table},
        "members": {"cable": cable},
    }


def assemble(document: dict[str, Any]) -> Structure:
    structure, _ = assemble_scene(parse_scene(document), "hanging.toml")
    assert isinstance(structure, Structure)
    return structure


def moments(structure: Structure) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre and inertia about it (3, 3), in the world, of the masses at the corners."""
    corner = list(structure.bodies[0].corner)
    mass, position = structure.node_mass[corner], structure.node_position[corner]
    centre = mass @ position / mass.sum()
    arm = position - centre
    inertia = np.einsum("k,k,ij->ij", mass, (arm**2).sum(axis=1), np.eye(3))
    return mass.sum(), centre, inertia - np.einsum("k,ki,kj->ij", mass, arm, arm)


@pytest.mark.parametrize(
    "inertia",
    [
        [2e-3, 3e-3, 4e-3],
        [4e-3, 4e-3, 4e-3],  # a ball
        [1e-3, 2e-3, 3e-3],  # flat
        [3.8e-3, 3.8e-3, 3.4e-5],  # a rod
        [[2e-3, 1e-4, -2e-4], [1e-4, 3e-3, 3e-4], [-2e-4, 3e-4, 2.5e-3]],
    ],
)
def test_corners_have_the_mass_centre_and_inertia_of_the_body(inertia: list[Any]) -> None:
    turn = [math.cos(0.4), 0.0, math.sin(0.4), 0.0]
    structure = assemble(scene(inertia=inertia, quaternion=turn, centre_of_mass=[0.01, -0.02, 0.03]))
    mass, centre, about = moments(structure)
    stated = np.array(inertia) if np.ndim(inertia[0]) else np.diag(inertia)
    ((origin, axes),) = zip(*place_bodies(structure.body_places, structure.node_position), strict=True)
    assert mass == pytest.approx(2.0, rel=1e-14)
    assert centre == pytest.approx(origin, abs=1e-15)
    assert axes == pytest.approx(
        np.array([[math.cos(0.8), 0, math.sin(0.8)], [0, 1, 0], [-math.sin(0.8), 0, math.cos(0.8)]])
    )
    assert about == pytest.approx(axes @ stated @ axes.T, abs=2e-12 * np.abs(stated).max())
    assert structure.node_position[structure.node_name.index("rod_tip")] == pytest.approx(
        np.array([0.1, 0.2, 0.3]) + axes @ [0.0, 0.1, 0.2], abs=1e-15
    )


def test_parts_give_mass_centre_and_inertia() -> None:
    # A cylinder (3 r^2 + l^2) / 12, a ball 2/5 r^2 at its end, a box and a tube about the same axis.
    parts = [
        {"kind": "cylinder", "radius": 0.1, "from": [0, 0, -1], "to": [0, 0, 1], "mass": 3.0},
        {"kind": "ball", "radius": 0.2, "position": [0, 0, 1], "mass": 1.0},
        {"kind": "box", "size": [0.2, 0.3, 0.4], "density": 500.0},
        {"kind": "tube", "radius": 0.2, "inner_radius": 0.1, "from": [0, 0, 0], "to": [0, 0, 1], "mass": 2.0},
    ]
    structure = assemble(scene(mass=None, inertia=None, parts=parts))
    body = structure.bodies[0]
    box = 500 * 0.2 * 0.3 * 0.4
    centre = (1.0 + 2.0 * 0.5) / (6.0 + box)
    across = 3 * (3 * 0.01 + 4) / 12 + 3 * centre**2 + 0.4 * 0.04 + (1 - centre) ** 2
    across += box * centre**2 + 2 * (3 * 0.05 + 1) / 12 + 2 * (0.5 - centre) ** 2
    about = 3 * 0.01 / 2 + 0.4 * 0.04 + box * (0.04 + 0.09) / 12 + 2 * 0.05 / 2
    assert body.mass == pytest.approx(6.0 + box)
    assert body.centre == pytest.approx([0, 0, centre])
    inertia = np.diag([across + box * (0.09 + 0.16) / 12, across + box * (0.04 + 0.16) / 12, about])
    assert body.inertia == pytest.approx(inertia, abs=1e-14)


def test_a_capsule_of_length_zero_has_the_inertia_of_a_ball() -> None:
    capsule = {"kind": "capsule", "radius": 0.1, "from": [0, 0, 0], "to": [0, 0, 1e-9], "density": 100.0}
    body = assemble(scene(mass=None, inertia=None, parts=[capsule])).bodies[0]
    mass = 100 * 4 / 3 * math.pi * 1e-3
    assert body.mass == pytest.approx(mass, rel=1e-7)
    assert body.inertia == pytest.approx(0.4 * mass * 0.01 * np.eye(3), rel=1e-7, abs=1e-12)


PLACES = {
    "quaternion": {"quaternion": [2.0, 0.0, 0.0, 2.0]},
    "axis": {"axis": [0, 0, 3], "angle_deg": 90.0},
    "matrix": {"matrix": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]},
}


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_a_quarter_turn_about_z_is_said_in_three_ways(place: dict[str, Any]) -> None:
    structure = assemble(scene(**place))
    tip = structure.node_position[structure.node_name.index("rod_tip")]
    assert tip == pytest.approx([0.1 - 0.1, 0.2, 0.5], abs=1e-15)


def test_two_points_give_the_origin_and_the_z_axis() -> None:
    structure = assemble(scene(position=None, **{"from": [1, 0, 0], "to": [3, 0, 0]}))
    centre, axes = place_bodies(structure.body_places, structure.node_position)
    assert centre[0] == pytest.approx([2, 0, 0])
    assert axes[0] == pytest.approx(np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), abs=1e-14)


def test_velocities_are_those_of_the_centre_and_of_the_frame() -> None:
    structure = assemble(
        scene(centre_velocity=[1, 2, 3], angular_velocity=[4, 5, 6], axis=[1, 0, 0], angle_deg=90)
    )
    tip = structure.node_velocity[structure.node_name.index("rod_tip")]
    # The frame turns (x, y, z) to (x, -z, y): omega = (4, -6, 5), arm (0, -0.2, 0.1).
    assert tip == pytest.approx(np.array([1, 2, 3]) + np.cross([4, -6, 5], [0, -0.2, 0.1]))
    spin = compute_spins(structure.body_places, structure.node_position, structure.node_velocity)
    assert spin[0] == pytest.approx([4, 5, 6])


def test_a_structure_is_written_as_a_scene_and_read_back() -> None:
    parts = [
        {"kind": "box", "size": [0.1, 0.2, 0.3], "quaternion": [0.8, 0.6, 0.0, 0.0]},
        {"kind": "tube", "radius": 0.2, "inner_radius": 0.1, "from": [0, 0, 0], "to": [0, 1, 0]},
    ]
    body = {"parts": parts, "quaternion": [0.8, 0.0, 0.6, 0.0], "angular_velocity": [1, 2, 3]}
    before = assemble(scene(**body) | {"sensors": [{"kind": "angular_velocity", "bodies": "all"}]})
    after = assemble(describe_structure(before))
    assert after.node_name == before.node_name
    assert after.member_name == before.member_name
    assert after.node_position == pytest.approx(before.node_position, abs=1e-15)
    assert after.node_velocity == pytest.approx(before.node_velocity, abs=1e-14)
    assert after.sensors == before.sensors
    for old, new in zip(before.bodies[0].parts, after.bodies[0].parts, strict=True):
        assert (new.kind, new.size) == (old.kind, pytest.approx(old.size))
        assert new.position == pytest.approx(old.position, abs=1e-15)
        assert np.abs(new.axes[:, 2]) == pytest.approx(np.abs(old.axes[:, 2]), abs=1e-14)


def test_several_members_may_join_the_same_points() -> None:
    document = scene()
    document["bodies"]["other"] = copy.deepcopy(document["bodies"]["rod"]) | {"position": [1, 0, 0]}
    for name in ("a", "b"):
        document["members"][name] = document["members"]["cable"] | {"nodes": ["rod.tip", "other.tip"]}
    assert assemble(document).connectivity[1].tolist() == assemble(document).connectivity[2].tolist()


REFUSED: dict[str, tuple[dict[str, Any], str, str]] = {
    "triangle": ({"inertia": [1e-3, 1e-3, 3e-3]}, "inertia", "above the sum"),
    "zero mass": ({"mass": 0.0}, "mass", "above 0"),
    "negative mass": ({"mass": -1.0}, "mass", "above 0"),
    "no mass": ({"mass": None}, "mass", "without mass"),
    "no inertia": ({"inertia": None}, "inertia", "without inertia"),
    "thin": ({"inertia": [1e-3, 1e-3, 1e-15]}, "inertia", "about an axis"),
    "mass twice": ({"parts": [{"kind": "ball", "radius": 0.1, "mass": 1.0}]}, "mass", "twice"),
    "no part of this kind": ({"parts": [{"kind": "cone"}]}, "parts[0].kind", "words"),
    "short of a radius": ({"parts": [{"kind": "ball", "mass": 1.0}]}, "parts[0].radius", "needs"),
    "zero quaternion": ({"quaternion": [0, 0, 0, 0]}, "quaternion", "length zero"),
    "two orientations": ({"quaternion": [1, 0, 0, 0], "axis": [0, 0, 1], "angle_deg": 1.0}, "axis", "twice"),
    "half of a pair": ({"axis": [0, 0, 1]}, "angle_deg", "belong together"),
    "left-handed": ({"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "matrix", "no rotation"),
    "no place": ({"position": None}, "position", "one position"),
    "two places": ({"centre": [0, 0, 0]}, "centre", "one position"),
    "angles": ({"psi_deg": 1.0}, "psi_deg", "no Euler angles"),
}


@pytest.mark.parametrize(("change", "key", "problem"), REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_in_a_body_is_refused_by_its_key(
    change: dict[str, Any], key: str, problem: str
) -> None:
    with pytest.raises(SceneError) as caught:
        assemble(scene(**change))
    assert f"bodies.rod.{key}" in caught.value.where
    assert problem in caught.value.problem


LOOSE = {"kind": "cable", "nodes": ["roof", "rod.top"], "spring_constant": 1.0}
HEAVY = {"kind": "bar", "nodes": ["roof", "rod.tip"], "spring_constant": 1.0, "mass": 1.0}
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown point": ({"members": {"c": LOOSE}}, "members.c.nodes"),
    "no contact radius": ({"ground": {"stiffness": 1e4}}, "bodies.rod.points"),
    "unknown contact": ({"ground": {"stiffness": 1e4, "contacts": ["rod.top"]}}, "ground.contacts[0]"),
    "a name taken": ({"nodes": {"rod_tip": {"position": [0, 0, 2]}}}, "bodies.rod.points.tip"),
    "a heavy bar": ({"members": {"c": HEAVY}}, "members.c.mass"),
    "a plane": ({"axes": "xz"}, "axes"),
    "tendons": ({"tendons": {"t": {"points": ["rod.tip", "rod.tip"], "spring_constant": 1.0}}}, "nodes"),
    "an unknown gyro": ({"sensors": [{"kind": "angular_velocity", "bodies": ["a"]}]}, "sensors[0].bodies"),
}


@pytest.mark.parametrize(("change", "key"), WRONG.values(), ids=WRONG)
def test_what_does_not_go_with_a_body_is_refused(change: dict[str, Any], key: str) -> None:
    with pytest.raises(SceneError) as caught:
        assemble(scene() | change)
    assert caught.value.where == f"hanging.toml: {key}"
