"""What the loops of a study show: status and warnings."""

from collections.abc import Mapping

import numpy as np

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.study.linear_loop import Margins
from tensegrity_codegen.control.feedback.study.loop_result import OPEN, LoopResult
from tensegrity_codegen.structure.limits import Limits

WORSE = 0.1  # of the tolerance, by which a closed loop may end further away than the open loop
LITTLE = 0.5  # of the error of the open loop: with more left, feedback gains little
OFTEN = 0.1  # of the commands of a loop: more are cut often
CUT = ("rate_limited", "range_limited")
WORDS = {OPEN: "open loop", "true_state": "true state", "estimator": "estimator"}


def judge_study(loops: Mapping[str, LoopResult], tolerance: float) -> tuple[str, str]:
    """Return the status of a study, and a sentence with the errors of all loops."""
    ends = {name: float(loop.end_error.max()) for name, loop in loops.items()}
    texts = [
        f"{WORDS[name]} {1000 * ends[name]:.3g} mm"
        + (f" ({loop.unstable} unstable)" if loop.unstable else "")
        for name, loop in loops.items()
    ]
    message = f"largest errors at the end: {', '.join(texts)}"
    closed = [name for name in loops if name != OPEN]
    worse = count_worse(loops, closed[-1])
    if worse:
        count = len(loops[OPEN].measures)
        message += f"; {WORDS[closed[-1]]} worse than open loop in {worse} of {count} draws"
    if any(loops[name].unstable for name in closed):
        return "unstable", message
    bound = np.inf if loops[OPEN].unstable else ends[OPEN]
    bound = min(bound, 1e300) + WORSE * tolerance
    return ("holds" if all(ends[name] <= bound for name in closed) else "does_not_hold"), message


def count_worse(loops: Mapping[str, LoopResult], name: str) -> int:
    """Return the number of draws in which a loop ends further from the motion than the open loop."""
    pairs = zip(loops[name].measures, loops[OPEN].measures, strict=True)
    return sum(
        not before.is_unstable and (row.is_unstable or row.end_error > before.end_error)
        for row, before in pairs
    )


def find_time_constants(gains: Gains, estimator: Estimator | None) -> list[float]:
    """Return the times in which the slowest errors of gains and estimator fall to 1/e [s], or infinity."""
    parts = [gains.E] if estimator is None else [gains.E, estimator.E]
    slowest = np.array([np.abs(values).max(initial=1e-300) for values in parts])
    with np.errstate(divide="ignore"):
        found: list[float] = (gains.sample / np.abs(np.log(np.minimum(slowest, 1.0)))).tolist()
    return found


def find_margin_warnings(
    margins: Mapping[str, Margins], bounds: ActuatorBounds, sample: float
) -> tuple[str, ...]:
    """Return a sentence for each linear loop that is unstable, or that one sample of more delay makes so."""
    found = []
    for name, margin in margins.items():
        late = 1000 * float(bounds.delay.max(initial=0.0))
        if not margin.is_stable:
            found.append(
                f"{WORDS[name]}: the linear loop at the end of the motion is unstable"
                + (f" with delays of up to {late:.3g} ms" if late else "")
                + ": weaker feedback (a smaller effort) tolerates more"
            )
        elif margin.delay < sample:
            found.append(
                f"{WORDS[name]}: {1000 * margin.delay:.3g} ms more delay make the loop unstable, less than "
                f"one sample ({1000 * sample:.3g} ms), which computing and sending a command may take: state "
                "it as delay of the actuators, or choose weaker feedback (a smaller effort)"
            )
    return tuple(found)


def find_low_tensions(loops: Mapping[str, LoopResult], limits: Limits) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose cables are slack or below a limit on the way."""
    stated = limits.least_tension[np.isfinite(limits.least_tension)]
    bound = float(stated.max(initial=0.0))
    found = []
    for name, loop in loops.items():
        values = loop.least_tension
        if name == OPEN or not np.isfinite(values).any() or "least_tension" in loop.broken:
            continue
        draw = int(np.nanargmin(values))
        low = float(values[draw])
        if low <= 0.0 or low < bound:
            found.append(
                f"{WORDS[name]}: {loop.measures[draw].least_member} "
                + ("goes slack" if low <= 0.0 else f"falls to {low:.3g} N")
                + " on the way"
                + (f", below the least tension of {bound:g} N" if low < bound else "")
            )
    return tuple(found)


def find_warnings(loops: Mapping[str, LoopResult], tolerance: float) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose commands are often cut, or that gains little.

    Parameters
    ----------
    loops : mapping of str to LoopResult
        All loops.
    tolerance : float [m]
        Displacement that the weights accept; smaller errors than a tenth of it are no reason to warn.

    Returns
    -------
    tuple of str
        Sentences.
    """
    found = []
    without = float(loops[OPEN].end_error.max())
    for name, loop in loops.items():
        if name == OPEN or loop.unstable:
            continue
        count = sum(loop.steps.values())
        cut = sum(loop.steps.get(word, 0) for word in CUT) / max(count, 1)
        if cut > OFTEN:
            found.append(
                f"{WORDS[name]}: {100 * cut:.0f} % of the commands were cut to the rate or range of an "
                "actuator, and integrals of errors stand still then: weaker feedback (a smaller effort), a "
                "slower motion or faster actuators avoid that"
            )
        left = float(loop.end_error.max())
        if not loops[OPEN].unstable and left > LITTLE * without and left > WORSE * tolerance:
            kind = "makes the error larger" if left > without else "gains little"
            found.append(
                f"{WORDS[name]}: feedback {kind}, {1000 * left:.3g} mm at the end, {1000 * without:.3g} mm "
                "without feedback: look at weights, actuators and sensors"
            )
    return tuple(found)
