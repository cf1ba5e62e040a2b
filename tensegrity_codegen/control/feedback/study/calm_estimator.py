"""Estimators whose disturbance forces are as large as noise of the sensors permits."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.usual_forces import UNKNOWN, find_usual_forces
from tensegrity_codegen.control.feedback.kalman import MOST_KNOTS, design_kalman
from tensegrity_codegen.control.feedback.study.linear_loop import build_linear_loop
from tensegrity_codegen.control.feedback.study.scales import Scales
from tensegrity_codegen.control.feedback.study.study_times import find_default_times
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs
from tensegrity_codegen.runtime.records.timed_motion import Motion

MOST_ERROR = 0.005  # of the size of the structure: standard deviation of a displacement that is predicted
MARGIN = 4.0  # where this is exceeded: by which the deviation is to be smaller, for errors beside noise
MOST_REDUCTIONS = 3
WORTH = 0.8  # of the displacements that noise causes in the loop: less left is worth a slower estimate
SETTLED = 5.0  # time constants of the estimate, up to the time from which errors are compared


def design_calm_estimator(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    scales: Scales,
    *,
    only_observable: bool = False,
    arguments: Mapping[str, Any] | None = None,
) -> tuple[Estimator, str | None]:
    """Return an estimator with the largest disturbance forces that noise permits, and a warning.

    Disturbances are those of `design_kalman` by default, with which the filter may predict errors of
    displacements up to 1/200 of the size; else they are divided by 10 until these are below 1/800: where few
    sensors share many disturbance forces, the filter lets noise move the estimate so far that the model is
    not linear any more. They are divided by 10 further where noise then moves the nodes of the linear loop
    by a fifth less at least (Lyapunov's equation), if the estimate still settles before errors are compared;
    three times at most in all. The warning is None where they are the default.
    """
    given = merge_inputs(model.manifest, arguments)
    usual = UNKNOWN * find_usual_forces(model, motion, given)
    settling = find_default_times(motion)[1] / SETTLED

    def design(count: int, knots: int = MOST_KNOTS) -> Estimator:
        return design_kalman(
            model, motion, sample=gains.sample, disturbance=usual / 10.0**count if count else None,
            only_observable=only_observable, knots=knots if motion.velocity.any() else 2,
            arguments=arguments,
        )  # fmt: skip

    def move(estimator: Estimator) -> float:
        """Return by how much noise moves the nodes of the loop [m], infinite where it settles too late."""
        loop = build_linear_loop(model, motion, gains, gains.delay, estimator, given)
        is_slow = np.abs(estimator.E).max() > np.exp(-gains.sample / settling)
        return np.inf if is_slow else float((loop.deviation() * scales.lever).max(initial=0.0))

    found = [design(0)]
    first, most = predict_displacement(found[0], scales), MOST_ERROR * scales.size
    bound = most if first <= most else most / MARGIN
    while len(found) <= MOST_REDUCTIONS:
        count = len(found)
        is_loud = predict_displacement(found[-1], scales) > bound
        if not is_loud and not move(design(count, 2)) < WORTH * move(found[-1]):
            break
        found.append(design(count))
    if len(found) == 1:
        return found[0], None
    divisor = 10 ** (len(found) - 1)
    before, after = (predict_displacement(item, scales) for item in (found[0], found[-1]))
    reason = f"more than {_show(most)}"
    if first <= most:
        before, after = move(found[0]), move(found[-1])
        reason = "in the linear loop"
    return found[-1], (
        "estimator: with disturbance forces of the default size, noise would move its nodes by "
        f"{_show(before)} (predicted standard deviation), {reason}. "
        f"Divided by {divisor:,}, to at most {usual.max() / divisor:.3g} N or N m in 1 s, by {_show(after)}. "
        "More sensors permit larger forces; `disturbance` states others"
    )


def predict_displacement(estimator: Estimator, scales: Scales) -> float:
    """Return the largest standard deviation of a node's displacement that the filter predicts [m].

    Each coordinate alone: the root of its variance, times the most that its unit moves a node.
    """
    n = len(scales.lever)
    variance = np.diagonal(estimator.P, axis1=1, axis2=2)[:, :n]
    return float((np.sqrt(np.maximum(variance, 0.0)) * scales.lever).max(initial=0.0))


def _show(length: float) -> str:
    return f"{1000 * length:.3g} mm"
