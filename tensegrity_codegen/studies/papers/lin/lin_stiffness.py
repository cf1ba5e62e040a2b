"""LIN: the external force against the spring constants, announced in its abstract."""

from collections.abc import Sequence
from typing import Any

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell
from tensegrity_codegen.studies.papers.lin.stiffness import compare_stiffness

NAMES = {"all": "all springs", "side": "side springs", "top": "top springs"}


def stiffness_section(factors: Sequence[float]) -> Section:
    """Return the section for these factors of the printed spring constant."""
    data = compare_stiffness(factors)
    descent = 1e3 * data["descent_10"]
    return Section(
        "lin-spring-constants",
        "Abstract",
        "External force against spring constants",
        "new",
        "doubling all springs doubles the force within the bars' weight; at 10 N, B₃ has come down "
        f"{descent:.1f} mm",
        (
            Paragraph(
                "The force on B₃ that brings it down by a given amount, and the largest load before bars "
                "touch, over the spring constants of all springs, of the side springs and of the top "
                "springs. Rest lengths stay as printed, so that stiffer springs are tighter, too."
            ),
            diagram_figure(
                "lin-spring-constants-force",
                _diagram(data, "force_10", f"force for {descent:.1f} mm [N]"),
                f"Force on B₃ that brings it down by {descent:.1f} mm, as 10 N do with the printed springs.",
                "Force against spring constant: proportional for all springs, bent for one kind alone.",
            ),
            diagram_figure(
                "lin-spring-constants-maximum",
                _diagram(data, "maximum", "largest load [N]"),
                "Largest load before two bars touch.",
                "Largest load against spring constant, for all, side and top springs.",
            ),
            _table(data),
            Remark(
                "new",
                "The abstract says that the evolution of the external force was studied along with that "
                "of the spring constants; no formula, table or figure of the text shows it.",
                ("lin-stiffness",),
            ),
        ),
    )


def _diagram(data: dict[str, Any], key: str, label: str) -> Diagram:
    constant = data["spring_constant"]
    series = [
        Series(name, constant, data[kind][key], color=color, marker="osD"[color])
        for color, (kind, name) in enumerate(NAMES.items())
    ]
    return Diagram("spring constant [N/m]", label, series, vertical=((173.2, "printed: 173.2 N/m"),))


def _table(data: dict[str, Any]) -> Table:
    columns = [Column("K / printed"), Column("K", "N/m")]
    columns += [Column(f"force, {name}", "N") for name in NAMES.values()]
    columns += [Column(f"largest, {name}", "N") for name in NAMES.values()]
    rows = tuple(
        (
            number_cell(factor, ".2f"),
            number_cell(data["spring_constant"][k], ".1f"),
            *(number_cell(data[kind]["force_10"][k], ".3f") for kind in NAMES),
            *(number_cell(data[kind]["maximum"][k], ".3f") for kind in NAMES),
        )
        for k, factor in enumerate(data["factor"])
    )
    caption = f"Force for a descent of {1e3 * data['descent_10']:.1f} mm, and the largest load."
    return Table(caption, tuple(columns), rows)
