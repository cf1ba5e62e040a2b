"""Lines as members: merged ends, names, stiffness, and what is refused with the place of the line."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.formats.files.lines import Line, build_lines, is_bar
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    StructureError,
)

TRIANGLE = (((0, 0, 0), (1, 0, 0)), ((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (0, 0, 0)))


def build(
    ends: Any, tolerance: float | None = None, stiffness: float | None = None, **more: Any
) -> ImportResult:
    lines = [Line(pair, number == 0, f"line {number}") for number, pair in enumerate(ends)]
    return build_lines(lines, Path("frame.dxf"), None, None, tolerance, stiffness, **more)


def test_ends_that_coincide_are_one_node_and_cables_have_a_stiffness() -> None:
    result = build(TRIANGLE, stiffness=250.0)
    assert result.document == {
        "name": "frame",
        "nodes": {
            "n1": {"position": [0, 0, 0]},
            "n2": {"position": [1, 0, 0]},
            "n3": {"position": [0, 1, 0]},
        },
        "members": {
            "bar1": {"kind": "bar", "nodes": ["n1", "n2"]},
            "cable1": {"kind": "cable", "nodes": ["n2", "n3"], "axial_stiffness": 250.0},
            "cable2": {"kind": "cable", "nodes": ["n3", "n1"], "axial_stiffness": 250.0},
        },
    }
    structure, _ = assemble_scene(parse_scene(result.document))
    assert structure.n_members == 3


def test_ends_within_the_tolerance_are_the_first_one() -> None:
    near = [[list(end) for end in pair] for pair in TRIANGLE]
    near[1][0], near[2][1] = [1.0, 0.0, 4e-7], [-3e-7, 0.0, 0.0]
    result = build(near)
    assert [node["position"] for node in result.document["nodes"].values()] == [
        [0, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
    ]
    assert any("moved by up to 4e-07" in note for note in result.notes)
    assert any("1000 N" in note for note in result.notes)
    assert len(build(near, 1e-8).document["nodes"]) == 5
    # Far from the origin, where doubles are 1e-10 apart
    far = np.add(near, [1e6, -1e6, 0])
    assert len(build(far).document["nodes"]) == 3


def test_places_with_names_are_the_nodes() -> None:
    named = {"top": [0.0, 1.0, 1e-7], "n1": [1.0, 0.0, 0.0], "aside": [5.0, 5.0, 5.0]}
    nodes = build(TRIANGLE, named={key: np.array(value) for key, value in named.items()}).document["nodes"]
    assert {key: node["position"] for key, node in nodes.items()} == {
        "n2": [0, 0, 0],
        "n1": [1, 0, 0],
        "top": [0, 1, 1e-7],
    }


def test_names_of_bars() -> None:
    assert is_bar("Bars-top")
    assert is_bar("0", "STRUT 3")
    assert not is_bar("cable", "crossbar", "")


@pytest.mark.parametrize(
    ("ends", "options", "error", "where", "words"),
    [
        ([], {}, StructureError, "frame.dxf", "no lines"),
        ([*TRIANGLE, ((2, 0, 0), (2, 0, 0))], {}, InvalidValueError, "line 3", "without length"),
        ([*TRIANGLE, ((2, 0, 0), (2, 1e-9, 0))], {}, InvalidValueError, "line 3", "without length"),
        ([*TRIANGLE, ((2, 0, np.nan), (2, 1, 0))], {}, NonFiniteError, "line 3", "not a finite place"),
        ([*TRIANGLE, ((2, 0, 0), (2, np.inf, 0))], {}, NonFiniteError, "line 3", "not a finite place"),
        ([*TRIANGLE, ((2, 0, 0), (2, 1e200, 0))], {}, NonFiniteError, "line 3", "1e\\+150"),
        ([*TRIANGLE, ((1, 0, 0), (0, 0, 0))], {}, DuplicateNameError, "line 3", "line 0"),
        (TRIANGLE, {"tolerance": 0.0}, InvalidValueError, "tolerance", "out of range"),
        (TRIANGLE, {"tolerance": np.nan}, InvalidValueError, "tolerance", "out of range"),
        (TRIANGLE, {"tolerance": 2.0}, InvalidValueError, "line 0", "without length"),
        (TRIANGLE, {"stiffness": -1.0}, InvalidValueError, "axial_stiffness", "out of range"),
    ],
)
def test_what_is_wrong_is_refused_with_its_place(
    ends: Any, options: dict[str, Any], error: type[Exception], where: str, words: str
) -> None:
    with pytest.raises(error, match=words) as caught:
        build(ends, **options)
    assert caught.value.where == where  # type: ignore[attr-defined]


def test_many_lines_take_seconds_and_a_tolerance_that_merges_all_is_refused() -> None:
    rng = np.random.default_rng(3)
    begin = time.process_time()
    assert len(build(rng.random((20_000, 2, 3))).document["nodes"]) == 40_000
    with pytest.raises(InvalidValueError, match="merges nearly all ends"):
        build(rng.random((20_000, 2, 3)), 0.5)
    assert time.process_time() - begin < 20
