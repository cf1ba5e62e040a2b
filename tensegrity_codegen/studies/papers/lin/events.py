"""The largest load: first slack spring, first contact of bars, limit point, located by root finding.

LIN 1 promises "to determine the maximum of the applied force" and never gives it. Up to the first contact of
two bars the path is that of the real prism; beyond it the bars of the model pass through each other, and the
limit point is what the prism would carry if they could.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent
from tensegrity_codegen.runtime.paths.model_path import ModelPath, watch_contact, watch_slack
from tensegrity_codegen.studies.papers.lin.model import compile_prism, place_load, settle
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
MOST = 60.0  # [N], to which loads grow
CONTROL = StepControl(largest=0.05, most_steps=2000)


def follow_load(
    model: CompiledModel,
    top: int = 3,
    direction: str = "-z",
    *,
    most: float = MOST,
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
    most: float = MOST,
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
