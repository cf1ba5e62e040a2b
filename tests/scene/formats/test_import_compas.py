"""Networks of COMPAS, of both versions, and wrong ones named by their place."""

import json
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    StructureError,
    UnknownNameError,
)

NODES: dict[str, Any] = {
    "0": {"x": 0, "y": 0, "z": 0, "is_anchor": True, "rx": 3.0},
    "1": {"x": 2.0, "y": 0, "z": 0, "px": 1.0, "pz": -2.0, "mass": 0.4},
    "2": {"x": 1.0, "y": 1.0, "z": None, "is_fixed": True, "colour": "red"},
}
EDGES: dict[str, Any] = {
    "0": {"1": {"q": -2.0, "EA": 1e6, "radius": 0.01, "density": 2000}},
    "1": {"2": {"q": 3.0, "E": 2e11, "A": 1e-6}},
    "2": {"0": {"kind": "tie", "l0": 1.2, "k": 500.0, "name": "stay"}},
}


def load(tmp_path: Path, content: Any, **options: Any) -> ImportResult:
    path = tmp_path / "network.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return read_files([path], **options)


def whole(**data: Any) -> dict[str, Any]:
    content = {"node": NODES, "edge": EDGES, "max_node": 2, **data}
    return {"dtype": "compas.datastructures/Network", "data": content}


@pytest.mark.parametrize(
    "content",
    [
        whole(),
        {"dtype": "compas.datastructures/Graph", "data": {"node": NODES, "edge": EDGES}, "name": "g"},
        {"datatype": "compas_fofin.datastructures/CableNetwork", "data": {"node": NODES, "edge": EDGES}},
        {"node": NODES, "edge": EDGES, "dna": {"x": 0.0}, "dea": {"q": None}},
    ],
)
def test_nodes_and_edges_become_a_scene(content: Any, tmp_path: Path) -> None:
    result = load(tmp_path, content, gravity=[0, 0, -9.81])
    structure, _ = assemble(parse_scene(result.document))
    assert structure.node_name == ("n0", "n1", "n2")
    assert structure.member_name == ("m0_1", "m1_2", "stay")
    assert structure.is_bar.tolist() == [True, False, False]
    assert structure.static_tension()[:2].tolist() == pytest.approx([-4.0, 3 * 2**0.5])
    assert structure.axial_stiffness.tolist() == pytest.approx([1e6, 2e5, 0])
    assert (structure.rest_length[2], structure.spring_constant[2]) == (1.2, 500.0)
    assert structure.node_anchored.all(axis=1).tolist() == [True, False, True]
    assert structure.node_load[1].tolist() == [1.0, 0.0, -2.0]
    assert structure.node_mass[1] == 0.4
    assert any("colour (1)" in note for note in result.notes)


def test_keys_of_version_1_are_python_literals(tmp_path: Path) -> None:
    nodes = {"'a b'": {"x": 0, "y": 0, "z": 0}, "(1, 2)": {"x": 1, "y": 0, "z": 0}}
    edges = {"'a b'": {"(1, 2)": {"f": 2.0, "k": 10.0}}}
    document = load(tmp_path, whole(node=nodes, edge=edges)).document
    assert list(document["nodes"]) == ["a_b", "n1_2"]


@pytest.mark.parametrize(("twin", "names"), [("0x1", ["n0", "n1", "n0x1"]), ("'1'", ["n0", "n1", "n1_2"])])
def test_keys_that_stand_for_one_name_stay_two_nodes(twin: str, names: list[str], tmp_path: Path) -> None:
    nodes = {"0": {"is_anchor": True}, "1": {"x": 1, "mass": 2}, twin: {"x": 1, "y": 5, "mass": 7}}
    edges = {"0": {"1": {"q": 1, "EA": 5}, twin: {"q": 1, "EA": 5}}}
    result = load(tmp_path, whole(node=nodes, edge=edges))
    assert list(result.document["nodes"]) == names
    assert [node.get("mass") for node in result.document["nodes"].values()] == [None, 2.0, 7.0]
    assert [member["nodes"] for member in result.document["members"].values()] == [
        [names[0], name] for name in names[1:]
    ]
    assert any(repr(twin) in note for note in result.notes)


@pytest.mark.parametrize("own", [{}, {"edgedata": {}, "facedata": {}}])
def test_a_mesh_of_version_0_is_refused_as_one(own: dict[str, Any], tmp_path: Path) -> None:
    vertices = {key: {"x": 0.0, "y": 0.0, "z": 0.0} for key in "012"}
    with pytest.raises(InvalidValueError, match="not a network") as caught:
        load(tmp_path, {"attributes": {}, "dva": {}, "vertex": vertices, "face": {"0": [0, 1, 2]}, **own})
    assert "vertex, face" in caught.value.given
    assert "Graph.from_lines(mesh.to_lines())" in caught.value.hint


def test_attributes_that_are_not_named_are_counted(tmp_path: Path) -> None:
    nodes = NODES | {"0": NODES["0"] | {f"a{k}": 1.0 for k in range(23)}}
    (note,) = [note for note in load(tmp_path, whole(node=nodes)).notes if "not read" in note]
    assert note.endswith(", a9 (1) and 15 more")  # and the colour


def test_defaults_of_nodes_and_edges_are_read(tmp_path: Path) -> None:
    nodes = {"0": {"x": 0}, "1": {"x": 1}}
    content = whole(
        node=nodes,
        edge={"0": {"1": {}}},
        default_node_attributes={"y": 0.5, "z": 0.25},
        default_edge_attributes={"q": 1.0, "EA": 50.0},
    )
    document = load(tmp_path, content).document
    assert document["nodes"]["n1"]["position"] == [1.0, 0.5, 0.25]
    assert document["members"]["m0_1"]["axial_stiffness"] == 50.0


@pytest.mark.parametrize(
    ("content", "error", "where"),
    [
        (whole(edge={"0": {"7": {"q": 1, "EA": 1}}}), UnknownNameError, "data.edge.0.7"),
        (whole(edge={"0": {"1": {"EA": 1}}}), InvalidValueError, "data.edge.0.1"),
        (whole(edge={**EDGES, "0": {"1": {"q": 1}}}), InvalidValueError, "data.edge.0.1: spring_constant"),
        (whole(edge={"0": {"1": {"q": "1"}}}), InvalidValueError, "data.edge.0.1.q"),
        (whole(edge={"0": {"0": {"q": 1, "EA": 1}}}), StructureError, "data.edge.0.0"),
        (whole(edge={**EDGES, "1": {"0": {"q": 1, "EA": 1}}}), DuplicateNameError, "data.edge.1.0"),
        (whole(edge={}), StructureError, "network.json"),
        (whole(node={"0": {"x": 1e305}}), NonFiniteError, "data.node.0.x"),
        (whole(node=[1]), InvalidValueError, "data.node"),
        (whole(node={"0": 3}), InvalidValueError, "data.node.0"),
        ({"dtype": "compas.datastructures/Mesh", "data": {}}, InvalidValueError, "dtype"),
        ({"dtype": "compas.datastructures/Network", "data": 3}, InvalidValueError, "data"),
    ],
)
def test_wrong_networks_are_refused_by_their_place(
    content: Any, error: type[SceneError], where: str, tmp_path: Path
) -> None:
    with pytest.raises(error) as caught:
        load(tmp_path, content)
    assert where in caught.value.where


def test_a_network_of_jax_fdm_is_in_equilibrium_as_it_stands(tmp_path: Path) -> None:
    """A load of 1 N between two cables of force density 1 N/m; the file has defaults, and no stiffness."""
    data = {
        "default_node_attributes": {"x": 0.0, "y": 0.0, "z": 0.0, "pz": 0.0, "rx": 0.0, "is_support": False},
        "default_edge_attributes": {"q": 0.0, "length": 0.0, "force": 0.0, "px": 0.0},
        "node": {
            "0": {"x": -1.0, "is_support": True},
            "1": {"z": -0.5, "pz": -1.0},
            "2": {"x": 1.0, "is_support": True},
        },
        "edge": {
            "0": {"1": {"q": 1.0, "force": 1.25**0.5, "length": 1.25**0.5}},
            "1": {"2": {"q": 1.0}},
            "2": {},
        },
    }
    result = load(tmp_path, {"dtype": "jax_fdm.datastructures/FDNetwork", "data": data})
    structure, _ = assemble(parse_scene(result.document))
    assert structure.node_anchored.all(axis=1).tolist() == [True, False, True]
    for member in result.document["members"].values():
        assert (member["kind"], member["prestress"]) == ("cable", 1.25**0.5)
        assert member["axial_stiffness"] == 1000.0 * 1.25**0.5
    assert result.document["loads"] == [{"node": "n1", "force": [0.0, 0.0, -1.0]}]
    assert any("the file has no stiffness" in note for note in result.notes)
    assert not any("attributes that are not read" in note for note in result.notes)


def test_the_sections_of_both_encoders_are_read(tmp_path: Path) -> None:
    content = {"node": NODES, "edge": EDGES}
    kind = "compas.datastructures/Network"
    scenes = [load(tmp_path, {"dtype": kind, key: content}).document for key in ("data", "value")]
    assert scenes[0] == scenes[1]


def test_null_coordinates_are_noted(tmp_path: Path) -> None:
    result = load(tmp_path, {"data": {"node": NODES, "edge": EDGES}})
    assert any("null coordinates, which are 0 (1)" in note for note in result.notes)


@pytest.mark.parametrize("value", ["false", 2, [True]])
def test_anchors_that_are_no_booleans_are_refused(value: Any, tmp_path: Path) -> None:
    nodes = NODES | {"0": NODES["0"] | {"is_anchor": value}}
    with pytest.raises(InvalidValueError, match="is_anchor: not a Boolean"):
        load(tmp_path, {"data": {"node": nodes, "edge": EDGES}})
