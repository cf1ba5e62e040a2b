"""SCS Figs 4 to 11: angles, rest lengths, tensions and torque of both reconfigurations over time."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Remark, Section, Verdict, diagram_figure
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.studies.papers.scs.scs_equilibria import NAMES, UNITS

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
    parts = []
    for name, values in data["curves"].items():
        low, high = (format(value, spec).replace("-", "−") for value in (values.min(), values.max()))
        parts.append(f"{NAMES[name].partition(',')[0]} {low} to {high}{gap}{unit}")
    return "; ".join(parts)


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
    rows = tuple(
        (
            text_cell(NAMES[name]),
            *(number_cell(float(values[row]), spec) for row in picked),
            number_cell(float(values.min()), spec),
            number_cell(float(values.max()), spec),
        )
        for name, values in data["curves"].items()
    )
    columns = (
        Column("quantity", unit, numeric=False),
        *(Column(f"{time[row]:g} s") for row in picked),
        *(Column("least"), Column("largest")),
    )
    return Table("Values of the curves.", columns, rows)
