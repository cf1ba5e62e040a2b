"""LIN: the maximum of the applied force, announced and not given."""

from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table, number_cell, text_cell
from tensegrity_codegen.studies.papers.lin.events import (
    find_load_events,
    follow_load,
    survey_directions,
)
from tensegrity_codegen.studies.papers.lin.model import compile_prism

LAW = {"linear": "linear springs", "tension_only": "springs that go slack"}
SHORT_LAW = {"linear": "linear", "tension_only": "go slack"}
KIND = {"contact": "bars touch", "limit": "limit point", "not reached": "not reached"}
QUICK_DIRECTIONS = ("-z", "+x")
ENDS = ("contact", "limit")


def maximum_section(quick: bool) -> Section:
    """Return the section on slack, contact and limit loads; quick: two directions on B_3 alone."""
    rows = [find_load_events(tension_only=law == "tension_only") for law in LAW]
    survey = survey_directions((3,), QUICK_DIRECTIONS) if quick else survey_directions()
    contact, slack = rows[0]["contact"]["load"], rows[0]["slack"]["load"]
    return Section(
        "lin-maximum-load",
        "Sections 1, 3.2",
        "The maximum of the applied force",
        "new",
        f"{rows[0]['maximum']:.6g} N on B₃ along −z, where bars 2 and 3 touch; the paper stops at 10 N",
        (
            Paragraph(
                "The path of equilibria is followed by arc length while the load grows; the first slack "
                "spring, the first contact of two bars (cylinders of 8 mm) and the limit point, where "
                "the load cannot grow further, are located by root finding. After a contact the bars of "
                "the model pass through each other, so that the limit point is what the prism would "
                "carry if they could."
            ),
            *_path_figures(contact, slack),
            _event_table(rows),
            Remark(
                "new",
                f"With linear springs, as in the paper, a spring that goes slack at {slack:.6g} N pushes "
                "from there on. With springs that go slack the contact comes a little earlier. Both lie "
                "above the 10 N of the measurements.",
                ("lin-maximum", "lin-cases"),
            ),
            _survey_table(survey),
        ),
    )


def _path_figures(contact: float, slack: float) -> tuple[Figure, ...]:
    """Return height of B_3 and stability along the path with linear springs, past the contact."""
    model = compile_prism()
    problem, path = follow_load(model, past_contact=True)
    node = model.manifest.node_name.index("bar3_B")
    height = [float(problem.compute("node_position", q, 0.0)[node, 2]) for q in path.coordinate]
    turns = int(np.argmax(path.load_factor)) + 1
    load = path.load_factor[:turns]
    marks = ((slack, "first slack spring"), (contact, "bars touch"))
    return (
        diagram_figure(
            "lin-path-height",
            Diagram("load on B₃, downwards [N]", "height of B₃ [m]", [Series("", load, height[:turns])],
                    vertical=marks[1:]),
            f"Height of B₃ up to the limit point; right of {contact:.2f} N the bars pass through each other.",
            "The height of B3 falls with the load, faster towards the limit point.",
        ),
        diagram_figure(
            "lin-path-eigenvalue",
            Diagram("load on B₃, downwards [N]", "smallest eigenvalue [N m]",
                    [Series("", load, path.smallest_eigenvalue[:turns], color=2)], vertical=marks[1:]),
            "Smallest eigenvalue of the Hessian: positive, thus stable, up to the limit point, where it "
            "vanishes.",
            "The smallest eigenvalue falls to zero at the limit point.",
        ),
    )  # fmt: skip


def _event_table(rows: list[dict[str, Any]]) -> Table:
    """Return the loads of the three events along -z on B_3, with both laws of the springs."""
    table = tuple(
        (
            text_cell(LAW[row["law"]]),
            *(_load(row[kind], ".6f") for kind in ("slack", "contact", "limit")),
            number_cell(None, "g", "paper"),
            number_cell(row["maximum"], ".6f", "ours"),
        )
        for row in rows
    )
    return Table(
        "Loads on B₃ along −z.",
        (
            Column("springs", numeric=False),
            Column("first slack spring", "N"),
            Column("first contact of bars", "N"),
            Column("limit point", "N"),
            Column("paper: maximum", "N"),
            Column("ours: maximum", "N"),
        ),
        table,
    )


def _survey_table(rows: list[dict[str, Any]]) -> Table:
    table = tuple(
        (
            text_cell(f"B{'₁₂₃'[row['top'] - 1]}"),
            text_cell(row["direction"].replace("-", "−")),
            text_cell(SHORT_LAW[row["law"]]),
            *(_load(row[kind], ".3f") for kind in ("slack", "contact", "limit")),
            number_cell(row["maximum"] if row["because"] in ENDS else None, ".3f", "ours"),
            text_cell(KIND[row["because"]]),
        )
        for row in rows
    )
    return Table(
        "Loads on each top along each axis, up to 60 N.",
        (
            *(Column(name, numeric=False) for name in ("on", "along", "springs")),
            *(Column("slack", "N"), Column("contact", "N"), Column("limit point", "N")),
            *(Column("maximum", "N"), Column("because", numeric=False)),
        ),
        table,
        note="A dash: does not happen up to 60 N. A contact after a limit point may have a smaller load.",
    )


def _load(event: dict[str, Any] | None, spec: str) -> Cell:
    return number_cell(None if event is None else event["load"], spec)
