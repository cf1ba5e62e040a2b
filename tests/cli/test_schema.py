"""The JSON schema agrees with what the reader takes, for the scenes that ship and for spoiled ones."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tests.cli.conftest import Run

TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "number": (int, float),
    "integer": int,
    "null": type(None),
}


def find_faults(value: Any, schema: dict[str, Any], root: dict[str, Any], where: str = "") -> list[str]:
    """Return where `value` departs from a JSON schema; the few keywords of a scene's schema."""
    if "$ref" in schema:
        name = schema["$ref"].removeprefix("#/$defs/")
        return find_faults(value, root["$defs"][name], root, where)
    for keyword in ("anyOf", "oneOf"):
        if keyword in schema:
            branches = [find_faults(value, branch, root, where) for branch in schema[keyword]]
            return [] if [] in branches else min(branches, key=len)
    faults = []
    kind = schema.get("type")
    if kind is not None:
        fits = isinstance(value, TYPES[kind])
        if not fits or (isinstance(value, bool) and kind != "boolean"):
            return [f"{where}: not of type {kind}"]
    if "enum" in schema and value not in schema["enum"]:
        faults.append(f"{where}: not in {schema['enum']}")
    if "const" in schema and value != schema["const"]:
        faults.append(f"{where}: not {schema['const']}")
    if "exclusiveMinimum" in schema and not value > schema["exclusiveMinimum"]:
        faults.append(f"{where}: too small")
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        rest = schema.get("additionalProperties", True)
        faults += [f"{where}: lacks {key}" for key in schema.get("required", ()) if key not in value]
        for key, item in value.items():
            matching = [
                branch
                for pattern, branch in schema.get("patternProperties", {}).items()
                if re.search(pattern, key)
            ]
            if key in properties or matching:
                for branch in matching or [properties[key]]:
                    faults += find_faults(item, branch, root, f"{where}.{key}")
            elif isinstance(rest, dict):
                faults += find_faults(item, rest, root, f"{where}.{key}")
            elif not rest:
                faults.append(f"{where}.{key}: unknown key")
    if isinstance(value, list) and isinstance(schema.get("items"), dict):
        for number, item in enumerate(value):
            faults += find_faults(item, schema["items"], root, f"{where}[{number}]")
    return faults


@pytest.fixture
def schema(run: Run) -> dict[str, Any]:
    ended = run.good("schema")
    assert ended.err.startswith("took ")
    return dict(ended.data)


@pytest.mark.parametrize("name", list_examples())
def test_it_accepts_the_scenes_that_ship(name: str, schema: dict[str, Any]) -> None:
    assert find_faults(tomllib.loads(list_examples()[name]), schema, schema) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("gravity =", "gravty ="),
        ("spring_constant = 80 ", 'spring_constant = "80" '),
        ("spring_constant = 80 ", "spring_constant = -80 "),
        ('kind = "cable"', 'kind = "rope"'),
        ('name = "two_nodes"', ""),
        ("node_mass = 0.5", "node_mas = 0.5"),
        ("gravity = [0, 0, -9.81]", "gravity = -9.81"),
    ],
)
def test_it_refuses_spoiled_scenes(old: str, new: str, schema: dict[str, Any]) -> None:
    text = list_examples()["two_nodes"]
    assert text.count(old) == 1
    assert find_faults(tomllib.loads(text.replace(old, new)), schema, schema) != []


def test_it_is_a_schema_with_every_section_described(schema: dict[str, Any]) -> None:
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert schema["type"] == "object"
    assert schema["additionalProperties"] is False
    assert {"name", "nodes", "members", "classes", "shape", "loads", "inputs"} <= set(schema["properties"])
    assert [
        key for key, item in schema["properties"].items() if not {"description", "$ref"} & set(item)
    ] == []
    assert [key for key, item in schema["$defs"].items() if "description" not in item] == []
    references = [part.split('"')[0] for part in json.dumps(schema).split('"#/$defs/')[1:]]
    assert set(references) <= set(schema["$defs"])


def test_json_and_file_hold_the_same(run: Run, folder: Path, schema: dict[str, Any]) -> None:
    assert run("schema", "--json").data == schema
    ended = run("schema", "--out", "scene.schema.json", "--json")
    assert ended.facts == {"status": "ok", "out": "scene.schema.json"}
    assert json.loads((folder / "scene.schema.json").read_text(encoding="utf-8")) == schema
    run.refused("schema", "--out", "scene.schema.json")


def test_an_unwritable_place_is_refused(run: Run, folder: Path) -> None:
    ended = run.refused("schema", "--out", "missing/scene.json", "--json")
    assert ended.data["where"] == "missing/scene.json"
    assert list(folder.iterdir()) == []
