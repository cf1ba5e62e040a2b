"""Drawings: lines and polylines in the model space, layers, units, and files that are damaged."""

from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.scene.formats import import_dxf
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    NonFiniteError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    TensegrityError,
)

ezdxf = pytest.importorskip("ezdxf", reason="needs the package ezdxf, the extra `cad`")


def read(tmp_path: Path, draw: Any, units: int = 6, version: str = "R2010", **options: Any) -> ImportResult:
    """Write a drawing, draw(its model space), and import it."""
    document = ezdxf.new(version, units=units)
    draw(document.modelspace())
    document.saveas(tmp_path / "frame.dxf")
    return read_files([tmp_path / "frame.dxf"], **options)


def find_ends(result: ImportResult) -> list[tuple[list[float], list[float]]]:
    nodes = {key: node["position"] for key, node in result.document["nodes"].items()}
    return [(nodes[a], nodes[b]) for a, b in (item["nodes"] for item in result.document["members"].values())]


def test_lines_and_polylines_are_members_of_their_layers(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_line((0, 0, 0), (0, 0, 2), dxfattribs={"layer": "Struts main"})
        space.add_lwpolyline(
            [(0, 0), (1, 0), (1, 1)], close=True, dxfattribs={"layer": "net", "elevation": 2.0}
        )
        space.add_polyline3d([(0, 0, 0), (3, 0, 0), (3, 0, 2)], dxfattribs={"layer": "BAR"})
        space.add_polyline2d([(5, 5), (6, 5)], dxfattribs={"elevation": (0, 0, 1)})
        space.add_point((9, 9, 9))
        space.add_circle((0, 0), 1)
        space.add_circle((0, 0), 2)

    result = read(tmp_path, draw)
    assert [item["kind"] for item in result.document["members"].values()] == [
        "bar", "cable", "cable", "cable", "bar", "bar", "cable",
    ]  # fmt: skip
    assert find_ends(result) == [
        ([0, 0, 0], [0, 0, 2]),
        ([0, 0, 2], [1, 0, 2]),
        ([1, 0, 2], [1, 1, 2]),
        ([1, 1, 2], [0, 0, 2]),
        ([0, 0, 0], [3, 0, 0]),
        ([3, 0, 0], [3, 0, 2]),
        ([5, 5, 1], [6, 5, 1]),
    ]
    assert any("POINT (1), CIRCLE (2)" in note for note in result.notes)


def test_polylines_in_a_plane_of_their_own(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_lwpolyline([(0, 0), (2, 0)], dxfattribs={"extrusion": (1, 0, 0), "elevation": 3.0})

    # The plane of the normal x has y and z as its own axes.
    assert find_ends(read(tmp_path, draw)) == [([3, 0, 0], [3, 2, 0])]


def test_arcs_and_units_are_noted(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_lwpolyline([(0, 0, 0, 0, 1.0), (1000, 0, 0, 0, 0)])

    result = read(tmp_path, draw, units=4)
    assert any("Millimeters" in note and "`scale` 0.001" in note for note in result.notes)
    assert any("with arcs" in note and note.endswith("1") for note in result.notes)
    assert find_ends(read(tmp_path, draw, units=4, scale=0.001)) == [([0, 0, 0], [1, 0, 0])]
    assert not any("unit" in note for note in read(tmp_path, draw, units=0).notes)


def test_y_that_is_up_becomes_z(tmp_path: Path) -> None:
    result = read(tmp_path, lambda space: space.add_line((0, 0, 0), (1, 2, 3)), up="y")
    assert find_ends(result) == [([0, 0, 0], [1, -3, 2])]


@pytest.mark.parametrize("version", ["R12", "R2000", "R2018"])
def test_versions(version: str, tmp_path: Path) -> None:
    result = read(tmp_path, lambda space: space.add_line((0.1, 0, 0), (1 / 3, 0, 0)), 0, version)
    assert find_ends(result) == [([0.1, 0, 0], [1 / 3, 0, 0])]


def test_options(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_line((0, 0, 0), (1, 0, 0))
        space.add_line((1.001, 0, 0), (2, 0, 0))

    assert len(read(tmp_path, draw).document["nodes"]) == 4
    result = read(tmp_path, draw, tolerance=0.01, axial_stiffness=5.0)
    assert len(result.document["nodes"]) == 3
    assert {item["axial_stiffness"] for item in result.document["members"].values()} == {5.0}
    with pytest.raises(InvalidValueError, match="without this option") as caught:
        read(tmp_path, draw, pretension_scale=2.0)
    assert "NTRT" in caught.value.allowed


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("LINE", "CIRCLE", StructureError, "no lines"),
        ("0.625", "nan", NonFiniteError, "not a finite place"),
        ("0.625", "0.125", InvalidValueError, "without length"),
        ("0.625", "five", SceneSyntaxError, "cannot be read as a drawing"),
        ("SECTION", "SECTOIN", SceneSyntaxError, "cannot be read as a drawing"),
    ],
)
def test_damaged_drawings(old: str, new: str, error: type[Exception], words: str, tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_line((0.125, 0.25, 0.375), (0.625, 0.25, 0.375), dxfattribs={"layer": "bars"})

    read(tmp_path, draw)
    path = tmp_path / "frame.dxf"
    text = path.read_text(encoding="utf-8")
    assert old in text
    before, middle, after = text.rpartition("AcDbEntity")
    if old == "LINE":
        head, _, tail = before.rpartition("LINE")
        text = head + new + tail + middle + after
    else:
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(error, match=words) as caught:
        read_files([path])
    assert str(path) in caught.value.where  # type: ignore[attr-defined]


def test_what_is_no_drawing(tmp_path: Path) -> None:
    for content in (b"", b"0\nEOF\n", b"AutoCAD Binary DXF\r\n\x1a\x00\x01", b"\xff\xfe\x00", b"x" * 1000):
        (tmp_path / "a.dxf").write_bytes(content)
        with pytest.raises(TensegrityError):
            read_files([tmp_path / "a.dxf"])
    with pytest.raises(SceneError, match="cannot be read"):
        read_files([tmp_path / "none.dxf"])


@pytest.mark.parametrize(
    ("body", "problem", "given"),
    [
        ("0\nLINE\n8\nc\n" * 6, "too many entities", 9),
        ("0\nLWPOLYLINE\n8\nc\n" + "10\n1.0\n20\n2.0\n" * 30, "too many tags", 66),
    ],
)
def test_large_drawings_are_refused_before_they_are_read(
    body: str, problem: str, given: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(import_dxf, "MAX_ENTITIES", 8)
    monkeypatch.setattr(import_dxf, "MAX_TAGS", 60)
    text = f"0\nSECTION\n2\nENTITIES\n{body}0\nENDSEC\n0\nEOF\n"
    (tmp_path / "frame.dxf").write_text(text, encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr(ezdxf, "readfile", None)
        with pytest.raises(SceneSyntaxError, match=problem) as caught:
            read_files([tmp_path / "frame.dxf"])
    assert caught.value.given == given
    (tmp_path / "frame.dxf").write_bytes(b"AutoCAD Binary DXF\r\n" + bytes(500))
    with pytest.raises(SceneSyntaxError, match="too many tags"):
        read_files([tmp_path / "frame.dxf"])


def test_no_layer_steers_the_terminal(tmp_path: Path) -> None:
    layer = "c\x1b[31m\x1b]0;own\x07\u202e"
    text = f"0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n{layer}\n10\n0\n20\n0\n11\n0\n21\n0\n0\nENDSEC\n0\nEOF\n"
    (tmp_path / "frame.dxf").write_text(text, encoding="utf-8")
    with pytest.raises(TensegrityError) as caught:
        read_files([tmp_path / "frame.dxf"])
    assert r"on layer c\x1b[31m\x1b]0;own\x07" in str(caught.value)
    assert all(letter.isprintable() or letter == "\n" for letter in str(caught.value))
