"""What a study of feedback found, in one sentence of numbers: the headline of its page."""

import math

import numpy as np

from tensegrity_codegen.control.feedback.study.control_study import ControlStudy, count_worse
from tensegrity_codegen.control.feedback.study.loop_result import OPEN, LoopResult
from tensegrity_codegen.control.pages.control_studies import LIMIT_NAMES, LOOP_NAMES
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.joined_series import join_names

SAME = 0.95  # of the smallest tension at the end: less before it is stated too


def describe_control_finding(study: ControlStudy, least_bound: float = -math.inf) -> str:
    """Return how far the structure ends from its motion with and without feedback, and the least tension.

    Parameters
    ----------
    study : ControlStudy
        The study; of all draws the worst values count.
    least_bound : float
        Limit of the tension of the cables [N], -infinity without one.
    """
    closed = {name: loop for name, loop in study.loops.items() if name != OPEN}
    name, loop = list(closed.items())[-1]
    thing = "motion" if np.any(study.motion.velocity) else "equilibrium"
    if study.status == "unstable":
        parts = [
            f"the {LOOP_NAMES[key]} in {item.unstable} of {len(study.drawn)} draws"
            for key, item in closed.items()
            if item.unstable
        ]
        return f"Feedback is unstable with {' and with '.join(parts)}; {_without(study)}"
    if study.status == "does_not_hold":
        return (
            f"Feedback does not keep the {thing}: {_error(study, loop)} from it at the end with the "
            f"{LOOP_NAMES[name]}, {_without(study)}"
        )
    text = (
        f"Feedback with the {LOOP_NAMES[name]} keeps the {thing} within {_error(study, loop)} at the end, "
        f"{_without(study)}"
    )
    worse = count_worse(study.loops, name)
    text += f", worse than that in {worse} of {len(study.drawn)} draws" if worse else ""
    return f"{text}{_describe_limits(loop, least_bound)}"


def find_least_bound(limits: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return the largest of the least tensions (n,) that are stated [N], -infinity where none is."""
    finite = limits[np.isfinite(limits)]
    return float(finite.max()) if len(finite) else -math.inf


def _without(study: ControlStudy) -> str:
    loop = study.loops[OPEN]
    if loop.unstable:
        return "unstable without feedback"
    return f"{_error(study, loop)} without feedback"


def _error(study: ControlStudy, loop: LoopResult) -> str:
    """Return the largest error at the end of all draws: an angle where all coordinates are angles."""
    if study.tuning.scales.is_angle.all():
        return f"{format_short(float(np.degrees(loop.end_angle.max())))} deg"
    return f"{format_short(1000 * float(loop.end_error.max()))} mm"


def _describe_limits(loop: LoopResult, least_bound: float) -> str:
    """Return the smallest tension at the end, and the limits that are not kept there."""
    broken = [f"{LIMIT_NAMES[limit]} not kept by {join_names(who)}" for limit, who in loop.broken.items()]
    least = float(np.min(loop.end_tension))
    if not math.isfinite(least):
        return "".join(f"; {text}" for text in broken)
    way = float(np.min(loop.least_tension))
    place = f" at the end, {format_short(way)} N on the way" if way < SAME * least else ""
    bound = f", limit {format_short(least_bound)} N" if math.isfinite(least_bound) else ""
    return f"; smallest cable tension {format_short(least)} N{place}{bound}" + "".join(
        f"; {text}" for text in broken
    )
