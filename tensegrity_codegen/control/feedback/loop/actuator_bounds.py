"""Motors of a motion: bounds of their inputs, rates, delays, and their inputs where commands arrive late."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.control.feedback.design.linear_samples import split_delays
from tensegrity_codegen.control.planning.plan_point import find_actuation
from tensegrity_codegen.runtime.model.arrays import to_doubles, to_each
from tensegrity_codegen.runtime.model.interface import Described
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import InvalidValueError

ROUNDING = 1e-9  # of a rate, by which a motion may exceed it


@dataclass(frozen=True)
class ActuatorLimits:
    """Limits of the actuators of a closed loop in place of those of the scene.

    Attributes
    ----------
    rate : float or array_like, shape (n_actuators,), optional [m/s]
        Largest rates.
    range : array_like, shape (2,) or (n_actuators, 2), optional [m]
        Least and largest rest lengths.
    delay : float or array_like, shape (n_actuators,), optional [s]
        Times from the command to the motion.
    """

    rate: ArrayLike | None = None
    range: ArrayLike | None = None
    delay: ArrayLike | None = None


# Arguments of functions with a closed loop that `ActuatorLimits` has.
MOVED_TO_LIMITS = {name: f"limits=ActuatorLimits({name}=...)" for name in ("rate", "range", "delay")}


@dataclass(frozen=True)
class ActuatorBounds:
    """Bounds of the actuators of a motion, in its order."""

    names: tuple[str, ...]  # their names
    place: NDArray[np.int64]  # (n_actuators,): indices of their inputs
    members: tuple[tuple[int, ...], ...]  # indices of their members
    least: FloatArray  # (n_actuators,) [m]: bounds of their inputs
    most: FloatArray  # (n_actuators,) [m]
    rate: FloatArray  # (n_actuators,) [m/s]: largest rates
    delay: FloatArray  # (n_actuators,) [s]: times from the command to the motion


def find_bounds(
    model: Described,
    motion: Motion,
    limits: ActuatorLimits | None = None,
    *,
    longest_delay: float | None = None,
    may_lag: bool = False,
) -> ActuatorBounds:
    """Return the bounds of a motion's actuators: those of the scene, or those given."""
    check_instance(limits, (ActuatorLimits, type(None)), "limits", "ActuatorLimits, or None")
    stated = limits or ActuatorLimits()
    actuation = find_actuation(model, motion.actuators)
    structure = model.structure
    assert structure is not None  # find_actuation refuses models without
    count = len(actuation.actuators)
    bounds = ActuatorBounds(
        names=actuation.names,
        place=actuation.place,
        members=tuple(actuator.members for actuator in actuation.actuators),
        least=actuation.least_change,
        most=actuation.most_change,
        rate=actuation.rate,
        delay=np.array([actuator.delay for actuator in actuation.actuators]),
    )
    if stated.rate is not None:
        bounds = replace(bounds, rate=_read(stated.rate, count, "rate", "m/s", strictly=True))
    if stated.delay is not None:
        bounds = replace(bounds, delay=_read(stated.delay, count, "delay", "s", strictly=False))
    if stated.range is not None:
        allowed = "0 <= least < largest rest length [m], one pair or one for each actuator"
        ends = to_doubles(stated.range, "range", allowed)
        is_range = ends.shape in ((2,), (count, 2))
        if not is_range or not (ends[..., 0] < ends[..., 1]).all() or not (ends[..., 0] >= 0.0).all():
            raise InvalidValueError("not a range", where="range", given=stated.range, allowed=allowed)
        pair = np.broadcast_to(ends, (count, 2))
        rest_length = [structure.rest_length[list(members)] for members in bounds.members]
        bounds = replace(
            bounds,
            least=pair[:, 0] - np.array([row.min() for row in rest_length]),
            most=pair[:, 1] - np.array([row.max() for row in rest_length]),
        )
    if not may_lag:
        _check_rates(bounds, motion)
    _check_delays(bounds, motion, motion.duration if longest_delay is None else longest_delay)
    return bounds


def _read(value: ArrayLike, count: int, where: str, unit: str, *, strictly: bool) -> FloatArray:
    allowed = f"a number {'>' if strictly else '>='} 0 [{unit}], or one for each of {count} actuators"
    return to_each(value, count, where, lambda x: x > 0.0 if strictly else x >= 0.0, allowed)


def _check_rates(bounds: ActuatorBounds, motion: Motion) -> None:
    """Raise InvalidValueError for a motion that needs higher rates."""
    over = motion.peak_rate > bounds.rate * (1.0 + ROUNDING)
    if over.any():
        worst = int(np.argmax(motion.peak_rate / bounds.rate))
        raise InvalidValueError(
            "the motion is too fast for an actuator",
            where=f"actuators.{bounds.names[worst]}.rate",
            given=f"{bounds.rate[worst]:.4g} m/s, the motion needs {motion.peak_rate[worst]:.4g} m/s",
            allowed=f"at least {motion.peak_rate[worst]:.4g} m/s",
            hint="a longer motion, or design_mpc, which follows it as closely as the rates permit",
        )


def _check_delays(bounds: ActuatorBounds, motion: Motion, longest: float) -> None:
    """Raise InvalidValueError for a delay longer than the motion."""
    late = bounds.delay > longest
    if late.any():
        name = bounds.names[int(np.argmax(late))]
        raise InvalidValueError(
            "the delay is longer than the motion",
            where=f"actuators.{name}.delay",
            given=f"{bounds.delay.max():g} s, motion of {motion.duration:g} s",
            allowed=f"at most {motion.duration:g} s",
        )


# Commands that arrive late: the inputs of the model over time.


class DelayedInputs:
    """The inputs of the model during a sample, where each actuator follows its commands after a delay.

    bounds: delays of the actuators.
    start (n_actuators,) [m]: their inputs before the first command arrives.
    sample [s]: time between two commands.
    """

    def __init__(self, bounds: ActuatorBounds, start: FloatArray, sample: float) -> None:
        self.sample = sample
        self.back, self.offset, _ = split_delays(bounds.delay, sample)
        self.commands = [start] * (int(self.back.max(initial=0)) + 2)

    def push(self, command: FloatArray) -> list[tuple[float, FloatArray]]:
        """Return the inputs from here to the next command."""
        self.commands = [*self.commands[1:], command]
        arrived = [self._arrived(0.0)]
        times = sorted({float(time) for time in self.offset if time > 0.0})
        return list(zip([0.0, *times], [*arrived, *(self._arrived(time) for time in times)], strict=True))

    def _arrived(self, time: float) -> FloatArray:
        """Return the commands that have arrived a time [s] after the last one was given."""
        late = self.back + (self.offset > time)
        rows = np.array(self.commands)[::-1]
        return rows[late, np.arange(len(late))]
