"""Import of JSON: the contract, both forms of each section, and wrong input named by its place."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.files import documents
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.formats.import_json import MEMBER_KEYS, NODE_KEYS, SECTIONS, import_json
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    UnknownKeyError,
    UnknownNameError,
)

ROOT = Path(__file__).resolve().parents[3]
BY_NAME: dict[str, Any] = {
    "gravity": [0, 0, -9.81],
    "nodes": {
        "a": [0, 0, 0],
        "b": {"position": [1, 0, 0], "mass": 0.2, "velocity": [0, 0.5, 0]},
        "c": {"position": [0, 1, 0], "mass": 0.1, "anchored": "xz"},
    },
    "members": {
        "ab": {"from": "a", "to": "b", "kind": "bar", "mass": 0.3},
        "bc": {"from": "b", "to": "c", "kind": "cable", "rest_length": 1.2, "spring_constant": 100},
        "ca": {"from": "c", "to": "a", "kind": "cable", "axial_stiffness": 2e3, "prestress": 5},
    },
    "anchors": {"a": True},
    "loads": {"b": [0, 0, -1]},
}
DOCUMENT = {
    "name": "frame",
    "gravity": [0.0, 0.0, -9.81],
    "nodes": {
        "a": {"position": [0.0, 0.0, 0.0], "anchored": True},
        "b": {"position": [1.0, 0.0, 0.0], "mass": 0.2, "velocity": [0.0, 0.5, 0.0]},
        "c": {"position": [0.0, 1.0, 0.0], "mass": 0.1, "anchored": "xz"},
    },
    "members": {
        "ab": {"kind": "bar", "nodes": ["a", "b"], "mass": 0.3},
        "bc": {"kind": "cable", "nodes": ["b", "c"], "rest_length": 1.2, "spring_constant": 100.0},
        "ca": {"kind": "cable", "nodes": ["c", "a"], "axial_stiffness": 2000.0, "prestress": 5.0},
    },
    "loads": [{"node": "b", "force": [0.0, 0.0, -1.0]}],
}
Load = Callable[..., ImportResult]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    def load(content: Any, **options: Any) -> ImportResult:
        path = tmp_path / "frame.json"
        text = content if isinstance(content, str | bytes) else json.dumps(content)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return import_json(path, **options)

    return load


def changed(path: str, value: Any) -> dict[str, Any]:
    """Return a copy of BY_NAME with another value at a path of keys; None: without it."""
    document: dict[str, Any] = json.loads(json.dumps(BY_NAME))
    *parents, last = path.split(".")
    table: Any = document
    for key in parents:
        table = table[key]
    if value is None:
        del table[last]
    else:
        table[last] = value
    return document


def test_the_contract(load: Load) -> None:
    result = load(BY_NAME)
    assert result.document == DOCUMENT
    assert list(result.notes) == [
        "members without a rest length, which is their present length: 1",
        "bars without a stiffness, which are rigid: 1",
    ]
    structure, _ = assemble(parse_scene(result.document))
    assert structure.is_rigid.tolist() == [True, False, False]
    np.testing.assert_array_equal(structure.node_load[1], [0, 0, -1])


def test_lists_go_by_number(load: Load) -> None:
    listed = {
        "nodes": [[0, 0, 0], {"position": [1, 0, 0]}, {"name": "tip", "position": [0, 1, 0]}],
        "members": [
            {"from": 0, "to": 1, "kind": "bar"},
            {"from": "tip", "to": "0", "kind": "cable", "axial_stiffness": 1, "name": "tie"},
        ],
        "anchors": [0, "tip"],
        "loads": [{"node": 1, "force": [1, 0, 0]}, {"node": 1, "force": [0, 2, 0]}],
    }
    document = load(listed).document
    assert list(document["nodes"]) == ["n0", "n1", "tip"]
    assert {name: item["nodes"] for name, item in document["members"].items()} == {
        "m0": ["n0", "n1"],
        "tie": ["tip", "n0"],
    }
    assert [name for name, node in document["nodes"].items() if node.get("anchored")] == ["n0", "tip"]
    assert [item["node"] for item in document["loads"]] == ["n1", "n1"]
    structure, _ = assemble(parse_scene(document))
    np.testing.assert_array_equal(structure.node_load[1], [1, 2, 0])


def test_names_and_gravity_of_the_file_and_of_the_call(load: Load, tmp_path: Path) -> None:
    assert load(BY_NAME | {"name": "mine"}).document["name"] == "mine"
    result = load(BY_NAME | {"name": "mine"}, name="other", gravity=(1, 2, 3))
    assert (result.document["name"], result.document["gravity"]) == ("other", [1.0, 2.0, 3.0])
    load(BY_NAME)
    assert read_files([tmp_path / "frame.json"]) == import_json(tmp_path / "frame.json")


def test_a_cable_may_push(load: Load) -> None:
    document = load(changed("members.bc.tension_only", value=False)).document
    assert document["members"]["bc"]["tension_only"] is False


def test_the_example_of_the_documentation(load: Load) -> None:
    page = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
    text = re.search(r"```json\n(.*?)```", page, re.DOTALL)
    assert text is not None
    structure, _ = assemble(parse_scene(load(text[1]).document))
    assert structure.n_members == 3


def test_the_documentation_names_every_key() -> None:
    page = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
    section = page.partition("(JSON)\n")[2].partition("\n## ")[0]
    keys = {*SECTIONS, *NODE_KEYS, *MEMBER_KEYS}
    assert [key for key in sorted(keys) if f"`{key}`" not in section] == []


@pytest.mark.parametrize(
    ("path", "value", "error", "where"),
    [
        ("extra", 1, UnknownKeyError, ""),
        ("nodes.b.wieght", 1, UnknownKeyError, "nodes.b"),
        ("members.ab.color", 1, UnknownKeyError, "members.ab"),
        ("nodes.a", [0, 0], InvalidValueError, "nodes.a"),
        ("nodes.a", 3, InvalidValueError, "nodes.a"),
        ("nodes.a", [0, "x", 0], InvalidValueError, "nodes.a[1]"),
        ("nodes.a", [0, True, 0], InvalidValueError, "nodes.a[1]"),
        ("nodes.b.position", None, InvalidValueError, "nodes.b"),
        ("nodes.b.name", "bee", InvalidValueError, "nodes.b.name"),
        ("nodes.b.mass", 0, InvalidValueError, "nodes.b.mass"),
        ("nodes.b.mass", 10**400, NonFiniteError, "nodes.b.mass"),
        ("nodes.c.anchored", "zx", InvalidValueError, "nodes.c.anchored"),
        ("nodes.c.anchored", {}, InvalidValueError, "nodes.c.anchored"),
        ("nodes", {}, StructureError, "nodes"),
        ("nodes", 7, InvalidValueError, "nodes"),
        ("members", None, StructureError, "members"),
        ("members.ab.kind", "rope", InvalidValueError, "members.ab.kind"),
        ("members.ab.kind", None, InvalidValueError, "members.ab"),
        ("members.ab.to", "nobody", UnknownNameError, "members.ab.to"),
        ("members.ab.to", "a", StructureError, "members.ab.to"),
        ("members.ab.to", [1], InvalidValueError, "members.ab.to"),
        ("members.bc.to", "a", DuplicateNameError, "members.bc"),
        ("members.bc.spring_constant", -5, InvalidValueError, "members.bc.spring_constant"),
        ("members.bc.spring_constant", None, InvalidValueError, "members.bc.spring_constant"),
        ("members.bc.axial_stiffness", 1, InvalidValueError, "members.bc.axial_stiffness"),
        ("members.bc.prestress", 1, InvalidValueError, "members.bc.prestress"),
        ("members.ca.prestress", -1, InvalidValueError, "members.ca.prestress"),
        ("members.ca.density", 1, InvalidValueError, "members.ca.density"),
        ("members.ca.damping", -1, InvalidValueError, "members.ca.damping"),
        ("members.ca.tension_only", "no", InvalidValueError, "members.ca.tension_only"),
        ("members.ab.tension_only", True, InvalidValueError, "members.ab.tension_only"),
        ("members.ab.density", 1, InvalidValueError, "members.ab.density"),
        ("anchors.nobody", True, UnknownNameError, "anchors.nobody"),
        ("anchors.c", True, DuplicateNameError, "anchors.c"),
        ("anchors", "a", InvalidValueError, "anchors"),
        ("loads.nobody", [0, 0, 1], UnknownNameError, "loads.nobody"),
        ("loads.b", [0, 0], InvalidValueError, "loads.b"),
        ("loads", [{"node": "b"}], InvalidValueError, "loads[0]"),
        ("gravity", 9.81, InvalidValueError, "gravity"),
        ("name", 3, InvalidValueError, "name"),
    ],
)
def test_a_wrong_value_is_named_by_its_path(
    path: str, value: Any, error: type[SceneError], where: str, load: Load
) -> None:
    with pytest.raises(error) as caught:
        load(changed(path, value))
    place = caught.value.where.partition("frame.json")[2]
    assert place == (f": {where}" if where else "")


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", SceneSyntaxError),
        ("{", SceneSyntaxError),
        ("[1, 2]", InvalidValueError),
        ("null", InvalidValueError),
        (b"\xff\xfe\x00\xd8", SceneSyntaxError),
        (b"\x80abc", SceneSyntaxError),
        ('{"nodes": {"a": [0, 0, NaN]}}', NonFiniteError),
        ('{"nodes": {"a": [0, 0, -Infinity]}}', NonFiniteError),
        ('{"nodes": {"a": [0, 0, 1e999]}, "members": [{}]}', NonFiniteError),
        ('{"nodes": {"a": [0, 0, 1], "a": [0, 0, 2]}}', DuplicateNameError),
        ('{"nodes": [' + "[" * 100_000, SceneSyntaxError),
        ('{"nodes": [' + "9" * 5000 + "]}", SceneSyntaxError),
        ('{"nodes": [' + "0," * 4_000_001 + "0]}", SceneSyntaxError),
        ('{"nodes": [' + "0," * 200_001 + "0]}", InvalidValueError),
        ('{"name": "a;b", "nodes": [[0, 0, 0]], "members": [{}]}', InvalidNameError),
    ],
    ids=range(15),
)
def test_files_that_are_no_structure_are_refused(
    text: str | bytes, error: type[SceneError], load: Load
) -> None:
    with pytest.raises(error) as caught:
        load(text)
    assert "frame.json" in caught.value.where


def test_a_file_that_is_too_large_is_refused(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documents, "MAX_JSON_BYTES", 100)
    with pytest.raises(SceneSyntaxError, match="too large"):
        load(BY_NAME)


CONTROL: dict[str, Any] = {
    "actuators": [{"name": "m", "members": ["bc", "ca"], "rate": 0.1, "range": [0.5, 2]}],
    "sensors": [{"kind": "member_length", "members": "all"}, {"kind": "node_position", "nodes": "b"}],
    "limits": {"least_tension": 1, "members": {"ca": {"most_tension": 20}}},
}


def assemble_json(path: Path, content: dict[str, Any]) -> Any:
    path.write_text(json.dumps(content), encoding="utf-8")
    return assemble(parse_scene(import_json(path).document, str(path)), str(path))[0]


def test_actuators_sensors_and_limits_by_name_and_by_number(tmp_path: Path) -> None:
    by_name = assemble_json(tmp_path / "frame.json", BY_NAME | CONTROL)
    assert [item.name for item in by_name.actuators] == ["m"]
    assert by_name.limits.most_tension[2] == 20
    numbered: dict[str, Any] = {
        "gravity": BY_NAME["gravity"],
        "nodes": list(BY_NAME["nodes"].values()),
        "members": [
            {**member, "from": "abc".index(member["from"]), "to": "abc".index(member["to"])}
            for member in BY_NAME["members"].values()
        ],
        "anchors": [0],
        "actuators": [{**CONTROL["actuators"][0], "members": [1, 2]}],
        "sensors": [CONTROL["sensors"][0], {"kind": "node_position", "nodes": [1]}],
        "limits": {"least_tension": 1, "members": {"2": {"most_tension": 20}}},
    }
    by_number = assemble_json(tmp_path / "frame.json", numbered)
    assert by_number.actuators == by_name.actuators
    assert by_number.sensors == by_name.sensors
    assert by_number.limits == by_name.limits


@pytest.mark.parametrize(
    ("change", "error", "where"),
    [
        ({"actuators": [{"name": "m", "members": [7]}]}, InvalidValueError, "actuators[0].members[0]"),
        ({"actuators": [{"name": "m", "members": ["cab"]}]}, UnknownNameError, "actuators[0].members"),
        ({"actuators": {"name": "m"}}, InvalidValueError, "actuators"),
        ({"sensors": [{"kind": "node_position", "nodes": ["z"]}]}, UnknownNameError, "sensors[0].nodes"),
        ({"sensors": [{"kind": "node_position", "nodes": [[1]]}]}, InvalidValueError, "sensors[0].nodes[0]"),
        ({"limits": {"members": {"cab": {}}}}, UnknownNameError, "limits.members.cab"),
        ({"limits": {"least_tension": -1}}, InvalidValueError, "limits.least_tension"),
        ({"limits": [1]}, InvalidValueError, "limits"),
    ],
)
def test_wrong_control_is_named_in_the_file(
    tmp_path: Path, change: dict[str, Any], error: type[SceneError], where: str
) -> None:
    with pytest.raises(error) as caught:
        assemble_json(tmp_path / "frame.json", BY_NAME | change)
    assert caught.value.where == f"{tmp_path / 'frame.json'}: {where}"
