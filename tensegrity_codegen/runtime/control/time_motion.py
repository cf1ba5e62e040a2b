"""Timed motions: a path through equilibria, put in time by a time law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.runtime.control.equilibrium_path import EquilibriumPath
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.control.path_knots import find_knots
from tensegrity_codegen.runtime.control.rates import check_rates, compute_peaks
from tensegrity_codegen.runtime.control.smooth_path import SmoothPath, build_smooth_path
from tensegrity_codegen.runtime.control.time_law import QUINTIC, TimeLaw, read_law
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.planning.outcome import PlanResult
from tensegrity_codegen.runtime.planning.plan_point import PlanModel

__all__ = ["time_motion"]

FloatArray = NDArray[np.float64]

LEAST_SAMPLES, MOST_SAMPLES = 5, 100_000


def time_motion(
    model: CompiledModel,
    path: PlanResult | EquilibriumPath,
    duration: float | None = None,
    law: str | ArrayLike = QUINTIC,
    *,
    arguments: Mapping[str, Any] | None = None,
    samples: int = 201,
) -> Motion:
    """Put a path through equilibria in time.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"time_motion"``, see compile_scene.
    path : PlanResult or EquilibriumPath
        A plan that was found, or equilibria one after the other.
    duration : float, optional
        Time of the motion [s]; by default that of the table, without one the shortest that the rates of the
        actuators permit.
    law : str or array_like, shape (n, 2)
        ``"quintic"``: progress s = 10 x^3 - 15 x^4 + 6 x^5 over x = t / duration; or a table of times [s] and
        progress, from (0, 0) to (end, 1).
    arguments : mapping, optional
        Inputs and parameters by name, where they differ from the scene; those of the path.
    samples : int
        Number of equally spaced knots of the motion.

    Returns
    -------
    Motion
        Coordinates, inputs and tensions over time.

    Raises
    ------
    InvalidValueError
        A duration below the shortest (the message names the actuator, its cable, its rate and the time); a
        path that is none; points that are not in balance; a wrong table.
    StructureError
        The scene has no actuators.
    ConvergenceError, UnstableError
        No stable equilibrium between two points of the path.

    Notes
    -----
    docs/control.md has the equations.

    Examples
    --------
    >>> from tensegrity_codegen import EquilibriumPath, compile_scene, time_motion
    >>> model = compile_scene("prism12.toml", for_="time_motion")
    >>> path = EquilibriumPath([[0, 0, 0, 0, 0, 0], [-0.005, -0.005, -0.005, 0, 0, 0]])
    >>> motion = time_motion(model, path, duration=1.0)
    >>> motion.input.shape, motion.shortest_duration < 1.0
    ((201, 6), True)
    """
    _check_samples(samples)
    shape = read_law(law)
    wanted = _read_duration(duration, shape)
    plan_model, knots = find_knots(model, path, arguments)
    smooth = build_smooth_path(plan_model, knots)
    part = np.linspace(0.0, 1.0, samples)
    change = np.asarray(smooth.change(shape.at(part)[0]))
    peaks = compute_peaks(part, change)
    shortest = float((peaks.rate / plan_model.actuation.rate).max(initial=0.0))
    length = _choose_duration(wanted, shortest)
    peaks = compute_peaks(part * length, change)
    check_rates(plan_model.actuation, peaks, model.manifest.member_name, length, shortest)
    return _record(plan_model, smooth, shape, part, length, change, peaks.rate, shortest)


def _record(
    plan_model: PlanModel,
    smooth: SmoothPath,
    law: TimeLaw,
    part: FloatArray,
    duration: float,
    change: FloatArray,
    peak_rate: FloatArray,
    shortest: float,
) -> Motion:
    s, rate, bend = (values[:, None] for values in law.at(part))
    rate, bend = rate / duration, bend / duration**2
    q = smooth.coordinate
    slope, curve = np.asarray(q(s[:, 0], 1)), np.asarray(q(s[:, 0], 2))
    return Motion(
        time=part * duration,
        coordinate=np.asarray(q(s[:, 0])),
        velocity=slope * rate,
        acceleration=slope * bend + curve * rate**2,
        rest_length=plan_model.actuation.rest_length + change,
        input=np.array([plan_model.inputs(row) for row in change]),
        member_tension=np.asarray(smooth.tension(s[:, 0])),
        peak_rate=peak_rate,
        actuators=plan_model.actuation.names,
        input_name=plan_model.model.manifest.input_name,
        shortest_duration=shortest,
        path_error=smooth.error,
    )


def _check_samples(samples: int) -> None:
    if (
        isinstance(samples, bool)
        or not isinstance(samples, int)
        or not LEAST_SAMPLES <= samples <= MOST_SAMPLES
    ):
        raise InvalidValueError(
            "out of range", where="samples", given=samples, allowed=f"{LEAST_SAMPLES} to {MOST_SAMPLES}"
        )


def _read_duration(duration: float | None, law: TimeLaw) -> float | None:
    """Return the duration that is asked for [s], None for the shortest."""
    if duration is None:
        return law.own_duration
    is_number = isinstance(duration, (int, float, np.floating)) and not isinstance(duration, bool)
    if not is_number or not (math.isfinite(duration) and duration > 0):
        raise InvalidValueError(
            "the duration is not positive", where="duration", given=duration,
            allowed="a finite number above 0 [s]",
        )  # fmt: skip
    return float(duration)


def _choose_duration(wanted: float | None, shortest: float) -> float:
    if wanted is not None:
        return wanted
    if shortest > 0:
        return shortest
    raise InvalidValueError(
        "no rates limit the motion, so that no duration is the shortest",
        where="duration",
        given="no duration, actuators without `rate`",
        allowed="a duration [s], or actuators with a rate [m/s]",
    )
