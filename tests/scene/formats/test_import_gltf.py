"""glTF: lines of every mode at the places of their nodes, names, and files that are damaged."""

import base64
import copy
import json
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.scene.formats import import_gltf
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneSyntaxError,
    StructureError,
    TensegrityError,
)
from tests.cases import draws

PLACES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 2]], dtype="<f4")
ORDER = np.array([0, 3, 1, 2], dtype="<u2")
DATA = PLACES.tobytes() + ORDER.tobytes()
LINES: dict[str, Any] = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "name": "Strut"}],
    "meshes": [{"primitives": [{"mode": 1, "attributes": {"POSITION": 0}}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 4, "type": "SCALAR"},
    ],
    "bufferViews": [
        {"buffer": 0, "byteOffset": 0, "byteLength": 48},
        {"buffer": 0, "byteOffset": 48, "byteLength": 8},
    ],
    "buffers": [
        {"byteLength": 56, "uri": "data:application/octet-stream;base64," + base64.b64encode(DATA).decode()}
    ],
}


def change(*path: Any, value: Any) -> dict[str, Any]:
    """Return LINES with another value at a path."""
    content = copy.deepcopy(LINES)
    place: Any = content
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return content


def read(tmp_path: Path, content: Any, **options: Any) -> ImportResult:
    path = tmp_path / "net.gltf"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return read_files([path], **options)


def find_ends(result: ImportResult) -> list[tuple[list[float], list[float]]]:
    nodes = {key: node["position"] for key, node in result.document["nodes"].items()}
    return [(nodes[a], nodes[b]) for a, b in (item["nodes"] for item in result.document["members"].values())]


def test_y_that_is_up_becomes_z(tmp_path: Path) -> None:
    result = read(tmp_path, LINES)
    assert find_ends(result) == [([0, 0, 0], [1, 0, 0]), ([1, 0, 1], [0, -2, 0])]
    assert list(result.document["members"]) == ["Strut_1", "Strut_2"]
    assert {item["kind"] for item in result.document["members"].values()} == {"bar"}
    assert any("y is up" in note for note in result.notes)


@pytest.mark.parametrize(
    ("mode", "indices", "pairs"),
    [
        (1, True, [(0, 3), (1, 2)]),
        (2, True, [(0, 3), (3, 1), (1, 2), (2, 0)]),
        (3, True, [(0, 3), (3, 1), (1, 2)]),
        (2, False, [(0, 1), (1, 2), (2, 3), (3, 0)]),
        (3, False, [(0, 1), (1, 2), (2, 3)]),
    ],
)
def test_modes(mode: int, indices: bool, pairs: list[tuple[int, int]], tmp_path: Path) -> None:
    part = {"mode": mode, "attributes": {"POSITION": 0}, **({"indices": 1} if indices else {})}
    found = find_ends(read(tmp_path, change("meshes", 0, "primitives", 0, value=part)))
    turned = (PLACES[:, [0, 2, 1]] * [1, -1, 1]).tolist()
    assert found == [(turned[a], turned[b]) for a, b in pairs]


def test_binary_files_have_the_data_in_their_second_chunk(tmp_path: Path) -> None:
    text = json.dumps(change("buffers", 0, value={"byteLength": 56})).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4s3I4s", b"glTF", 2, 28 + len(text) + 56, len(text), b"JSON")
    data = head + text + struct.pack("<I4s", 56, b"BIN\0") + DATA
    (tmp_path / "net.glb").write_bytes(data)
    assert read_files([tmp_path / "net.glb"]).document == read(tmp_path, LINES).document
    for end in (10, 15, 25, len(text) + 10, len(data) - 1):
        (tmp_path / "net.glb").write_bytes(data[:end])
        with pytest.raises(SceneSyntaxError, match="cannot be read as glTF"):
            read_files([tmp_path / "net.glb"])


def test_nodes_carry_each_other(tmp_path: Path) -> None:
    half = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]  # a quarter turn about z: x becomes y
    # Column by column: x becomes z, z becomes -x, shifted by 10 along y
    matrix = [0, 0, 1, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 10, 0, 1]
    nodes = [
        {"children": [1, 2, 3], "translation": [0, 0, 5], "rotation": half, "scale": [2, 1, 1]},
        {"mesh": 0, "translation": [1, 0, 0], "name": "a"},
        {"children": [4], "matrix": matrix},
        {"name": "corner", "translation": [1, 0, 0]},
        {"mesh": 0, "extras": {"kind": "bar"}},
        {"mesh": 7, "name": "not in the scene"},
    ]
    result = read(tmp_path, change("nodes", value=nodes))
    # In the file (0,0,0) and (1,0,0) of node 1 are at (0,2,5), (0,4,5), of node 4 at (-10,0,5), (-10,0,6).
    found = find_ends(result)
    np.testing.assert_allclose(found[0], [[0, -5, 2], [0, -5, 4]], atol=1e-15)
    np.testing.assert_allclose(found[2], [[-10, -5, 0], [-10, -6, 0]], atol=1e-14)
    assert [item["kind"] for item in result.document["members"].values()] == ["cable"] * 2 + ["bar"] * 2
    assert result.document["members"]["a_1"]["nodes"][0] == "corner"


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        ({"node": "bar 3"}, "bar"),
        ({"mesh": "STRUTS"}, "bar"),
        ({"material": "Bar steel"}, "bar"),
        ({"material": "cable", "mesh": "crossbar"}, "cable"),
        ({"node": "bar", "extras": {"kind": "cable"}}, "cable"),
        ({"node": "bar", "extras": "text"}, "bar"),
    ],
)
def test_names_of_bars(names: dict[str, Any], kind: str, tmp_path: Path) -> None:
    content = copy.deepcopy(LINES)
    content["materials"] = [{"name": names.get("material", "")}]
    content["nodes"][0] |= {"name": names.get("node", ""), "extras": names.get("extras", {})}
    content["meshes"][0]["name"] = names.get("mesh", "")
    content["meshes"][0]["primitives"][0]["material"] = 0
    result = read(tmp_path, content)
    assert {item["kind"] for item in result.document["members"].values()} == {kind}


def test_triangles_and_cameras_are_passed_over(tmp_path: Path) -> None:
    content = copy.deepcopy(LINES)
    content["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}})
    content["scenes"][0]["nodes"].append(1)
    content["nodes"].append({"camera": 0, "name": "eye"})
    assert len(read(tmp_path, content).document["members"]) == 2
    with pytest.raises(StructureError, match="no lines"):
        read(tmp_path, change("meshes", 0, "primitives", 0, "mode", value=4))


def test_steps_between_elements(tmp_path: Path) -> None:
    mixed = np.zeros((4, 5), dtype="<f4")
    mixed[:, 1:4] = PLACES
    content = change("buffers", 0, "uri", value="data:;base64," + base64.b64encode(mixed.tobytes()).decode())
    content["bufferViews"][0] = {"buffer": 0, "byteOffset": 4, "byteLength": 76, "byteStride": 20}
    assert find_ends(read(tmp_path, content)) == find_ends(read(tmp_path, LINES))


SPOILED = PLACES.copy()
SPOILED[1, 1] = np.nan


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        ("{", SceneSyntaxError, "not valid JSON"),
        ("[]", SceneSyntaxError, "cannot be read as glTF"),
        (change("asset", "version", value="1.0"), SceneSyntaxError, "version 1.0"),
        (change("scenes", 0, "nodes", value=[0, 0]), SceneSyntaxError, "twice"),
        (change("nodes", 0, "children", value=[0]), SceneSyntaxError, "twice"),
        (change("nodes", 0, "children", value=[-1]), SceneSyntaxError, "not the number of an entry"),
        (change("nodes", 0, "mesh", value=5), SceneSyntaxError, "IndexError"),
        (change("nodes", 0, "matrix", value=[1, 0]), SceneSyntaxError, "reshape"),
        (change("nodes", 0, "rotation", value=["a", 0, 0, 0]), SceneSyntaxError, "convert"),
        (change("accessors", 0, "count", value=5), SceneSyntaxError, "glTF"),
        (change("accessors", 0, "count", value=10**18), SceneSyntaxError, "glTF"),
        (change("accessors", 0, "count", value=-1), SceneSyntaxError, "negative size"),
        (change("accessors", 0, "sparse", value={}), SceneSyntaxError, "sparse"),
        (change("accessors", 0, "componentType", value=5123), SceneSyntaxError, "components"),
        (change("bufferViews", 0, "byteOffset", value=48), SceneSyntaxError, "glTF"),
        (change("bufferViews", 0, "byteStride", value=0), SceneSyntaxError, "stride"),
        (change("buffers", 0, "uri", value="net.bin"), SceneSyntaxError, "another file"),
        (change("buffers", 0, "uri", value="data:;base64,*"), SceneSyntaxError, "base64"),
        (change("nodes", 0, "scale", value=[0, 0, 0]), InvalidValueError, "without length"),
        (
            change("buffers", 0, "uri", value="data:;base64," + base64.b64encode(SPOILED.tobytes()).decode()),
            NonFiniteError,
            "not a finite place",
        ),
    ],
)
def test_damaged_files(content: Any, error: type[Exception], words: str, tmp_path: Path) -> None:
    with pytest.raises(error, match=words) as caught:
        read(tmp_path, content)
    assert str(tmp_path / "net.gltf") in caught.value.where  # type: ignore[attr-defined]


def test_a_mesh_that_is_used_twice_in_one_place_is_a_duplicate(tmp_path: Path) -> None:
    content = change("nodes", value=[{"mesh": 0}, {"mesh": 0}])
    content["scenes"][0]["nodes"] = [0, 1]
    with pytest.raises(DuplicateNameError, match="two members join the same nodes"):
        read(tmp_path, content)


VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-2, 10**20), st.floats(allow_nan=False), st.text(max_size=3),
    st.lists(st.integers(-1, 3), max_size=4), st.just({}),
)  # fmt: skip


@draws(100)
@given(data=st.data())
def test_hostile_files_end_in_an_error_or_a_scene(data: st.DataObject, tmp_path_factory: Any) -> None:
    content = copy.deepcopy(LINES)
    content["meshes"][0]["primitives"][0]["indices"] = 1
    for _ in range(data.draw(st.integers(1, 3))):
        place: Any = content
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            key = data.draw(st.sampled_from(keys))
            if not isinstance(place[key], dict | list) or not place[key] or data.draw(st.booleans()):
                break
            place = place[key]
        place[key] = data.draw(VALUES)
    with suppress(TensegrityError):
        assert read(tmp_path_factory.mktemp("hostile"), content).document["members"]


def test_a_mesh_is_read_once_for_all_its_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    plain = import_gltf._File.list_ends

    def count(self: Any, mesh: Any) -> Any:
        calls.append(len(mesh["primitives"]))
        return plain(self, mesh)

    monkeypatch.setattr(import_gltf._File, "list_ends", count)
    content = change("meshes", 0, "primitives", value=[{"mode": 4, "attributes": {"POSITION": 0}}] * 50)
    content["nodes"] = [{"mesh": 0}] * 50
    content["scenes"] = [{"nodes": list(range(50))}]
    with pytest.raises(StructureError, match="no lines"):
        read(tmp_path, content)
    assert calls == [50]


def test_indices_beyond_the_largest_scene_are_not_paired(tmp_path: Path) -> None:
    most = import_gltf.MAX_ENTRIES
    order = np.tile(np.array([0, 1], dtype="<u1"), 3 * most)
    content = change("accessors", 1, value={"bufferView": 1, "componentType": 5121, "count": order.size})
    content["meshes"][0]["primitives"][0] |= {"indices": 1}
    content["bufferViews"][1] = {"buffer": 1, "byteLength": order.size}
    uri = "data:application/octet-stream;base64," + base64.b64encode(order.tobytes()).decode()
    content["buffers"].append({"byteLength": order.size, "uri": uri})
    with pytest.raises(StructureError, match="too many lines") as caught:
        read(tmp_path, content)
    assert caught.value.given == most + 1
