"""Import of drawings (DXF): lines and polylines of the model space (package `ezdxf`).

Lines on layers whose names begin with "bar" or "strut" become bars, all other lines become cables.
"""

import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.checks.limits import MAX_ENTRIES, check_counts
from tensegrity_codegen.scene.formats.files.lines import Line, build_lines, is_bar
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import ImportResult, read_bytes
from tensegrity_codegen.system.errors import SceneSyntaxError, name_list
from tensegrity_codegen.system.extras import CAD, import_extra

MAX_DXF_BYTES = 128 * 2**20  # bytes
MAX_TAGS = 15 * MAX_ENTRIES  # pairs of a code and a value; a line has about 12
MAX_ENTITIES = MAX_ENTRIES + 100_000  # vertices of polylines, blocks and tables among them
_ENTITY = re.compile(rb"^[ \t]*0[ \t]*\r?\n[ \t]*[A-Z]", re.MULTILINE)
BINARY_TAG = 8  # bytes of a tag in binary files, about
METRES = 6  # $INSUNITS
WHAT = "a drawing (DXF)"


def import_dxf(
    path: str | Path,
    *,
    name: str | None = None,
    gravity: Sequence[float] | None = None,
    tolerance: float | None = None,
    axial_stiffness: float | None = None,
) -> ImportResult:
    """Return the scene document of the lines of a drawing, and notes."""
    path = Path(path)
    ezdxf = import_extra("ezdxf", CAD)
    _check_size(read_bytes(path, MAX_DXF_BYTES, WHAT), str(path))
    try:
        lines, notes = _read_lines(ezdxf, path)
    except Exception as error:  # of any kind, from whatever a damaged tag leads to
        problem = f"the file cannot be read as a drawing: {str(error)[:200] or type(error).__name__}"
        raise SceneSyntaxError(problem, where=str(path), allowed=WHAT) from error
    return build_lines(lines, path, name, gravity, tolerance, axial_stiffness, notes=notes)


def _check_size(data: bytes, where: str) -> None:
    """Raise SceneSyntaxError for more tags or entities than drawings have, before any of them is read."""
    tags = max(data.count(b"\n"), data.count(b"\r")) // 2
    tags = len(data) // BINARY_TAG if data.startswith(b"AutoCAD Binary DXF") else tags
    counts = {"tags": (tags, MAX_TAGS)}
    if tags <= MAX_TAGS:
        counts["entities"] = (sum(1 for _ in _ENTITY.finditer(data)), MAX_ENTITIES)
    check_counts(counts, "the drawing has too many {}", where, hint="keep only the lines of the structure")


def _read_lines(ezdxf: Any, path: Path) -> tuple[list[Line], list[str]]:
    """Return the lines of the model space, and notes on entities that are not read or not converted."""
    document = ezdxf.readfile(path)
    lines, skipped, arcs, notes = list[Line](), Counter[str](), 0, list[str]()
    for entity in document.modelspace():
        kind, points = entity.dxftype(), _list_places(entity)
        if not points:
            skipped[kind] += 1
            continue
        if len(lines) > MAX_ENTRIES:  # which build_lines refuses
            break
        where = f"{path}: {kind} {entity.dxf.handle} on layer {entity.dxf.layer[:80]}"
        lines += [Line(ends, is_bar(entity.dxf.layer), where) for ends in pairwise(points)]
        arcs += kind != "LINE" and entity.has_arc
    if document.units not in (0, METRES):
        factor = ezdxf.units.conversion_factor(document.units, METRES)
        unit = f"the drawing has the unit {ezdxf.units.unit_name(document.units)}"
        notes.append(f"{unit}, its numbers are read as metres: `scale` {factor:g} converts them")
    if skipped:
        listed = name_list([f"{kind} ({count})" for kind, count in skipped.items()], 10)
        notes.append(f"entities that are not read: {listed}")
    if arcs:
        notes.append(f"polylines with arcs, which are read as straight between their points: {arcs}")
    return lines, notes


def _list_places(entity: Any) -> list[Any]:
    """Return the points that an entity joins by lines, [] if it is another kind of entity."""
    kind = entity.dxftype()
    if kind == "LINE":
        return [entity.dxf.start.xyz, entity.dxf.end.xyz]
    if kind == "LWPOLYLINE":
        points, closed = [point.xyz for point in entity.vertices_in_wcs()], entity.closed
    elif kind == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline):
        points, closed = [point.xyz for point in entity.points_in_wcs()], entity.is_closed
    else:
        return []
    return [*points, points[0]] if closed and points else points


FORMAT = Format(
    title="lines of a drawing (DXF)", sources=("lines.dxf",), endings=(".dxf",), read=import_dxf,
    options=("tolerance", "axial_stiffness"), order=10,
)  # fmt: skip
