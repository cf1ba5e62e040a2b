"""The largest load: first slack spring, first contact of bars, limit point, located by root finding.

LIN 1 promises "to determine the maximum of the applied force" and never gives it. Up to the first contact of
two bars the path is that of the real prism; beyond it the bars of the model pass through each other, and the
limit point is what the prism would carry if they could.
"""

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table, number_cell, text_cell
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent
from tensegrity_codegen.runtime.paths.model_path import ModelPath, watch_contact, watch_slack
from tensegrity_codegen.runtime.paths.path_solver import PathSolver
from tensegrity_codegen.studies.papers.lin.tables import compile_prism, place_load, settle
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

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
    most: float = MAX_LOAD,
    control: StepControl = CONTROL,
) -> dict[str, Any]:
    """Return the loads [N] of the first slack spring, the first contact and the first limit point.

    slack, contact, limit: {load, of} or None where there is none up to `most`, in the order of the path.
    maximum: the largest load that the prism carries before bars touch or the load turns back, and `because`.
    is_stable: whether all configurations up to there are minima of the energy. events: all, in order.
    status: how the path ended.
    """
    model = compile_prism(tension_only=tension_only)
    _, path = follow_load(model, top, direction, most=most, past_contact=True, control=control)
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
        "maximum": most if last is None else last.load_factor,
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


def reach_load(load: float, *, tension_only: bool = False, top: int = 3, direction: str = "-z") -> FloatArray:
    """Return the coordinates (6,) under a load [N], on the branch that begins without load.

    Raises ConvergenceError for a load beyond the first contact or the first limit point, with the largest
    load and what happens there as evidence.
    """
    model = compile_prism(tension_only=tension_only)
    _, path = follow_load(model, top, direction, most=load)
    ends = path.find_events("contact", "limit")
    if path.status == "completed" and not ends:
        return np.asarray(path.coordinate[-1])
    evidence = path.as_evidence()
    if ends:
        evidence |= {
            "maximum": ends[0].load_factor,
            "because": f"{ends[0].kind} of {', '.join(ends[0].names)}",
        }
    raise ConvergenceError(
        f"the prism does not carry {load:.10g} N on B{top} along {direction}",
        evidence=evidence,
        where="lin_prism",
        hint="a smaller load",
    )


def _describe(events: tuple[PathEvent, ...]) -> dict[str, Any] | None:
    if not events:
        return None
    return {"load": events[0].load_factor, "of": events[0].names}


# The work of a load along a path of equilibria against the change of potential.
#
# W = integral of lambda F . dx over the path, by Gauss quadrature on each stretch between two points of the
# continuation, with an equilibrium solved for at every node of the quadrature. A stretch is parametrised by
# the distance along its chord in (q, lambda), which goes through limit points; points lie at every kink.


NODES = 12  # of the quadrature on each stretch


def compare_work(problem: ModelPath, path: LoadPath, *, nodes: int = NODES) -> dict[str, Any]:
    """Return the load's work along a path, the change of strain energy and weight, and their difference [J].

    Raises ConvergenceError where a point between two points of the path is not found.
    """
    solver = PathSolver(problem, (1.0, float(np.abs(path.load_factor).max()) or 1.0))
    places = [solver.join(q, load) for q, load in zip(path.coordinate, path.load_factor, strict=True)]
    work = sum(_stretch(solver, first, last, nodes) for first, last in pairwise(places))
    ends = [float(problem.compute("potential_energy", path.coordinate[k], 0.0)) for k in (0, -1)]
    change = ends[1] - ends[0]
    return {
        "work": float(work),
        "potential_change": change,
        "difference": float(work) - change,
        "n_points": len(places) + nodes * (len(places) - 1),
    }


def _stretch(solver: PathSolver, first: FloatArray, last: FloatArray, nodes: int) -> float:
    """Return the integral of lambda f . dq from one point of the path to the next [J]."""
    chord = last - first
    length = float(np.linalg.norm(chord))
    if length == 0.0:
        return 0.0
    along = chord / length
    place, weight = np.polynomial.legendre.leggauss(nodes)
    total = 0.0
    for part, share in zip((place + 1) / 2, weight / 2, strict=True):
        state = solver.solve(first + part * chord, along, float(along @ first) + part * length)
        tangent = None if state is None else solver.tangent(state, along)
        if state is None or tangent is None:
            raise ConvergenceError(
                "a point between two points of the path was not found",
                evidence={"load_factor": float(first[-1] * solver.load_scale)},
                where="compare_work",
                hint="follow the path with shorter steps",
            )
        moved = tangent[:-1] * (length / float(along @ tangent)) * solver.coordinate_scale
        load = solver.problem.load_vector(state.coordinate, state.load_factor)
        total += share * state.load_factor * float(load @ moved)
    return total


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
