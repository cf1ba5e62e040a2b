"""Feedback that keeps least tensions, as options state it: a distribution, or model-predictive control."""

import math
from collections.abc import Mapping
from typing import Any

from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.tension_distribution import (
    TensionDistribution,
    design_distribution,
)
from tensegrity_codegen.control.feedback.mpc import Mpc, design_mpc
from tensegrity_codegen.control.feedback.study.tuning import Tuning
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import InvalidValueError


def read_least_tension(text: str | None) -> float | None:
    """Return the least tension [N] of an option, None for that of the scene; raises InvalidValueError."""
    if text is None or text == "scene":
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < 0.0:
        raise InvalidValueError(
            "not a least tension", where="least_tension", given=text, allowed="a number >= 0 [N], or scene"
        )
    return value


def design_limited(
    model: CompiledModel,
    motion: Motion,
    tuning: Tuning,
    gains: Gains,
    *,
    least_tension: str | None,
    mpc: bool,
    horizon: int,
    arguments: Mapping[str, Any] | None = None,
) -> tuple[Gains | Mpc, TensionDistribution | None]:
    """Return the gains with a distribution of tensions, or model-predictive control of the same weights.

    gains: of the weights of `tuning`.
    least_tension: as of `read_least_tension`; None: no distribution.
    horizon: commands that model-predictive control plans ahead.
    arguments: run-time parameters where they differ from the scene.
    Raises what `design_mpc` and `design_distribution` raise.
    """
    least = read_least_tension(least_tension)
    if mpc:
        return design_mpc(
            model, motion, tuning.Q, tuning.R, sample=gains.sample, horizon=horizon,
            integral_action=tuning.integral_action, least_tension=least, arguments=arguments,
        ), None  # fmt: skip
    if least_tension is None:
        return gains, None
    return gains, design_distribution(model, motion, least_tension=least, arguments=arguments)
