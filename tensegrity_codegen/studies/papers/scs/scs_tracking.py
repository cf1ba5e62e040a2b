"""Beyond SCS: the full model of 18 coordinates, driven by the controls of a reconfiguration alone."""

from typing import Any

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.studies.papers.scs.figures import compare_tracking
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricTower

MOTIONS = {
    "with_torque": "(44) to (45), with torque",
    "zero_torque": "(52) to (53), without torque",
    "prescribed": "(52) to (53), both angles prescribed",
}
TOLERANCE, QUICK_TOLERANCE = 1e-11, 1e-7


def tracking_section(tower: SymmetricTower, quick: bool) -> Section:
    """Return how the full model follows each motion, by our controls and by (34) as printed."""
    rtol = QUICK_TOLERANCE if quick else TOLERANCE
    rows = compare_tracking(tower, rtol=rtol, samples=21 if quick else 101)
    worst = {
        name: max(row["angle_error_deg"] for row in rows if row["controls"] == name)
        for name in ("ours", "as printed")
    }
    ours, printed = (format_number(worst[name], ".0e") for name in ("ours", "as printed"))
    return Section(
        "scs-tracking",
        "(32) to (35)",
        "The full model driven by these controls",
        "differs",
        f"angles follow the plan within {ours}° with our controls, within {printed}° with (34) as printed",
        (
            Paragraph(
                "All 18 coordinates start at rest and know nothing of symmetry: the generated C is given "
                "18 rest lengths and the torque M₃ as functions of time, without feedback. How far it "
                "leaves the planned motion measures the plan. Relative tolerance of the integration "
                f"{format_number(rtol, '.0e').removeprefix('1 × ')}."
            ),
            _table(rows),
            Remark(
                "differs",
                "With (34) as printed, without the centrifugal term, the tower misses the plan by many "
                "orders more than the integration does. The paper shows no simulation of the full model.",
                ("scs-centrifugal",),
            ),
        ),
        "paper_wrong",
    )


def _table(rows: list[dict[str, Any]]) -> Table:
    cells = tuple(
        (
            text_cell(MOTIONS[row["motion"]]),
            text_cell("ours" if row["controls"] == "ours" else "(34) as printed"),
            number_cell(row["angle_error_deg"], ".1e"),
            number_cell(row["other_error"], ".1e"),
            number_cell(row["asymmetry"], ".1e"),
        )
        for row in rows
    )
    return Table(
        "Largest errors over the whole motion.",
        (
            *(Column("motion", numeric=False), Column("controls", numeric=False)),
            *(Column("angles of the bars", "°"), Column("coordinates of the top", "rad, m")),
            Column("asymmetry of the bars", "rad"),
        ),
        cells,
    )
