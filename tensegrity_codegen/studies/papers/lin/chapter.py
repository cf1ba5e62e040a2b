"""The chapter on LIN: the prism under load, its tables and Fig. 4, and the largest load."""

from functools import partial
from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Chapter, Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Table, compare_cell, compare_cells, make_table
from tensegrity_codegen.studies.papers.lin.events import FACTORS, maximum_section, stiffness_section
from tensegrity_codegen.studies.papers.lin.tables import compare_sensitivity, compare_tables, compare_unloaded
from tensegrity_codegen.studies.study import build_sections, run_study
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.progress import ProgressFunction

SUBSCRIPT = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
MAX_STEADY = 20.0  # [%] of change with the load, beyond which a spring's difference counts as growing
HOW_TO_READ = "In each field, from above: {above}, ours, ours minus {above}."


def measured_section(data: dict[str, Any]) -> Section:
    """Return Table 1: extensions measured by the authors beside ours."""
    mean, printed = 100 * data["mean_error_ours"], 100 * data["mean_error_paper"]
    worst = float(np.abs(data["ours_minus_measured"]).max())
    worst_printed = float(np.abs(data["paper"] - data["measured"]).max())
    return Section(
        "lin-table-1",
        "Table 1",
        "Extensions of the springs, measured",
        "differs",
        f"mean relative error of ours {mean:.2f} %, of the paper's computed values {printed:.2f} %; largest "
        f"difference {worst:.2f} and {worst_printed:.2f} mm",
        (
            Paragraph(
                "A load on B₃ along −z grows from 0 to 10 N; the extensions of all six springs were "
                "measured with calipers. Ours are equilibria of the general model of bodies, with the "
                "printed parameters: a = 0.41 m, L = 0.578 m, K = 173.2 N/m, rest lengths 0.336 m at the "
                "sides and 0.356 m at the top."
            ),
            _compare_table(
                "Table 1 (measured) and ours [mm].", data, (data["measured"], data["ours"]), ".3f", "measured"
            ),
            Remark(
                "differs",
                "Even without load the three springs of each "
                "kind differ in the measurements by up to 4.4 mm, though the model is symmetrical: the "
                "prototype is not. Joint friction and the mass of the springs are not modelled, as in "
                "the paper.",
                ("lin-columns",),
            ),
        ),
        "we_differ",
        ((worst, "mm"),),
    )


def extension_section(data: dict[str, Any]) -> Section:
    """Return Table 2: extensions computed in print beside ours."""
    worst = data["largest_difference_to_paper"]
    comparisons = list(compare_sensitivity())
    keys = ("name", "side", "bar_length", "largest_difference", "nearest")
    sensitivity = make_table(
        "What other parameters would give.",
        {"parameters": "", "a [m]": ".4f", "L [m]": ".4f", "largest difference to Table 2 [mm]": ".2f"}
        | {"first row: nearest symmetrical [mm away]": ".2f", "mean error to Table 1 [%]": ".2f"},
        ((*(row[key] for key in keys), 100 * row["mean_error"]) for row in comparisons),
    )
    return Section(
        "lin-table-2",
        "Table 2",
        "Extensions of the springs, computed",
        "differs",
        f"up to {worst:.2f} mm, because the printed parameters are not those that were computed with",
        (
            _compare_table(
                "Table 2 (computed in print) and ours [mm].",
                data,
                (data["paper"], data["ours"]),
                ".3f",
                "paper",
            ),
            Remark(
                "differs",
                f"{_describe_growth(data)} With the printed a and L no symmetrical configuration at all "
                "has the lengths of the first row; the nearest is 1.39 mm away. A change of a by 2.9 mm "
                "or of L by 1.2 mm makes the first row possible, but does not stop the growth: up to "
                f"{comparisons[1]['largest_difference']:.2f} and "
                f"{comparisons[2]['largest_difference']:.2f} mm are left. "
                "So the lengths do not explain it alone.",
                ("lin-parameters", "lin-columns"),
            ),
            sensitivity,
        ),
        "data_missing",
        ((worst, "mm"),),
    )


def _describe_growth(data: dict[str, Any]) -> str:
    """Return how the differences to Table 2 change from the first load to the last."""
    start, end = np.abs(data["ours_minus_paper"])[[0, -1]]
    growth = 100 * (end / start - 1)
    names = [name.translate(SUBSCRIPT) for name in data["columns"]]
    growing = [k for k in np.argsort(-growth) if growth[k] > MAX_STEADY]
    steady = np.delete(growth, growing)
    grown = ", ".join(f"{names[k]} by {growth[k]:.0f} %" for k in growing)
    return (
        f"The difference is there without load already, {start.min():.2f} to {start.max():.2f} mm, and grows "
        f"to {end.min():.2f} to {end.max():.2f} mm at {-data['load'][-1]:.0f} N: at {grown}; the other "
        f"springs' change by {steady.min():.0f} to {steady.max():.0f} %.".replace("-", "−")
    )


def unloaded_section() -> Section:
    """Return the section without a load: extensions, angles, stability."""
    compared = compare_unloaded()
    differences = [row["difference"] for row in compared if row["difference"] is not None]
    rows = [(row["name"], row["unit"], *compare_cells(row["paper"], row["ours"], ".3f")) for row in compared]
    columns = {"what": "", "unit": "", "paper": ".3f", "ours": ".3f", "difference": ".3f"}
    return Section(
        "lin-unloaded",
        "Table 2, first row",
        "The prism without load",
        "differs",
        "side springs {:.2f} mm and top springs {:.2f} mm longer than printed".format(*differences),
        (
            make_table(
                "Without load; the paper's extensions are means over the springs of a kind.", columns, rows
            ),
            Remark(
                "differs",
                "The configuration is stable: the smallest eigenvalue of the Hessian is positive. No "
                "symmetrical configuration at all has the printed extensions.",
                ("lin-parameters",),
            ),
        ),
        "data_missing",
        ((max(differences), "mm"),),
    )


def error_section(data: dict[str, Any]) -> Section:
    """Return Table 3: relative errors printed, recomputed from the printed tables, and ours."""
    worst = 100 * data["largest_difference_of_table_3"]
    mean, printed = 100 * data["mean_error_ours"], 100 * data["mean_error_paper"]
    largest, most_printed = (100 * float(data[f"error_{who}"].max()) for who in ("ours", "paper"))
    return Section(
        "lin-table-3",
        "Table 3",
        "Relative errors between computation and measurement",
        "agrees",
        f"the printed errors follow from Tables 1 and 2 within {worst:.3f} points; against the measurements "
        f"paper {printed:.2f} % in the mean and {most_printed:.2f} % at most, ours {mean:.2f} % and "
        f"{largest:.2f} %",
        (
            _compare_table(
                "|computed − measured| / computed [%].",
                data,
                (100 * data["error_printed"], 100 * data["error_ours"]),
                ".2f",
                "paper",
            ),
            Remark(
                "agrees",
                "The errors are recomputed from the printed tables and agree with Table 3. Ours are "
                "those of our extensions against the same measurements: smaller in the mean, larger at "
                "A₂B₃, whose extension goes down to 10 mm, so that a millimetre there is 10 %.",
            ),
        ),
        errors=((largest, "%"),),
    )


def figure_section(data: dict[str, Any]) -> Section:
    """Return Fig. 4: each spring's extension against the load."""
    return Section(
        "lin-fig-4",
        "Fig. 4",
        "Extensions against the load",
        "differs",
        "almost linear up to 10 N, as printed; computed curves apart as in Table 2",
        (
            Paragraph(
                "The paper's curves are its Tables 1 and 2. The relation is almost linear, as it says; "
                "A₂B₃, the spring below the load, slackens, and would go slack at 13.17 N."
            ),
            *(_spring_figure(data, k) for k in range(6)),
            Remark("differs", "The curves differ by what the tables differ by.", ("lin-parameters",)),
        ),
        "data_missing",
    )


def _compare_table(
    caption: str, data: dict[str, Any], compared: tuple[FloatArray, FloatArray], spec: str, above: str
) -> Table:
    """Return two arrays (11, 6) above each other: a row a load, a column a spring and its symbol."""
    columns = {"F₃z [N]": ".0f"}
    columns |= {f"{name} [ΔL{k}]".translate(SUBSCRIPT): spec for k, name in enumerate(data["columns"], 1)}
    rows = (
        (load, *(compare_cell(a, b, spec) for a, b in zip(theirs, ours, strict=True)))
        for load, theirs, ours in zip(data["load"], *compared, strict=True)
    )
    return make_table(caption, columns, rows, note=HOW_TO_READ.format(above=above))


def _spring_figure(data: dict[str, Any], k: int) -> Figure:
    name = data["columns"][k]
    curves = data["figure_4"][name]
    load = -np.asarray(data["load"])
    series = [
        Series("measured", load, curves["measured"], "points", color=1),
        Series("paper", load, curves["paper"], "dashed", color=2),
        Series("ours", load, curves["ours"], color=0),
    ]
    diagram = Diagram("load on B₃, downwards [N]", "extension [mm]", series)
    title = name.translate(SUBSCRIPT)
    return diagram_figure(
        f"lin-fig-4-{name}",
        diagram,
        f"({'abcdef'[k]}) Spring {title}, {f'ΔL{k + 1}'.translate(SUBSCRIPT)} in print.",
        f"Extension of spring {name} against the load: measured points, printed and our curve close "
        "together.",
    )


QUICK_FACTORS = (0.5, 1.0, 2.0)


def build_lin_chapter(
    quick: bool = False, progress: ProgressFunction | None = None, journal: Journal | None = None
) -> Chapter:
    """Return the chapter; quick: fewer spring constants and directions of load. Raises what studies raise."""
    data = run_study("LIN Tables 1 to 3", compare_tables)
    steps = (
        ("LIN Table 1", 0.5, partial(measured_section, data)),
        ("LIN Table 2", 0.5, partial(extension_section, data)),
        ("LIN without load", 1.0, unloaded_section),
        ("LIN Table 3", 0.5, partial(error_section, data)),
        ("LIN Fig. 4", 1.0, partial(figure_section, data)),
        ("LIN spring constants", 3.0, partial(stiffness_section, QUICK_FACTORS if quick else FACTORS)),
        ("LIN largest load", 3.0, partial(maximum_section, quick)),
    )
    return Chapter(
        "lin",
        "LIN",
        "a three-bar prism under load",
        "Min Lin, Tuanjie Li, Zhifei Ji, Mingkui Che: Force-Displacement Relationships of a Tensegrity "
        "Structure Considering Bar Interference.",
        build_sections(steps, progress, journal),
    )
