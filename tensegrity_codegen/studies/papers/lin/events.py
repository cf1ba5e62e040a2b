"""The largest load: first slack spring, first contact of bars, limit point, located by root finding.

LIN 1 promises "to determine the maximum of the applied force" and never gives it. Up to the first contact of
two bars the path is that of the real prism; beyond it the bars of the model pass through each other, and the
limit point is what the prism would carry if they could.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Table, make_table, number_cell
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent
from tensegrity_codegen.runtime.paths.model_path import ModelPath, watch_contact, watch_slack
from tensegrity_codegen.studies.papers.lin.tables import compile_prism, place_load, settle

LAWS = {"linear": False, "tension_only": True}  # springs, and whether they go slack
DIRECTIONS = {
    "+x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "+z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
}
MAX_LOAD = 60.0  # [N], to which loads grow
CONTROL = StepControl(largest=0.05, most_steps=2000)


def follow_load(
    model: CompiledModel,
    top: int = 3,
    direction: str = "-z",
    *,
    most: float = MAX_LOAD,
    past_contact: bool = False,
    control: StepControl = CONTROL,
    **arguments: Any,
) -> tuple[ModelPath, LoadPath]:
    """Return the problem and the path of equilibria while a force on one top grows from 0 to `most` [N].

    past_contact: go on where bars touch, though they then pass through each other.
    """
    problem = ModelPath(model, place_load(top, DIRECTIONS[direction]), arguments)
    watches = [
        watch_slack(problem, model.manifest.member_name),
        watch_contact(problem, stops=not past_contact),
    ]
    start = settle(model, np.zeros((1, 3, 3)), **arguments).coordinate[0]
    return problem, follow_path(problem, start, most=most, watches=watches, control=control)


def find_load_events(
    *,
    tension_only: bool = False,
    top: int = 3,
    direction: str = "-z",
    control: StepControl = CONTROL,
) -> dict[str, Any]:
    """Return the loads [N] of the first slack spring, the first contact and the first limit point.

    slack, contact, limit: {load, of} or None where there is none up to MAX_LOAD, in the order of the path.
    maximum: the largest load that the prism carries before bars touch or the load turns back, and `because`.
    is_stable: whether all configurations up to there are minima of the energy. events: all, in order.
    status: how the path ended.
    """
    model = compile_prism(tension_only=tension_only)
    _, path = follow_load(model, top, direction, past_contact=True, control=control)
    ends = path.find_events("contact", "limit")
    last = ends[0] if ends else None
    reached = len(path.load_factor) if last is None else last.point
    return {
        "law": "tension_only" if tension_only else "linear",
        "top": top,
        "direction": direction,
        "slack": _describe(path.find_events("slack")),
        "contact": _describe(path.find_events("contact")),
        "limit": _describe(path.find_events("limit")),
        "maximum": MAX_LOAD if last is None else last.load_factor,
        "because": "not reached" if last is None else last.kind,
        "is_stable": bool((path.smallest_eigenvalue[:reached] > 0).all()),
        "events": [event.as_dict() for event in path.events],
        "status": path.status,
    }


def survey_directions(
    tops: Iterable[int] = (1, 2, 3), directions: Iterable[str] = tuple(DIRECTIONS)
) -> list[dict[str, Any]]:
    """Return find_load_events for every top, direction and law of the springs, row by row."""
    ways = tuple(directions)
    return [
        find_load_events(tension_only=slack, top=top, direction=way)
        for slack in LAWS.values()
        for top in tops
        for way in ways
    ]


def _describe(events: tuple[PathEvent, ...]) -> dict[str, Any] | None:
    if not events:
        return None
    return {"load": events[0].load_factor, "of": events[0].names}


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
    heads = ("first slack spring [N]", "first contact of bars [N]", "limit point [N]")
    table = (
        (
            *(LAW[row["law"]], *map(_load, (row["slack"], row["contact"], row["limit"]))),
            *(number_cell(None, "g", "paper"), number_cell(row["maximum"], ".6f", "ours")),
        )
        for row in rows
    )
    return make_table(
        "Loads on B₃ along −z.",
        {"springs": ""} | dict.fromkeys((*heads, "paper: maximum [N]", "ours: maximum [N]"), ".6f"),
        table,
    )


def _survey_table(rows: list[dict[str, Any]]) -> Table:
    table = (
        (
            *(f"B{'₁₂₃'[row['top'] - 1]}", row["direction"].replace("-", "−"), SHORT_LAW[row["law"]]),
            *map(_load, (row["slack"], row["contact"], row["limit"])),
            number_cell(row["maximum"] if row["because"] in ENDS else None, ".3f", "ours"),
            KIND[row["because"]],
        )
        for row in rows
    )
    numbers = ("slack [N]", "contact [N]", "limit point [N]", "maximum [N]")
    return make_table(
        "Loads on each top along each axis, up to 60 N.",
        {"on": "", "along": "", "springs": ""} | dict.fromkeys(numbers, ".3f") | {"because": ""},
        table,
        note="A dash: does not happen up to 60 N. A contact after a limit point may have a smaller load.",
    )


def _load(event: dict[str, Any] | None) -> float | None:
    return None if event is None else float(event["load"])
