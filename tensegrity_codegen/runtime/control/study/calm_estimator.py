"""Estimators whose disturbance forces are as large as noise of the sensors permits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.control.design.estimator import Estimator
from tensegrity_codegen.runtime.control.design.usual_forces import UNKNOWN, find_usual_forces
from tensegrity_codegen.runtime.control.kalman import design_kalman
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.control.study.scales import Scales
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs

__all__ = ["design_calm_estimator", "predict_displacement"]

MOST_ERROR = 0.005  # of the size of the structure: standard deviation of a displacement that is predicted
MARGIN = 4.0  # where this is exceeded: by which the deviation is to be smaller, for errors beside noise
MOST_REDUCTIONS = 3


def design_calm_estimator(
    model: CompiledModel,
    motion: Motion,
    scales: Scales,
    *,
    sample: float,
    only_observable: bool,
    arguments: Mapping[str, Any],
) -> tuple[Estimator, str | None]:
    """Return an estimator with the largest disturbance forces that noise permits, and a warning.

    Disturbances are those of `design_kalman` by default, with which the filter may predict errors of
    displacements up to 1/200 of the size; else they are divided by 10 until these are below 1/800, at most
    three times. The warning is None where they are the default.
    Where few sensors share many disturbance forces, the filter lets noise move the estimate so far that the
    model is not linear any more.
    """
    usual = UNKNOWN * find_usual_forces(model, motion, merge_inputs(model.manifest, arguments))
    most = MOST_ERROR * scales.size
    found: list[tuple[Estimator, float]] = []
    for count in range(MOST_REDUCTIONS + 1):
        estimator = design_kalman(
            model, motion, sample=sample, disturbance=usual / 10.0**count if count else None,
            only_observable=only_observable, arguments=arguments,
        )  # fmt: skip
        found.append((estimator, predict_displacement(estimator, scales)))
        if not found[-1][1] > (most / MARGIN if count else most):
            break
    if len(found) == 1:
        return estimator, None
    divisor = 10 ** (len(found) - 1)
    before, after = _show(found[0][1]), _show(found[-1][1])
    return estimator, (
        "estimator: with disturbance forces of the default size, noise would move its nodes by "
        f"{before} (predicted standard deviation), more than {_show(most)}. "
        f"Divided by {divisor:,}, to at most {usual.max() / divisor:.3g} N or N m in 1 s, by {after}. "
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
