"""Inputs over time that drive a motion: those of its equilibria, or those that produce its accelerations."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tensegrity_codegen.control.feedback.inverse_dynamics import InverseDynamics
from tensegrity_codegen.control.feedback.rates import Peaks, compute_peaks
from tensegrity_codegen.control.feedback.smooth_path import SmoothPath
from tensegrity_codegen.control.feedback.time_law import TimeLaw
from tensegrity_codegen.control.planning.plan_point import PlanModel
from tensegrity_codegen.system.arrays import FloatArray

DYNAMIC, STATIC = "dynamic", "static"
BALANCED = 1e-6  # of the largest tension: residual that counts as none


@dataclass(frozen=True, eq=False)
class Timing:
    """A path with its time law, at parts (n_t,) of the duration."""

    path: SmoothPath
    law: TimeLaw
    part: FloatArray

    def states(self, duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return coordinates, velocities and accelerations, (n_t, n_coordinates) each."""
        s, rate, bend = self.law.at(self.part)
        rate, bend = rate[:, None] / duration, bend[:, None] / (duration * duration)
        place, slope, curve = (np.asarray(self.path.coordinate(s, order)) for order in range(3))
        return place, slope * rate, slope * bend + curve * rate**2


@dataclass(frozen=True)
class Driven:
    """A motion of one duration [s].

    change (n_t, n_actuators) [m]; tension (n_t, n_members) [N]; residual (n_t, n_coordinates) [N], without
    columns where it is not computed; peaks: of the rates.
    """

    duration: float
    change: FloatArray
    tension: FloatArray
    residual: FloatArray
    peaks: Peaks


class Feedforward(Protocol):
    """What drives a motion, by its duration; is_static: whether inputs depend on the progress only."""

    is_static: bool

    def __call__(self, duration: float) -> Driven:
        """Return the motion of this duration [s]."""
        ...


def build_feedforward(kind: str, plan_model: PlanModel, timing: Timing) -> Feedforward:
    """Return the feedforward of a kind; raises FormulationError where a dynamic one lacks quantities."""
    return _Static(timing) if kind == STATIC else _Dynamic(plan_model, timing)


class _Static:
    is_static = True

    def __init__(self, timing: Timing) -> None:
        self.timing = timing
        progress = timing.law.at(timing.part)[0]
        self.change = np.asarray(timing.path.change(progress))
        self.tension = np.asarray(timing.path.tension(progress))

    def __call__(self, duration: float) -> Driven:
        peaks = compute_peaks(self.timing.part * duration, self.change)
        return Driven(duration, self.change, self.tension, np.zeros((len(self.change), 0)), peaks)


class _Dynamic:
    is_static = False

    def __init__(self, plan_model: PlanModel, timing: Timing) -> None:
        self.timing, self.static = timing, _Static(timing)
        self.inverse = InverseDynamics(plan_model, np.asarray(timing.path.coordinate(0.0)))

    def __call__(self, duration: float) -> Driven:
        rows = zip(*self.timing.states(duration), self.static.change, self.static.tension, strict=True)
        drives = [self.inverse.solve(*row) for row in rows]
        change = np.array([drive.change for drive in drives])
        return Driven(
            duration,
            change,
            np.array([drive.tension for drive in drives]),
            np.array([drive.residual for drive in drives]),
            compute_peaks(self.timing.part * duration, change),
        )


def describe_residual(coordinates: tuple[str, ...], timing: Timing, driven: Driven) -> tuple[str, ...]:
    """Return a warning where the actuators do not produce the accelerations: force, coordinate and time."""
    size = np.abs(driven.residual)
    largest = float(np.abs(driven.tension).max(initial=0.0))
    if size.max(initial=0.0) <= BALANCED * largest:
        return ()
    row, column = np.unravel_index(int(size.argmax()), size.shape)
    time = timing.part[row] * driven.duration
    return (
        f"the actuators do not produce this motion exactly: a force of {size.max():.3g} N along "
        f"{coordinates[int(column)]} is missing at {time:.4g} s, beside a largest tension of {largest:.4g} N",
    )
