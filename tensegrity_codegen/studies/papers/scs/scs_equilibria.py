"""SCS (44), (45), (52), (53): tensions of the printed equilibria, and formulas against the full model."""

from typing import Any

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section
from tensegrity_codegen.report.pages.page_table import (
    Cell,
    Column,
    Table,
    compare_cells,
    number_cell,
    text_cell,
)
from tensegrity_codegen.studies.papers.scs.errata import check_errata
from tensegrity_codegen.studies.papers.scs.figures import compare_equilibria
from tensegrity_codegen.studies.papers.scs.paper_values import PAPER_POSES
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose, SymmetricTower

NAMES = {
    "T_S": "T_S, saddle",
    "T_V": "T_V, vertical",
    "T_D": "T_D, diagonal",
    "S_0": "S₀, saddle",
    "V_0": "V₀, vertical",
    "D_0": "D₀, diagonal",
    "alpha": "α",
    "delta": "δ",
    "delta_f": "δ at the end",
    "M_3": "M₃",
}
UNITS = {"deg": "°"}


def equilibrium_section(tower: SymmetricTower) -> Section:
    """Return the printed tensions and the printed end of (53) beside ours."""
    rows = compare_equilibria(tower)
    forces = [row for row in rows if row["unit"] == "N"]
    worst = max(abs(row["difference"]) for row in forces)
    relative = max(abs(row["with_printed_data"] / row["paper"] - 1) for row in forces if row["paper"] > 1)
    first, last = PAPER_POSES["45"], PAPER_POSES["52"]
    rounded = SymmetricPose.from_degrees(first.alpha_deg, first.delta_deg, round(first.height, 5))
    diagonal = tower.equilibrium(rounded, first.force)[2]
    return Section(
        "scs-equilibria",
        "(44), (45), (52), (53)",
        "Symmetrical equilibria",
        "agrees",
        f"every printed tension within {worst:.4f} N, with b = 2/3 m and Z = {first.height:.8g} m and "
        f"{last.height:.6g} m for the printed 0.67, 1.11 and 1.6 m",
        (
            Paragraph(
                "Tensions follow from the equations of all 18 coordinates, restricted to symmetrical "
                "configurations; what the restriction leaves out vanishes. Data: l = 1 m, J = 1 kg m², m "
                "= 1 kg, M_t = 1 kg, d = −1 N m s, 1000 N for each tendon; F₃ = −50 N in (44), (45) and "
                "50 N in (52), (53)."
            ),
            _equilibrium_table(rows),
            Remark(
                "agrees",
                "With the printed, rounded b = 0.67 m and Z the tensions are off by up to "
                f"{100 * relative:.0f} % (last column). Ours are with b = 2/3 m, Z = {first.height:.8g} m in "
                f"(44), (45) and Z = {last.height:.6g} m in (52), (53), chosen so that the printed tensions "
                f"come out. With Z = {rounded.height:.6g} m, two digits less, T_D "
                f"of (45) is {diagonal:.4f} N, printed as 43 N without decimals.",
                ("scs-data",),
            ),
        ),
        "ours_corrected",
        ((worst, "N"),),
    )


def formula_section(tower: SymmetricTower) -> Section:
    """Return how far the printed and the corrected formulas are from the full model."""
    rows = tuple(
        (
            text_cell(row["name"]),
            text_cell(row["equation"]),
            text_cell(row["unit"]),
            number_cell(row["error_as_printed"], ".2g", "paper"),
            number_cell(row["error_as_corrected"], ".1e", "ours"),
        )
        for row in check_errata(tower)
    )
    return Section(
        "scs-formulas",
        "(21), (23), (34), Appendix A",
        "Printed formulas against the full model",
        "differs",
        "four corrections; each makes the formula equal to the full model within rounding",
        (
            Table(
                "Largest difference from the full model over random symmetrical motions.",
                (
                    *(Column("what", numeric=False), Column("equation", numeric=False)),
                    *(Column("unit", numeric=False), Column("as printed"), Column("as corrected")),
                ),
                rows,
            ),
            Remark(
                "differs",
                "None of the printed formulas is used to compute anything on this page: the equations "
                "come from the general model by differentiation. The last row compares with the printed "
                "tensions.",
                ("scs-centrifugal", "scs-matrix", "scs-height", "scs-data"),
            ),
        ),
        "paper_wrong",
    )


def _equilibrium_table(rows: list[dict[str, Any]]) -> Table:
    table = tuple(
        (
            text_cell(row["equation"]),
            text_cell(NAMES[row["quantity"]]),
            text_cell(UNITS.get(row["unit"], row["unit"])),
            *_printed_cells(row),
            number_cell(row.get("with_printed_data"), ".2f"),
        )
        for row in rows
    )
    return Table(
        "Tensions of the printed equilibria, and the declination that the motion without torque ends at.",
        (
            *(Column("equation", numeric=False), Column("quantity", numeric=False)),
            *(Column("unit", numeric=False), Column("paper"), Column("ours"), Column("difference")),
            Column("from rounded data"),
        ),
        table,
    )


def _printed_cells(row: dict[str, Any]) -> tuple[Cell, ...]:
    """Return paper with its two decimals, ours and difference with four."""
    _, ours, difference = compare_cells(row["paper"], row["ours"], ".4f")
    paper = Cell((("paper", format_number(row["paper"], ".2f")),), row["paper"])
    return (paper, ours, difference)
