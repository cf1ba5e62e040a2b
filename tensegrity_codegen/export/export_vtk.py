"""Export to VTK: a structure as lines of a PolyData file (.vtp), a motion as a series of them (.pvd).

The format: docs.vtk.org, "VTK XML file formats". Several samples in one .vtp are part of it, but readers do
not read files of that kind by VTK itself; ParaView plays a collection of files.
"""

from base64 import b64encode
from pathlib import Path
from xml.etree.ElementTree import Element, indent, tostring

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource, Shapes, read_shapes
from tensegrity_codegen.export.rigid_parts import add, number, write_elements
from tensegrity_codegen.system.errors import OutputError


def write_vtk(source: ExportSource, path: Path, *, trajectory: Path | None = None) -> Exported:
    """Write the shape of a scene as .vtp, or a motion as .pvd with a .vtp for each sample in a folder."""
    out = source.out or path
    allowed = ".vtp" if trajectory is None else ".pvd"
    if out.suffix.lower() != allowed and (out.suffix or trajectory is not None):
        raise OutputError(
            f"{'one shape' if trajectory is None else 'a motion'} cannot have the ending {out.suffix!r}",
            where=str(out),
            allowed=f"{allowed}: .vtp is one shape, .pvd a motion",
            hint=f"{out.stem}{allowed}",
        )
    shapes = read_shapes(source, trajectory)
    facts = {"n_nodes": shapes.structure.n_nodes, "n_members": shapes.structure.n_members}
    if trajectory is None:
        path.write_bytes(build_polydata(shapes, 0))
        return Exported(facts, shapes.notes)
    root = _begin("Collection")
    files: dict[str, bytes] = {}
    for sample, time in enumerate(shapes.time):
        name = f"sample_{sample:05d}.vtp"
        add(root[0], "DataSet", timestep=number(time), part="0", file=f"{out.stem}/{name}")
        files[name] = build_polydata(shapes, sample)
    write_elements(root, path)
    return Exported({**facts, "n_samples": len(files), "folder": out.stem}, shapes.notes, files)


def build_polydata(shapes: Shapes, sample: int) -> bytes:
    """Return one sample as a PolyData file: nodes are points, members are lines.

    Arrays of points: load [N]; of lines: tension [N], NaN if unknown, kind (0 cable, 1 bar) and member,
    the row of the field array member_name. Numbers are binary, so that all of their bits are kept.
    """
    structure = shapes.structure
    n_members = structure.n_members
    root = _begin("PolyData")
    fields = add(root[0], "FieldData")
    time = add(fields, "DataArray", type="Float64", Name="TimeValue", NumberOfTuples="1", format="ascii")
    time.text = number(shapes.time[sample])
    for name, texts in (("node_name", structure.node_name), ("member_name", structure.member_name)):
        array = add(fields, "Array", type="String", Name=name, NumberOfTuples=str(len(texts)), format="ascii")
        array.text = " ".join(str(code) for name_in_ascii in texts for code in (*name_in_ascii.encode(), 0))
    counts = {"Points": structure.n_nodes, "Verts": 0, "Lines": n_members, "Strips": 0, "Polys": 0}
    piece = add(root[0], "Piece", **{f"NumberOf{key}": str(value) for key, value in counts.items()})
    _add_array(add(piece, "PointData", Vectors="load"), "load", shapes.node_load[sample])
    cells = add(piece, "CellData", Scalars="tension")
    _add_array(cells, "tension", shapes.member_tension[sample])
    _add_array(cells, "kind", structure.is_bar.astype("i4"))
    _add_array(cells, "member", np.arange(n_members, dtype="i4"))
    _add_array(add(piece, "Points"), "Points", shapes.node_position[sample])
    lines = add(piece, "Lines")
    _add_array(lines, "connectivity", structure.connectivity.ravel())
    _add_array(lines, "offsets", np.arange(2, 2 * n_members + 1, 2))
    indent(root)
    return bytes(tostring(root, encoding="utf-8", xml_declaration=True))


def _begin(kind: str) -> Element:
    root = Element("VTKFile", type=kind, version="1.0", byte_order="LittleEndian", header_type="UInt64")
    add(root, kind)
    return root


def _add_array(above: Element, name: str, values: ArrayLike) -> None:
    """Add an array: its number of bytes (UInt64) and they themselves, little-endian, in base 64."""
    array = np.asarray(values)
    array = array.astype(array.dtype.newbyteorder("<"))
    kind = f"{'Float' if array.dtype.kind == 'f' else 'Int'}{8 * array.itemsize}"
    element = add(above, "DataArray", type=kind, Name=name, format="binary")
    if array.ndim > 1:
        element.set("NumberOfComponents", str(array.shape[1]))
    element.text = b64encode(np.uint64(array.nbytes).astype("<u8").tobytes() + array.tobytes()).decode()


EXPORTER = Exporter(
    name="vtk",
    title="lines with tensions and loads, for ParaView (VTK: .vtp; a motion: .pvd)",
    endings=(".vtp", ".pvd"),
    write=write_vtk,
    options=("trajectory",),
    order=70,
)
