"""A load path as a page: load factor over displacement with its events, shapes, stiffness."""

from collections.abc import Mapping, Sequence

import numpy as np

from tensegrity_codegen.report.analysis_tables import LIMIT_NAMES
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.diagram import MARKERS, Diagram, Series
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Figure,
    Page,
    Remark,
    Section,
    as_sentence,
    command_section,
    diagram_figure,
    join_names,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import draw_picture, draw_tensions
from tensegrity_codegen.report.pictures.draw import pad_tension
from tensegrity_codegen.report.result_tables import describe_excess, find_first_events
from tensegrity_codegen.runtime.paths.load_path import STABILITY_LOSS_EVENTS, LoadPath, PathEvent
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import name_list
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION

MAX_SHAPES = 4  # at events, beside start and end
LEAD = (
    "Equilibria under an increasing load, through limit points. At load factor 1 the load is the one stated. "
    "Tensions are positive, compressions negative; dotted lines show the start."
)


def build_path_page(
    path: LoadPath,
    events: Sequence[PathEvent],
    structure: Structure,
    position: FloatArray,
    columns: Mapping[str, FloatArray],
    flaws: Sequence[str],
    command: str,
) -> Page:
    """Return the page of a load path of at least one point.

    structure: the drawn one; position (n_points, n_nodes, 3) [m]; columns: of the table of the path.
    """
    excess = [_name_limits(sentence) for sentence in describe_excess(path.events, 5)]
    title = "; ".join([path.message[:1].upper() + path.message[1:], *excess])
    if path.stable_up_to is not None:
        title += f"; stable up to {format_short(path.stable_up_to, 5)} only"
    elif path.near_bifurcation is not None:
        title += f"; near a bifurcation at {format_short(path.near_bifurcation, 5)}"
    elif events and path.status == "completed" and not excess:
        of = f" of {name_list(events[0].names, 1)}" if events[0].names else ""
        title += f"; first event: {events[0].kind}{of} at {format_short(float(events[0].load_factor), 5)}"
    largest = format_short(float(path.load_factor.max()), 5)
    curve: tuple[Block, ...] = _path(path, events, structure, position)
    curve += tuple(Remark("differs", as_sentence(flaw)) for flaw in [*path.describe_stability(5), *flaws])
    shapes = tuple(_shapes(path, events, structure, position, columns))
    series = [Series("", path.load_factor, path.smallest_eigenvalue)]
    diagram = Diagram("load factor", "smallest eigenvalue [N/m]", series)
    caption = "Smallest eigenvalue of the tangent stiffness: positive where the equilibrium is stable."
    stiffness = diagram_figure("stiffness", diagram, caption, caption)
    sections = (
        Section("path", "", "Path and events", "plain", "", curve),
        Section("shapes", "", "Shapes", "plain", "", shapes),
        Section("stiffness", "", "Stability", "plain", "", (stiffness,)),
        command_section(command),
    )  # fmt: skip
    counts = f"{describe_count(len(path.load_factor), 'point')}, {describe_count(len(events), 'event')}"
    return Page(
        subject=f"Load path of {structure.name}",
        title=title,
        lead=LEAD,
        chapters=(
            Chapter("load-path", structure.name, "", f"{counts}, load factors up to {largest}.", sections),
        ),
        facts=(f"tensegrity_codegen {VERSION}.", "Equations, events and statuses: docs/statics.md."),
    )


def _path(
    path: LoadPath, events: Sequence[PathEvent], structure: Structure, position: FloatArray
) -> tuple[Figure, Table]:
    """Return the curve with its events, and the table of the events."""
    moved = 1000 * (position - position[0])
    moved[:, structure.is_corner] = 0.0
    node, axis = np.unravel_index(int(np.abs(moved).max(axis=0).argmax()), moved.shape[1:])
    displaced = moved[:, node, axis]
    series = [Series("", displaced, path.load_factor, marker="" if len(displaced) > 1 else "o")]
    for k, kind in enumerate(dict.fromkeys(event.kind for event in events), start=1):
        points = [event.point for event in events if event.kind == kind]
        factor = [event.load_factor for event in events if event.kind == kind]
        series.append(Series(kind, displaced[points], factor, "points", k, MARKERS[k % len(MARKERS)]))
    name = structure.node_name[node]
    label = f"displacement of {name} along {'xyz'[axis]} [mm]"
    caption = f"Load factor over the displacement of {name}, the node that moves most; marks: events."
    rows = tuple(
        (
            number_cell(event.load_factor, ".6g"),
            text_cell(event.kind),
            text_cell(_name_limits(join_names(event.names, 8))),
        )
        for event in events
    )
    heads = (Column("load factor"), Column("event", numeric=False), Column("of", numeric=False))
    figure = diagram_figure("path", Diagram(label, "load factor", series), caption, caption)
    return figure, Table("Events" if rows else "No event", heads, rows)


def _name_limits(label: str) -> str:
    """Return a text about events with its limits in words."""
    for key, limit in LIMIT_NAMES.items():
        label = label.replace(f"({key})", f"({limit})")
    return label


def _shapes(
    path: LoadPath,
    events: Sequence[PathEvent],
    structure: Structure,
    position: FloatArray,
    columns: Mapping[str, FloatArray],
) -> list[Figure]:
    """Return the structure at the start, where it loses stability, at the first of each event, at the end."""
    last = len(position) - 1
    lost = [event for event in path.events if event.kind in STABILITY_LOSS_EVENTS]
    lost = [event for event in lost if event.load_factor == path.stable_up_to]
    points = [event.point for event in [*lost, *(events[k] for k in find_first_events(events))]]
    drawn_points = [last, *list(dict.fromkeys(points))[:MAX_SHAPES]]
    at: dict[int, str] = {}
    for event in events:
        if event.point in drawn_points:
            at[event.point] = ", ".join(filter(None, (at.get(event.point, ""), event.kind)))
    rows = sorted({0, *at, last})
    tension = np.stack([values for name, values in columns.items() if name.startswith("tension_")], axis=-1)
    drawn = pad_tension(tension, structure)
    figures = []
    for row in rows:
        labels = filter(None, ("start" * (row == 0), at.get(row, ""), "end" * (row == last)))
        caption = f"Load factor {format_short(float(path.load_factor[row]), 5)}: {', '.join(labels)}."
        picture = draw_tensions(
            structure, position[row], drawn[row], "member tension [N]",
            among=(position[rows], drawn[rows]), shadow=position[0] if row else None,
        )  # fmt: skip
        data = {"node_position": position[row].tolist()}
        figures.append(Figure(draw_picture(picture, f"shape{row}"), caption, caption, data))
    return figures
