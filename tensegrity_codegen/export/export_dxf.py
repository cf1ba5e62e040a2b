"""Export to DXF, for CAD: a line for each member, on layers of bars and cables (package `ezdxf`)."""

from pathlib import Path

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource, read_shapes
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.extras import CAD, import_extra

METRES = 6  # $INSUNITS
COLORS = {"bars": 30, "cables": 5}  # of AutoCAD's index: orange, blue


def write_dxf(
    source: ExportSource, path: Path, *, trajectory: Path | None = None, sample: float | None = None
) -> Exported:
    """Write the shape of a scene, or one sample of a motion (by default the last), as lines in metres."""
    # A member of groups is on the layer of its kind and its smallest group, "cables-verticals", but for
    # groups that are called bars or cables.
    ezdxf = import_extra("ezdxf", CAD)
    if sample is not None and trajectory is None:
        raise InvalidValueError(
            "only a motion has samples", where="sample", given=sample, allowed="with a trajectory only"
        )
    shapes = read_shapes(source, trajectory)
    structure, n_samples = shapes.structure, len(shapes.time)
    chosen = -1 if sample is None else sample
    if chosen not in range(-n_samples, n_samples):
        allowed = f"0 to {n_samples - 1}, or -{n_samples} to -1 from the end"
        raise InvalidValueError("there is no such sample", where="sample", given=sample, allowed=allowed)
    # The layer of each member, and its line.
    largest_first = sorted(structure.groups.items(), key=lambda item: -len(item[1]))
    group_of = {row: name for name, rows in largest_first if name not in COLORS for row in rows}
    document = ezdxf.new("R2010", units=METRES)
    position = shapes.node_position[int(chosen)]
    for row, (start, end) in enumerate(structure.connectivity):
        kind = "bars" if structure.is_bar[row] else "cables"
        layer = f"{kind}-{group_of[row]}" if row in group_of else kind
        if layer not in document.layers:
            document.layers.add(layer, color=COLORS[kind])
        ends = position[start].tolist(), position[end].tolist()
        document.modelspace().add_line(*ends, dxfattribs={"layer": layer})
    document.saveas(path)
    facts = {"n_members": structure.n_members, "time": float(shapes.time[int(chosen)])}
    lost = "the file has lines alone: no names, stiffnesses, masses, anchors and loads"
    return Exported(facts, (lost, *shapes.notes))


EXPORTER = Exporter(
    name="dxf",
    title="lines on layers of bars and cables, for CAD (DXF)",
    endings=(".dxf",),
    write=write_dxf,
    options=("trajectory", "sample"),
    order=50,
)
