"""URDF: every node where the scene has it, masses and inertias of bodies, refusals with the reason."""

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen import load_scene
from tensegrity_codegen.cli.verbs.examples import read_example
from tensegrity_codegen.export.export_urdf import build_urdf
from tensegrity_codegen.export.exporter import ExportSource, write_export
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.bodies import Bar, BodySystem, RigidBody
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tests.body_scenes import EVERYTHING, assemble_document, example
from tests.ground_cases import make_prism
from tests.rigid_scenes import HANGING as RODS

FloatArray = NDArray[np.float64]

RIGID = {"kind": "bar", "mass": 0.4, "radius": 0.01}
CABLE = {"kind": "cable", "spring_constant": 60.0, "rest_length": 0.5}
STICKS: dict[str, Any] = {
    "name": "sticks",
    "gravity": [0, 0, -9.81],
    "nodes": {
        "top": {"position": [1000.0, 0, 0], "anchored": True},
        "low": {"position": [1000.3, 0.1, -0.9], "mass": 0.2},
        "left": {"position": [1000.5, 0.6, -0.2], "mass": 0.1},
        "right": {"position": [1000.5, 0.6, -0.9]},
        "bob": {"position": [1001.0, 0.0, -0.5], "mass": 0.3},
    },
    "members": {
        "pendulum": {**RIGID, "nodes": ["low", "top"]},
        "stick": {**RIGID, "nodes": ["left", "right"]},
        "s1": {**CABLE, "nodes": ["low", "right"]},
        "s2": {**CABLE, "nodes": ["top", "left"]},
        "s3": {**CABLE, "nodes": ["bob", "left"]},
    },
}


def turn(rpy: FloatArray) -> FloatArray:
    """Return the rotation of roll, pitch and yaw about fixed axes."""
    (a, b, c), (sa, sb, sc) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1, 0, 0], [0, a, -sa], [0, sa, a]])
    y = np.array([[b, 0, sb], [0, 1, 0], [-sb, 0, b]])
    z = np.array([[c, -sc, 0], [sc, c, 0], [0, 0, 1]])
    found: FloatArray = z @ y @ x
    return found


def read_vector(element: Element | None, key: str) -> FloatArray:
    assert element is not None
    return np.array([float(word) for word in element.get(key, "").split()])


def find_poses(root: Element) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return position and rotation of every link with all joints at zero; each has one joint above."""
    joints = {}
    for joint in root.findall("joint"):
        child = joint.find("child")
        assert child is not None
        assert child.get("link") not in joints
        joints[child.get("link", "")] = joint
    poses: dict[str, tuple[FloatArray, FloatArray]] = {}

    def pose(link: str) -> tuple[FloatArray, FloatArray]:
        if link == "world":
            return np.zeros(3), np.eye(3)
        if link not in poses:
            joint = joints[link]
            parent = joint.find("parent")
            assert parent is not None
            place, rotation = pose(parent.get("link", ""))
            origin = joint.find("origin")
            shift, angles = read_vector(origin, "xyz"), read_vector(origin, "rpy")
            poses[link] = (place + rotation @ shift, rotation @ turn(angles))
        return poses[link]

    for link in root.findall("link"):
        pose(link.get("name", ""))
    return poses


def read_inertia(root: Element, name: str) -> tuple[float, FloatArray, FloatArray]:
    """Return mass, centre and inertia of a link in its own frame."""
    link = next(item for item in root.findall("link") if item.get("name") == name)
    mass, centre, entries = (link.find(f"inertial/{tag}") for tag in ("mass", "origin", "inertia"))
    assert mass is not None
    assert entries is not None
    letters = "xyz"
    matrix = np.array(
        [[float(entries.get(f"i{''.join(sorted(a + b))}", "")) for a in letters] for b in letters]
    )
    return float(mass.get("value", "")), read_vector(centre, "xyz"), matrix


def list_subjects() -> list[tuple[Subject, FloatArray]]:
    system, _ = assemble_document(EVERYTHING)
    tower = example("svd_tower")
    structure, _ = load_scene(STICKS)
    assert not isinstance(structure, BodySystem)
    return [
        (system, compute_node_position(system)),
        (tower, compute_node_position(tower)),
        (structure, structure.node_position),
    ]


@pytest.mark.parametrize("number", range(3))
def test_every_node_is_where_the_scene_has_it(number: int) -> None:
    subject, position = list_subjects()[number]
    root, notes = build_urdf(subject)
    poses = find_poses(root)
    for node, name in enumerate(subject.node_name):
        np.testing.assert_allclose(poses[f"{name}.node"][0], position[node], rtol=1e-14, atol=1e-12)
    names = [item.get("name") for kind in ("link", "joint") for item in root.findall(kind)]
    assert len(set(names)) == len(names)
    assert any("no springs" in note for note in notes)


def test_bodies_have_their_masses_and_inertias() -> None:
    system, _ = assemble_document(EVERYTHING)
    root, _ = build_urdf(system)
    position, poses = compute_node_position(system), find_poses(root)
    for number, body in enumerate(system.bodies):
        if isinstance(body, RigidBody):
            mass, centre, inertia = read_inertia(root, body.name)
            assert mass == body.mass
            assert not centre.any()
            np.testing.assert_allclose(inertia, np.array(body.inertia), rtol=1e-14)
        elif isinstance(body, Bar):
            mass, centre, inertia = read_inertia(root, body.name)
            assert mass == body.mass
            place, rotation = poses[body.name]
            middle = position[system.node_body == number].mean(axis=0)
            np.testing.assert_allclose(place + rotation @ centre, middle, atol=1e-12)
            np.testing.assert_allclose(np.diag(inertia)[:2], body.inertia)
    kinds = [joint.get("type") for joint in root.findall("joint")]
    held = sum(isinstance(body, Bar) and bool(body.held) for body in system.bodies)
    assert kinds.count("continuous") == 3 * held
    assert kinds.count("floating") == len(system.bodies) - held - 1


def test_a_rod_with_masses_at_its_ends_has_their_inertia() -> None:
    structure, _ = load_scene(STICKS)
    mass, centre, inertia = read_inertia(build_urdf(structure)[0], "stick")
    ends, places = np.array([0.1, 0.0]), np.array([-0.35, 0.35])
    assert mass == pytest.approx(0.5)
    middle = float(ends @ places) / 0.5
    assert abs(centre[2]) == pytest.approx(abs(middle))
    across = 0.4 * 0.7**2 / 12 + 0.4 * middle**2 + float(ends @ (places - middle) ** 2)
    assert inertia[0, 0] == pytest.approx(across)


def test_what_links_and_joints_cannot_say_is_refused_with_the_reason(tmp_path: Path) -> None:
    def change(**changes: Any) -> dict[str, Any]:
        return {**STICKS, **changes}

    members = STICKS["members"]
    elastic = {**members, "stick": {**members["stick"], "spring_constant": 1e5}}
    shared = {**members, "stick": {**members["stick"], "nodes": ["left", "low"]}}
    nodes = STICKS["nodes"]
    for scene, word in (
        (change(members=elastic), "bars with stiffness"),
        (change(members=shared), "share a node"),
        (change(nodes={**nodes, "bob": {**nodes["bob"], "anchored": "z"}}), "held on some axes"),
    ):
        with pytest.raises(FormulationError, match=word):
            build_urdf(load_scene(scene)[0])
    path = tmp_path / "prism.toml"
    path.write_text(read_example("prism"), encoding="utf-8")
    with pytest.raises(FormulationError, match="bars with stiffness"):
        write_export("urdf", ExportSource(path, *load_scene(path)), tmp_path / "prism.urdf")
    assert not (tmp_path / "prism.urdf").exists()


def test_a_rigid_body_is_a_link_with_its_inertia_and_points() -> None:
    structure, _ = load_scene(RODS)
    assert isinstance(structure, Structure)
    root, notes = build_urdf(structure)
    poses = find_poses(root)
    for body in structure.bodies:
        mass, centre, inertia = read_inertia(root, body.name)
        assert mass == pytest.approx(body.mass)
        np.testing.assert_allclose(centre, body.centre, atol=1e-15)
        np.testing.assert_allclose(inertia, body.inertia, rtol=1e-14)
        for node in body.point:
            place = poses[f"{structure.node_name[node]}.node"][0]
            np.testing.assert_allclose(place, structure.node_position[node], atol=1e-12)
    shapes = [[item[0].tag for item in link.iter("geometry")] for link in root.findall("link")]
    assert [kinds for kinds in shapes if kinds] == [["cylinder", "sphere"], ["box"]]
    assert any("2 tendons are not in the file" in note for note in notes)
    assert len(root.findall("link")) == 1 + 2 + 4  # the world, bodies, the hook and three points


@pytest.mark.peers
@pytest.mark.parametrize("number", range(3))
def test_mujoco_reads_the_file_with_its_masses(number: int) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    subject, _ = list_subjects()[number]
    root, _ = build_urdf(subject)
    model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    bodies = getattr(subject, "bodies", ())
    total = sum(body.mass for body in bodies if isinstance(body, Bar | RigidBody)) if bodies else 1.4
    assert float(model.body_mass.sum()) == pytest.approx(total, rel=1e-5)


def test_the_ground_is_named_among_the_losses() -> None:
    prism = make_prism()
    assert any("ground" in note for note in build_urdf(prism)[1])
    assert not any("ground" in note for note in build_urdf(prism.with_changes(ground=None))[1])
