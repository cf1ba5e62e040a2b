"""Beyond S&K: node positions and node distances far from the origin and in single precision."""

from typing import Any

import numpy as np

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.method_style import find_style
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table, number_cell, text_cell
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.offset_error import compare_offset_trajectories, compare_offsets
from tensegrity_codegen.studies.papers.sk.sample import sample_prism

# Nodes leave the equilibrium by about this much [m], so that the accelerations are not zero.
DISPLACEMENT = 0.01
QUANTITIES = {"member_tension": "tension", "acceleration": "acceleration"}
FORMULATIONS = {"node_position": "positions", "node_distance": "distances"}


def offset_section() -> Section:
    """Return the section with errors at several offsets, in double and in single precision."""
    rows = compare_offsets(_displaced_prism())
    motion = compare_offset_trajectories()
    far = [row for row in rows if row["precision"] == "double"][-1]
    worst, best = (far[f"{name}_acceleration"] for name in FORMULATIONS)
    return Section(
        "sk-offset",
        "beyond",
        "Far from the origin and in single precision",
        "new",
        f"at {_metres(far['offset'])}: error {format_number(worst, '.0e')} in positions, "
        f"{format_number(best, '.0e')} in distances",
        (
            Paragraph(
                "A prism out of equilibrium is moved along (1, 1, 1). In node positions the difference "
                "of two large coordinates loses digits; node distances know nothing of the offset. The "
                "same expressions as in the generated C are evaluated operation by operation in each "
                "precision, and compared with extended precision at the origin."
            ),
            diagram_figure(
                "sk-offset-error",
                _error_diagram(rows),
                "Largest error of a member tension over the largest tension. In single precision nodes "
                "coincide at 10⁹ m.",
                "Error against offset, both logarithmic: proportional to the offset in node positions, "
                "constant in node distances.",
            ),
            diagram_figure(
                "sk-offset-motion",
                _motion_diagram(motion),
                "A simulated motion in double precision: largest difference of a tension from the run at "
                f"the origin, largest tension {motion['largest_tension']:.1f} N.",
                "Difference of tensions over time: the larger the offset, the larger in node positions.",
            ),
            _error_table(rows),
            Remark(
                "new",
                "The paper does not claim this. In node distances the results are the same bit for bit "
                "at every offset, and single precision is usable; in node positions each factor of ten "
                "in the offset costs a digit.",
            ),
        ),
    )


def _displaced_prism() -> Structure:
    structure = sample_prism()
    change = np.random.default_rng(1).normal(scale=DISPLACEMENT, size=structure.node_position.shape)
    return structure.with_changes(node_position=structure.node_position + change)


def _error_diagram(rows: list[dict[str, Any]]) -> Diagram:
    """Return errors of the tension against the offset; the origin stands at 1 m on the logarithmic axis."""
    series = []
    for precision, style in (("double", "line"), ("single", "dashed")):
        chosen = [row for row in rows if row["precision"] == precision]
        offset = [max(row["offset"], 1.0) for row in chosen]
        for key, name in FORMULATIONS.items():
            error = [_or_nan(row[f"{key}_member_tension"]) for row in chosen]
            look = find_style(key)
            series.append(
                Series(f"{name}, {precision}", offset, error, style, look.color, look.marker)  # type: ignore[arg-type]
            )
    return Diagram(
        "offset [m] (0 shown at 1)", "relative error", series, log_x=True, log_y=True, legend_columns=2
    )


def _motion_diagram(motion: dict[str, Any]) -> Diagram:
    time = np.asarray(motion["time"])
    series = [
        Series(f"positions, {_metres(offset)}", time[1 : len(values)], values[1:], color=color)
        for color, (offset, values) in enumerate(motion["node_position"].items())
        if offset > 0
    ]
    return Diagram("time [s]", "difference of a tension [N]", series, log_y=True, legend_columns=2)


def _error_table(rows: list[dict[str, Any]]) -> Table:
    columns = [Column("offset", "m"), Column("precision", numeric=False)]
    columns += [
        Column(f"{what}, {name}", "relative error")
        for what in QUANTITIES.values()
        for name in FORMULATIONS.values()
    ]
    table = []
    for row in rows:
        cells: list[Cell] = [number_cell(row["offset"], ",.0f"), text_cell(row["precision"])]
        cells += [
            number_cell(row[f"{key}_{quantity}"], ".1e") for quantity in QUANTITIES for key in FORMULATIONS
        ]
        table.append(tuple(cells))
    return Table(
        "Errors far from the origin.",
        tuple(columns),
        tuple(table),
        note="A dash: nodes coincide in this precision, so that there is no result.",
    )


def _metres(offset: float) -> str:
    return f"{format_number(offset, '.0e').removeprefix('1 × ')} m"


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
