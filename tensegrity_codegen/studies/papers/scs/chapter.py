"""The chapter on SCS: the two-stage tower, its equilibria, its reconfigurations and where it can stand."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Chapter, Paragraph, Remark, Section, Verdict, diagram_figure
from tensegrity_codegen.report.pages.page_table import Cell, Table, compare_cells, make_table, number_cell
from tensegrity_codegen.studies.papers.scs.figures import (
    check_errata,
    compare_equilibria,
    compute_figures,
    load_paper_tower,
)
from tensegrity_codegen.studies.papers.scs.maps import map_section, tracking_section
from tensegrity_codegen.studies.papers.scs.printed import PAPER_POSES
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose, SymmetricTower
from tensegrity_codegen.studies.study import Step, build_sections, run_study
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.progress import ProgressFunction

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
    start, end = PAPER_POSES["45"], PAPER_POSES["52"]
    rounded = SymmetricPose.from_degrees(start.alpha_deg, start.delta_deg, round(start.height, 5))
    diagonal = tower.equilibrium(rounded, start.force)[2]
    return Section(
        "scs-equilibria",
        "(44), (45), (52), (53)",
        "Symmetrical equilibria",
        "agrees",
        f"every printed tension within {worst:.4f} N, with b = 2/3 m and Z = {start.height:.8g} m and "
        f"{end.height:.6g} m for the printed 0.67, 1.11 and 1.6 m",
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
                f"{100 * relative:.0f} % (last column). Ours are with b = 2/3 m, Z = {start.height:.8g} m in "
                f"(44), (45) and Z = {end.height:.6g} m in (52), (53), chosen so that the printed tensions "
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
    rows = (
        (
            *(row["name"], row["equation"], row["unit"]),
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
            make_table(
                "Largest difference from the full model over random symmetrical motions.",
                {"what": "", "equation": "", "unit": "", "as printed": ".2g", "as corrected": ".1e"},
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
    table = (
        (
            *(row["equation"], NAMES[row["quantity"]], UNITS.get(row["unit"], row["unit"])),
            *(*_printed_cells(row), row.get("with_printed_data")),
        )
        for row in rows
    )
    numbers = ("paper", "ours", "difference", "from rounded data")
    return make_table(
        "Tensions of the printed equilibria, and the declination that the motion without torque ends at.",
        {"equation": "", "quantity": "", "unit": ""} | dict.fromkeys(numbers, ".2f"),
        table,
    )


def _printed_cells(row: dict[str, Any]) -> tuple[Cell, ...]:
    """Return paper with its two decimals, ours and difference with four."""
    _, ours, difference = compare_cells(row["paper"], row["ours"], ".4f")
    paper = Cell((("paper", format_number(row["paper"], ".2f")),), row["paper"])
    return (paper, ours, difference)


WITH, WITHOUT, PRESCRIBED = "with torque", "without torque", "with both angles prescribed"
# Number -> motion, title, and what the paper's text says of the picture.
TEXTS = {
    4: (WITH, "Angles", "From 55° and 40° to 65° and 35° by the quintic (38) to (41)."),
    5: (WITH, "Rest lengths", "By (35) from lengths and tensions."),
    6: (WITH, "Tensions", "“Throughout the motion all tendons are in tension”: so they are."),
    7: (WITH, "Torque", "“A control torque is required”: so it is."),
    8: (WITHOUT, "Angles", "α by the quintic, δ by (48), which is linear in sin δ."),
    9: (WITHOUT, "Rest lengths", "By (35)."),
    10: (WITHOUT, "Tensions", "“The tendons are always in tension”: so they are."),
    11: (PRESCRIBED, "Torque", "“Though of small magnitude, a control torque is necessary”: so it is."),
}
CORRECTED = (6, 8, 10)  # whose curves depend on b or Z, which are rounded in print
ENDS = {4: "(44) and (45)", 6: "(44) and (45)", 8: "(52) and (53)", 10: "(52) and (53)"}


def motion_sections(figures: Mapping[str, Any]) -> list[tuple[str, Callable[[], Section]]]:
    """Return figure -> what builds its section, in the order of the paper."""
    return [
        (f"Fig. {number}", partial(_section, number, figures[f"Fig. {number}"])) for number in sorted(TEXTS)
    ]


def _section(number: int, data: dict[str, Any]) -> Section:
    motion, title, text = TEXTS[number]
    unit = UNITS.get(data["unit"], data["unit"])
    verdict: Verdict = "agrees" if number in ENDS else "unstated"
    ends = f" The ends are those printed in {ENDS[number]}." if number in ENDS else ""
    return Section(
        f"scs-fig-{number}",
        f"Fig. {number}",
        f"{title}, reconfiguration {motion}",
        verdict,
        _result(data, unit),
        (
            diagram_figure(
                f"scs-fig-{number}-time",
                _diagram(data, unit),
                f"{title} over time, reconfiguration {motion}, τ = 5 s.",
                f"{title} over time: {', '.join(NAMES[name] for name in data['curves'])}.",
            ),
            _table(data, unit),
            Remark(verdict, f"{text}{ends} The paper prints curves without numbers."),
        ),
        "ours_corrected" if number in CORRECTED else "",
    )


def _result(data: dict[str, Any], unit: str) -> str:
    """Return the range of each curve in one line."""
    spec = ".4f" if unit in ("m", "N m") else ".2f"
    gap = "" if unit == "°" else " "
    sections = []
    for name, values in data["curves"].items():
        low, high = (format(value, spec).replace("-", "−") for value in (values.min(), values.max()))
        sections.append(f"{NAMES[name].partition(',')[0]} {low} to {high}{gap}{unit}")
    return "; ".join(sections)


def _diagram(data: dict[str, Any], unit: str) -> Diagram:
    series = [
        Series(NAMES[name], data["time"], values, color=color)
        for color, (name, values) in enumerate(data["curves"].items())
    ]
    label = {"angles": "angle", "rest lengths": "rest length", "tensions": "tension"}
    return Diagram("time [s]", f"{label.get(data['title'], data['title'])} [{unit}]", series)


def _table(data: dict[str, Any], unit: str) -> Table:
    """Return each curve at six times."""
    time = np.asarray(data["time"])
    picked = np.linspace(0, len(time) - 1, 6).round().astype(int)
    spec = {"N m": ".5f", "m": ".5f"}.get(unit, ".3f")
    rows = (
        (NAMES[name], *(float(value) for value in (*values[picked], values.min(), values.max())))
        for name, values in data["curves"].items()
    )
    heads = (*(f"{time[row]:g} s" for row in picked), "least", "largest")
    return make_table("Values of the curves.", {f"quantity [{unit}]": ""} | dict.fromkeys(heads, spec), rows)


# Degrees between two points of the maps.
FULL_STEP, QUICK_STEP = 0.5, 3.0


def build_scs_chapter(
    quick: bool = False, progress: ProgressFunction | None = None, journal: Journal | None = None
) -> Chapter:
    """Return the chapter; quick: coarser maps and looser integration. Raises what the studies raise."""
    tower = run_study("SCS tower", load_paper_tower)
    figures = run_study("SCS Figs. 4 to 11", partial(compute_figures, tower))
    steps: tuple[Step, ...] = (
        ("SCS (44), (45), (52), (53)", 2.0, partial(equilibrium_section, tower)),
        *((f"SCS {figure}", 0.3, build) for figure, build in motion_sections(figures)),
        ("SCS tracking", 20.0, partial(tracking_section, tower, quick)),
        ("SCS maps", 2.0, partial(map_section, tower, QUICK_STEP if quick else FULL_STEP)),
        ("SCS formulas", 2.0, partial(formula_section, tower)),
    )
    return Chapter(
        "scs",
        "SCS",
        "a two-stage tower that changes its shape",
        "Symmetrical reconfiguration of tensegrity structures. Elsevier Science, 2002.",
        build_sections(steps, progress, journal),
    )
