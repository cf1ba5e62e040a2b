"""The manifest as text and as arrays: what goes in comes out, and large libraries stay readable quickly."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest, Pattern
from tests.reference_manifest import build_manifest
from tests.structure.test_structure import many_bars

PATTERN = Pattern((3, 2), [0, 2, 1], [0, 2, 3])


def manifest(pattern: Pattern | None = PATTERN) -> Manifest:
    function = FunctionSpec(
        "tangent_stiffness", "s_compute", ("coordinate",), (3, 2), "N/m", "K.", 9, pattern
    )
    return replace(build_manifest(many_bars(2), {}), functions=(function,))


def test_a_manifest_comes_back_as_it_was() -> None:
    assert Manifest.from_json(manifest().to_json()) == manifest()
    assert Manifest.from_json(manifest(None).to_json()) == manifest(None)


def test_every_field_takes_one_line_whatever_its_length() -> None:
    lines = manifest().to_json().splitlines()
    long = manifest(Pattern((5000, 1), range(5000), (0, 5000))).to_json()
    assert len(long.splitlines()) == len(lines)
    assert json.loads(long)["functions"][0]["pattern"]["row"] == list(range(5000))
    assert next(line for line in lines if '"column_start"' in line).strip() == '"column_start": [0, 2, 3]'


def test_patterns_differ_by_shape_rows_and_columns() -> None:
    same = Pattern((3, 2), np.array([0, 2, 1]), (0, 2, 3))
    assert same == PATTERN
    assert hash(same) == hash(PATTERN)
    others = (
        Pattern((4, 2), (0, 2, 1), (0, 2, 3)),
        Pattern((3, 2), (0, 1, 1), (0, 2, 3)),
        Pattern((3, 2), (0, 2, 1), (0, 1, 3)),
    )
    assert all(other != PATTERN for other in others)
    assert PATTERN != "a pattern"


def test_a_pattern_cannot_be_changed_and_keeps_nothing_of_the_caller() -> None:
    given = np.array([0, 2, 1], dtype=np.int32)
    pattern = Pattern((3, 2), given, (0, 2, 3))
    given[0] = 1
    assert pattern.row.tolist() == [0, 2, 1]
    assert pattern.row.dtype == np.int32
    with pytest.raises(ValueError, match="read-only"):
        pattern.row[0] = 1


@pytest.mark.parametrize("row", [["a"], [2**40], 5, None, [[1], [1, 2]]], ids=str)
def test_a_damaged_pattern_is_said_to_be_so(row: object) -> None:
    data = json.loads(manifest().to_json())
    data["functions"][0]["pattern"]["row"] = row
    with pytest.raises(LibraryError, match="the manifest is damaged"):
        Manifest.from_json(json.dumps(data))


def test_positions_and_places_are_arrays_made_once() -> None:
    found = manifest()
    assert found.stated_position.tolist() == [list(row) for row in found.node_position]
    assert found.coordinate_place.tolist() == [list(row) for row in found.coordinate_node_axis]
    assert found.coordinate_place is found.coordinate_place
    for array in (found.stated_position, found.coordinate_place):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0
    other = replace(found, coordinate_node_axis=(), node_position=((1.0, 2.0, 3.0),))
    assert other.coordinate_place.shape == (0, 2)
    assert other.stated_position.tolist() == [[1.0, 2.0, 3.0]]
    assert found.to_json() == manifest().to_json()  # arrays are no part of it
