import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.format import (
    UP_AXES,
    change_frame,
    find_format,
    find_formats,
    read_files,
)
from tensegrity_codegen.scene.formats.import_ntrt import import_ntrt
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, UnknownNameError
from tests.reference import ReferenceModel

ROOT = Path(__file__).resolve().parents[3]


def test_every_format_has_a_place_of_its_own_and_a_section_in_the_documentation() -> None:
    formats = find_formats()
    assert len({item.order for item in formats}) == len(formats)
    page = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
    assert [item.title for item in formats if f"import {item.example} " not in page] == []


SAMPLES = {
    "scene.json": '{"format": "tensegrity_codegen scene 1"}',
    "network.json": '{"dtype": "compas.datastructures/Network", "data": {}}',
    "structure.json": '{"nodes": {}}',
    "structure.tdf.xml": "<tdf/>",
    "model.xml": "<mujoco/>",
}


def test_every_format_finds_its_own_files(tmp_path: Path) -> None:
    for item in find_formats():
        paths = [tmp_path / name for name in item.sources]
        for path in paths:
            path.write_text(SAMPLES.get(path.name, ""), encoding="utf-8")
        assert find_format(paths) is item


def test_files_that_several_formats_could_have_are_distinguished_by_their_content(tmp_path: Path) -> None:
    for text in ("<html/>", "no xml", "<a"):
        path = tmp_path / "other.xml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InvalidValueError, match="no known format"):
            find_format([path])
    with pytest.raises(SceneError, match="cannot be read"):
        find_format([tmp_path / "missing.xml"])


def test_files_of_no_format_are_refused_with_the_formats() -> None:
    with pytest.raises(InvalidValueError) as caught:
        find_format([Path("a.step")])
    assert all(item.example in caught.value.allowed for item in find_formats())


def test_an_option_of_another_format_is_refused() -> None:
    with pytest.raises(InvalidValueError) as caught:
        read_files([Path("nodes.csv"), Path("members.csv")], pretension_scale=2.0)
    assert caught.value.where == "pretension_scale"
    assert "NTRT" in caught.value.allowed


DOCUMENT: dict[str, Any] = {
    "name": "mast",
    "gravity": [0.5, -9.81, 0.25],
    "classes": {"cable": {"kind": "cable", "axial_stiffness": 300.0, "damping": 0.3, "prestress": 4.0}},
    "nodes": {
        "foot": {"position": [0, 0, 0], "anchored": True},
        "side": {"position": [0.7, 0.1, 0.2], "anchored": "xy", "mass": 0.3, "velocity": [0, 0, 0.2]},
        "top": {"position": [0.1, 1.2, -0.3], "mass": 0.4, "velocity": [0.1, -0.2, 0.3]},
    },
    "members": {
        "bar": {
            "kind": "bar",
            "nodes": ["foot", "top"],
            "spring_constant": 2e4,
            "density": 700,
            "radius": 0.01,
            "inner_radius": 0.004,
            "rest_length": 1.2,
        },
        "rope": {"class": "cable", "nodes": ["top", "side"]},
        "stop": {
            "kind": "bar",
            "nodes": ["foot", "side"],
            "spring_constant": 500.0,
            "switch_elongation": 0.01,
            "stiffness_ratio": 2.0,
            "rest_length": 0.7,
        },
    },
    "loads": [{"node": "top", "force": [1.0, 2.0, 3.0]}],
    "inputs": [{"kind": "force", "name": "wind", "nodes": ["top"], "direction": [0.0, 0.6, 0.8]}],
    "actuators": [{"name": "winch", "members": "rope", "rate": 0.1, "range": [0.5, 2.0]}],
    "sensors": [{"kind": "member_tension", "members": "rope", "noise": 0.5}],
    "limits": {
        "least_tension": 1.0,
        "yield_stress": 1e8,
        "clearance": 0.01,
        "members": {"rope": {"most_tension": 90.0}},
    },
}
ROTATIONS = {
    "x": np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "z": np.eye(3, dtype=int),
}


def build(document: Any) -> Structure:
    return assemble(parse_scene(document))[0]


def acceleration(structure: Structure) -> NDArray[np.float64]:
    """Accelerations of the nodes at the start, by the plain NumPy model; 0 on held axes."""
    places = structure.coordinate_node_axis
    at = {
        "coordinate": structure.node_position[places[:, 0], places[:, 1]],
        "velocity": structure.node_velocity[places[:, 0], places[:, 1]],
    }
    found = np.zeros((structure.n_nodes, 3))
    found[places[:, 0], places[:, 1]] = ReferenceModel(structure).compute("acceleration", **at)
    return found


@pytest.mark.parametrize("up", UP_AXES)
def test_rotations_are_proper_and_bring_the_axis_up(up: str) -> None:
    matrix = ROTATIONS[up]
    assert round(float(np.linalg.det(matrix))) == 1
    assert (matrix @ np.eye(3)["xyz".index(up)]).tolist() == [0, 0, 1]
    turned, _ = change_frame(DOCUMENT, up)
    for name, node in DOCUMENT["nodes"].items():
        assert turned["nodes"][name]["position"] == (matrix @ node["position"]).tolist()


@pytest.mark.parametrize(("up", "scale"), list(itertools.product(UP_AXES, (1.0, 0.1, 25.4))))
def test_the_motion_is_the_same_in_the_new_axes_and_unit(up: str, scale: float) -> None:
    old, matrix = build(DOCUMENT), ROTATIONS[up]
    document, notes = change_frame(DOCUMENT, up, scale)
    new = build(document)
    np.testing.assert_allclose(new.node_position, scale * old.node_position @ matrix.T, rtol=1e-14)
    np.testing.assert_allclose(new.node_velocity, scale * old.node_velocity @ matrix.T, rtol=1e-14)
    np.testing.assert_array_equal(new.node_anchored, old.node_anchored @ abs(matrix).T > 0)
    np.testing.assert_allclose(new.rest_length, scale * old.rest_length, rtol=1e-13)
    np.testing.assert_allclose(new.member_mass, old.member_mass, rtol=1e-13)
    np.testing.assert_allclose(new.mu, old.mu, rtol=1e-13)
    np.testing.assert_allclose(new.static_tension(), scale * old.static_tension(), rtol=1e-9, atol=1e-12)
    wanted = scale * acceleration(old) @ matrix.T
    np.testing.assert_allclose(acceleration(new), wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_allclose(new.inputs[0].direction, matrix @ old.inputs[0].direction)
    assert new.actuators[0].rate == pytest.approx(scale * 0.1)
    assert new.sensors[0].noise == pytest.approx(scale * 0.5)
    assert new.limits.clearance == pytest.approx(scale * 0.01)
    assert new.limits.most_tension[1] == pytest.approx(scale * 90)
    assert new.limits.yield_stress[0] == pytest.approx(1e8 / scale)
    assert len(notes) == (up != "z") + (scale != 1.0)


def test_planar_scenes_keep_to_their_plane() -> None:
    nodes = {
        "a": {"position": [0, 1], "anchored": True},
        "b": {"position": [2, 3], "anchored": "y", "mass": 1.0},
    }
    rope = {"kind": "cable", "nodes": ["a", "b"], "spring_constant": 9.0}
    planar = {"name": "flat", "axes": "xy", "gravity": [0, -9.81], "nodes": nodes, "members": {"rope": rope}}
    turned = build(change_frame(planar, "y", 0.5)[0])
    assert turned.axes == (0, 2)
    assert turned.gravity.tolist() == [0, 0, -9.81 * 0.5]
    assert turned.node_position.tolist() == [[0, 0, 0.5], [1, 0, 1.5]]
    assert turned.coordinate_node_axis.tolist() == [[1, 0]]


@pytest.mark.parametrize(
    ("up", "scale", "error"),
    [("w", 1.0, UnknownNameError), ("", 1.0, UnknownNameError)]
    + [("y", value, InvalidValueError) for value in (0.0, -1.0, float("nan"), float("inf"), 1e-200)],
)
def test_other_axes_and_scales_are_refused(up: str, scale: float, error: type[Exception]) -> None:
    with pytest.raises(error):
        change_frame(DOCUMENT, up, scale)


def test_shapes_are_refused_by_name() -> None:
    with pytest.raises(InvalidValueError) as caught:
        change_frame({"name": "a", "shape": {"kind": "prism"}}, "y", 1.0, "a.json")
    assert caught.value.where == "a.json: shape"


STICKS = {
    "nodes": {"low1": [0, 0, 0], "high1": [0, 20, 0], "low2": [10, 0, 3], "high2": [10, 20, 0]},
    "pair_groups": {
        "rod": [["low1", "high1"], ["low2", "high2"]],
        "string": [["low1", "low2"], ["high1", "high2"]],
    },
    "builders": {
        "rod": {"class": "tgRodInfo", "parameters": {"density": 0.5, "radius": 0.1}},
        "string": {
            "class": "tgBasicActuatorInfo",
            "parameters": {"stiffness": 1000, "damping": 10, "pretension": 500},
        },
    },
}


def test_the_general_scale_is_that_of_the_toolkit(tmp_path: Path) -> None:
    path = tmp_path / "sticks.yaml"
    path.write_text(yaml.safe_dump(STICKS, sort_keys=False), encoding="utf-8")
    one = build(read_files([path], scale=0.1).document)
    own = build(import_ntrt(path, length_scale=0.1).document)
    for name in ("node_position", "rest_length", "member_mass", "radius", "damping", "mu"):
        np.testing.assert_allclose(getattr(one, name), getattr(own, name), rtol=1e-12)
