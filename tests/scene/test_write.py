"""Writing scenes: text that reads back bit-equal, files whole or not at all."""

import tomllib
from dataclasses import fields
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene, read_scene
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, OutputError
from tests.cases import draws

EXAMPLES = sorted(
    (
        item
        for item in files("tensegrity_codegen.scene").joinpath("examples").iterdir()
        if item.name.endswith(".toml") and "[bodies." not in item.read_text(encoding="utf-8")
    ),
    key=lambda item: item.name,
)
SMALL = {"name": "s", "nodes": {"a": {"position": [0.0, 0.0, 0.1]}}}

number = st.floats(allow_nan=False, allow_infinity=False)
name = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,8}", fullmatch=True)
scalar = st.one_of(
    number, st.integers(-(2**63), 2**63 - 1), st.booleans(), st.text(st.characters(exclude_categories=["Cs"]))
)
table = st.dictionaries(name, st.one_of(scalar, st.lists(number, max_size=4)), max_size=4)


def bits(value):
    """Return the value with floats as their bytes, so that -0.0 and 0.0 differ."""
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, dict):
        return {key: bits(item) for key, item in value.items()}
    return [bits(item) for item in value] if isinstance(value, list) else (type(value).__name__, value)


def without_empty(document):
    return {key: value for key, value in document.items() if value or not isinstance(value, dict | list)}


@draws(12)
@given(
    st.fixed_dictionaries(
        {
            "name": st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
            "gravity": st.lists(number, min_size=1, max_size=3),
            "model": table,
            "parameters": table,
            "classes": st.dictionaries(name, table, max_size=3),
            "nodes": st.dictionaries(
                st.text(st.characters(exclude_categories=["Cs"]), max_size=8), table, max_size=5
            ),
            "members": st.dictionaries(name, table, max_size=5),
            "groups": st.dictionaries(name, st.lists(name, max_size=3), max_size=3),
            "loads": st.lists(table, max_size=3),
            "inputs": st.lists(table, max_size=3),
        }
    )
)
def test_text_reads_back_bit_equal(document):
    assert bits(tomllib.loads(format_scene(document))) == bits(without_empty(document))


def test_layout_is_one_line_a_node_and_nothing_for_none():
    document = {
        "name": "s",
        "axes": None,
        "classes": {"c": {"kind": "bar"}},
        "nodes": {"a": {"position": [0.1, 1e-300, 2], "mass": None}, "b": {"position": (1, 2, 3)}},
        "members": {},
        "loads": [{"node": "a", "force": np.array([0.0, 0.0, -1.0])}],
    }
    assert format_scene(document) == (
        'name = "s"\n\n[classes.c]\nkind = "bar"\n\n[nodes]\na = { position = [0.1, 1e-300, 2] }\n'
        'b = { position = [1, 2, 3] }\n\n[[loads]]\nnode = "a"\nforce = [0.0, 0.0, -1.0]\n'
    )


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), np.float64("-inf")])
def test_non_finite_numbers_are_refused_by_place(bad):
    with pytest.raises(NonFiniteError) as caught:
        format_scene({"name": "s", "nodes": {"a": {"position": [0.0, bad, 0.0]}}})
    assert caught.value.where == "nodes.a.position"


@pytest.mark.parametrize("bad", [object(), {1}, "\ud800", 1j])
def test_values_that_toml_lacks_are_refused(bad):
    with pytest.raises(InvalidValueError):
        format_scene({"name": bad})


def test_write_and_read(tmp_path):
    path = tmp_path / "s.toml"
    write_scene(SMALL, path)
    assert tomllib.loads(path.read_text()) == SMALL
    assert [item.name for item in tmp_path.iterdir()] == ["s.toml"]


def test_existing_files_stay_without_overwrite(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        write_scene(SMALL, path)
    assert path.read_text() == "mine"
    write_scene(SMALL, path, overwrite=True)
    assert tomllib.loads(path.read_text()) == SMALL


def test_missing_folder_is_an_output_error(tmp_path):
    with pytest.raises(OutputError, match="cannot be written") as caught:
        write_scene(SMALL, tmp_path / "none" / "s.toml")
    assert str(tmp_path / "none" / "s.toml") in caught.value.where


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "s.toml"
    path.write_text("mine")

    def fail(file, text, **options):
        file.write_bytes(text[:5].encode())
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(OutputError, match="No space left"):
        write_scene(SMALL, path, overwrite=True)
    assert path.read_text() == "mine"
    assert [item.name for item in tmp_path.iterdir()] == ["s.toml"]


def assert_same(first, second):
    for item in fields(first):
        one, two = getattr(first, item.name), getattr(second, item.name)
        if isinstance(one, np.ndarray):
            assert one.tobytes() == two.tobytes(), item.name
        elif item.name == "inputs":
            assert [i.name for i in one] == [i.name for i in two]
            for i, j in zip(one, two, strict=True):
                assert (i.kind, i.targets) == (j.kind, j.targets)
                assert i.direction == pytest.approx(j.direction, abs=1e-15)
        else:
            assert one == two, item.name


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda item: item.name)
def test_examples_survive_description_bit_by_bit(example):
    structure, request = assemble(read_scene(str(example)))
    text = format_scene(describe_structure(structure, request))
    again, request_again = assemble(parse_scene(tomllib.loads(text)))
    assert_same(structure, again)
    assert request == request_again


def test_there_are_examples():
    assert [item.name for item in EXAMPLES] == [
        "icosahedron.toml",
        "planar.toml",
        "prism.toml",
        "prism12.toml",
        "tower.toml",
        "two_nodes.toml",
    ]


@draws(15)
@given(
    st.lists(st.tuples(*[st.floats(-1e3, 1e3)] * 3), min_size=3, max_size=6, unique=True),
    st.floats(1e-3, 1e6),
    st.floats(-0.4, 0.4),
    st.sampled_from(["bar", "cable"]),
    st.sampled_from([True, False, "xz"]),
)
def test_random_structures_survive_description_bit_by_bit(points, stiffness, strain, kind, anchored):
    spread = [[x + 1e4 * i, y, z] for i, (x, y, z) in enumerate(points)]
    nodes = {f"n{i}": {"position": point, "mass": 0.1 + i / 3} for i, point in enumerate(spread)}
    nodes["n0"]["anchored"] = anchored
    nodes["n1"]["velocity"] = (*points[0][:2], 1 / 3)
    members = {
        f"m{i}": {
            "kind": kind,
            "nodes": [f"n{i}", f"n{i + 1}"],
            ("spring_constant", "axial_stiffness")[i % 2]: stiffness,
            "strain": strain,
        }
        for i in range(len(points) - 1)
    }
    document = {
        "name": "s",
        "nodes": nodes,
        "members": members,
        "loads": [{"node": "n1", "force": [0.1, 0, 0]}],
    }
    structure, request = assemble(parse_scene(document))
    text = format_scene(describe_structure(structure, request))
    again, _ = assemble(parse_scene(tomllib.loads(text)))
    assert_same(structure, again)
