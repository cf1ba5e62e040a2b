"""S&K Fig. 5: motions in node positions and in node distances, and the constraints over a long time."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table, number_cell, text_cell
from tensegrity_codegen.studies.papers.sk.drift import measure_constraint_drift
from tensegrity_codegen.studies.papers.sk.trajectory_difference import compare_trajectories

PAPER_BOUND = 1e-5  # [m], "the error per coordinate is less than 10^-5"
# Differences below the rounding of a coordinate are drawn there.
LEAST = 1e-17


def trajectory_section(t_end: float) -> Section:
    """Return the section that compares motions of a free prism over t_end [s]."""
    data = compare_trajectories(t_end=t_end)
    equal = float(data["equal_steps"].max())
    return Section(
        "sk-fig-5",
        "Fig. 5",
        "Discrepancy between node positions and node distances",
        "agrees",
        f"paper below 10⁻⁵ with variable steps; ours {format_number(equal, '.0e')} m with equal steps",
        (
            Paragraph(
                "The three-bar prism of the paper's Fig. 1, free in space, started with random "
                "velocities; the paper gives no data of its structure. Both models are integrated over "
                "the same time, with equal steps and with an adaptive Runge-Kutta 4(5) at several "
                "tolerances, as the paper does."
            ),
            *_trajectory_figures(data),
            _trajectory_table(data),
            Remark(
                "agrees",
                "The paper's 10⁻⁵ is what two runs with variable steps differ by at an everyday "
                "tolerance: ours brackets it with tolerances of 10⁻³ and 10⁻⁶. It says nothing of the "
                "model: with equal steps the two agree to rounding.",
                ("sk-discrepancy",),
            ),
        ),
    )


def drift_section(t_end: float) -> Section:
    """Return the section on the linear invariant over t_end [s]."""
    data = measure_constraint_drift(t_end=t_end)
    largest = float(data["drift"].max())
    return Section(
        "sk-drift",
        "Eq. (4.2)",
        "The constraints over a long time",
        "new",
        f"Lᵀδ drifts by {format_number(largest, '.0e')} m at most in {data['n_steps']:,} steps",
        (
            Paragraph(
                "Lᵀδ = 0 is a linear invariant, which every Runge-Kutta method keeps; only rounding adds "
                "up. The integrator in C sets the closing pairs from the spanning tree after each step. "
                f"The longest member measures {data['size']:.3f} m; Runge-Kutta 4 in C with steps of "
                f"{data['step']:g} s."
            ),
            diagram_figure(
                "sk-drift-time",
                Diagram(
                    "time [s]",
                    "largest change of Lᵀδ [m]",
                    [Series("", data["time"], np.maximum(data["drift"], LEAST), color=0)],
                    log_y=True,
                    y_limits=(LEAST / 2, 1e-11),
                    horizontal=((1e-13, "10⁻¹³ m"),),
                ),
                f"Change of the constraints since the start, {t_end:g} s.",
                "The change of the constraints stays near 10⁻¹⁶ m throughout.",
            ),
            Remark("new", "The paper does not look at it.", ("sk-rounding",)),
        ),
    )


def _trajectory_figures(data: dict[str, Any]) -> tuple[Figure, ...]:
    """Return the discrepancies over time: one figure."""
    series = [
        Series(f"adaptive, {_power(tolerance)}", data["time"], _shown(found["difference"]), color=1 + color)
        for color, (tolerance, found) in enumerate(data["adaptive"].items())
    ]
    series.append(Series("equal steps", data["time"], _shown(data["equal_steps"]), color=0))
    diagram = Diagram(
        "time [s]",
        "largest discrepancy [m]",
        series,
        log_y=True,
        horizontal=((PAPER_BOUND, "paper: below 10⁻⁵"),),
        legend_columns=2,
    )
    return (
        diagram_figure(
            "sk-fig-5-time",
            diagram,
            "Largest discrepancy of a node coordinate between the two models.",
            "Discrepancy over time, logarithmic: about 10⁻¹⁶ m with equal steps, below each tolerance "
            "with adaptive steps.",
        ),
    )


def _trajectory_table(data: dict[str, Any]) -> Table:
    step = format_number(data["step"], "g")
    rows: list[tuple[Cell, ...]] = [
        (
            text_cell(f"equal steps of {step} s, Runge-Kutta 4 in C"),
            *_values(None, float(data["equal_steps"].max())),
        )
    ]
    for kind, name in (("adaptive", "adaptive Runge-Kutta 4(5)"), ("auto", "halved steps in C")):
        for tolerance, found in data[kind].items():
            error = max(float(values.max()) for values in found["error"].values())
            label = text_cell(f"{name}, tolerance {_power(tolerance)}")
            rows.append(
                (label, *_values(error, float(found["difference"].max()), printed=kind == "adaptive"))
            )
    return Table(
        "Largest discrepancy between the two models, and error of the worse of them against a run at 10⁻¹².",
        (
            Column("integration", numeric=False),
            Column("paper", "m"),
            Column("ours: discrepancy", "m"),
            Column("ours: error", "m"),
        ),
        tuple(rows),
    )


def _values(error: float | None, difference: float, *, printed: bool = False) -> tuple[Cell, ...]:
    bound = Cell((("paper", "< 10⁻⁵"),), PAPER_BOUND) if printed else number_cell(None, "g")
    return (bound, number_cell(difference, ".1e", "ours"), number_cell(error, ".1e"))


def _power(tolerance: float) -> str:
    return format_number(tolerance, ".0e").removeprefix("1 × ")


def _shown(values: NDArray[np.float64]) -> NDArray[np.float64]:
    shown: NDArray[np.float64] = np.maximum(values, LEAST)
    return shown
