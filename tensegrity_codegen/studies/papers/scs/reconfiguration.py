"""Symmetrical reconfiguration: the rest lengths and the torque that lead from one configuration to another.

Tensions and torque are those that balance the full equations of motion along the path (SCS 32, 33), rest
lengths follow from tensions and lengths (SCS 35). A motion that leaves the bounds, passes a singular A_r or
needs a tendon to push is refused, with the time at which it does.

Paths are azimuth and declination over time between two configurations (SCS 36 to 41, 46 to 51).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.optimize import brentq

from tensegrity_codegen.runtime.model.arrays import write_arrays
from tensegrity_codegen.studies.papers.scs.symmetry import CROSSING, GROUPS, SymmetricPose, SymmetricTower
from tensegrity_codegen.symbolic.restriction import Control
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import InfeasibleError, InvalidValueError, NonFiniteError

SIXTY = math.radians(60.0)


@dataclass(frozen=True)
class Motion:
    """s = (alpha, delta, Z) and its first two derivatives at one time, each (3,)."""

    s: FloatArray
    rate: FloatArray
    change: FloatArray


class MotionPath(Protocol):
    """A motion for all times: at rest before 0 and after the duration."""

    def at(self, time: float) -> Motion:
        """Return the motion at a time [s]."""
        ...


def blend(time: float, duration: float) -> tuple[float, float, float]:
    """Return p, p', p'' of the quintic from 0 to 1 that starts and ends at rest (SCS 39).

    p = 10 x^3 - 15 x^4 + 6 x^5 with x = t / tau, which is the bracket of (39) times 30 / tau^5.
    """
    x = min(max(time / duration, 0.0), 1.0)
    value = x**3 * (10.0 + x * (6.0 * x - 15.0))
    rate = 30.0 * x**2 * (x - 1.0) ** 2 / duration
    change = 60.0 * x * (x - 1.0) * (2.0 * x - 1.0) / duration**2
    return value, rate, change


@dataclass(frozen=True)
class QuinticPath:
    """Both angles by the quintic (38) to (41), at constant height; duration [s]."""

    start: SymmetricPose
    end: SymmetricPose
    duration: float

    def at(self, time: float) -> Motion:
        """Return the motion at a time [s]."""
        initial = self.start.parameter
        way = self.end.parameter - initial
        value, rate, change = blend(time, self.duration)
        return Motion(initial + value * way, rate * way, change * way)


@dataclass(frozen=True)
class TorqueFreePath:
    """alpha by the quintic, delta so that no torque is needed (48), at constant height.

    (48) is linear in sin(delta): sin(delta) = N / D(alpha), N = k sin(delta_i) cos(alpha_i + 60 deg) and
    D = 3 J~ sin(delta_i) sin(alpha - alpha_i) + k cos(alpha + 60 deg), k = m~ b / sqrt(3). Its derivatives
    are those of implicit differentiation (50), (51).
    """

    start: SymmetricPose
    alpha_end: float
    duration: float
    spin: float  # 3 J~ sin(delta_i) [kg m2]
    coupling: float  # k [kg m2]

    @classmethod
    def of(
        cls, tower: SymmetricTower, start: SymmetricPose, alpha_end: float, duration: float
    ) -> "TorqueFreePath":
        """Return the path of a tower from `start` to an azimuth [rad] in `duration` [s]."""
        spin = 3.0 * tower.bar_inertia * math.sin(start.delta)
        path = cls(start, alpha_end, duration, spin, tower.bar_moment * tower.side / math.sqrt(3.0))
        path._check()
        return path

    @property
    def end(self) -> SymmetricPose:
        """The configuration reached."""
        return SymmetricPose(self.alpha_end, self.declination(self.alpha_end)[0], self.start.height)

    def declination(self, alpha: float) -> tuple[float, float, float]:
        """Return delta and its first two derivatives to alpha; NaN where (48) has no solution."""
        offset = alpha - self.start.alpha
        across, along = math.cos(alpha + SIXTY), math.sin(alpha + SIXTY)
        top = self.coupling * math.sin(self.start.delta) * math.cos(self.start.alpha + SIXTY)
        bottom = self.spin * math.sin(offset) + self.coupling * across
        slope = self.spin * math.cos(offset) - self.coupling * along
        # The second derivative of the bottom is minus the bottom.
        if bottom == 0.0 or not 0.0 < top / bottom < 1.0:
            return math.nan, math.nan, math.nan
        sine = top / bottom
        by_alpha = -sine * slope / bottom
        second = sine * (2.0 * (slope / bottom) ** 2 + 1.0)
        cosine = math.sqrt(1.0 - sine * sine)
        tilt = by_alpha / cosine
        return math.asin(sine), tilt, (second + sine * tilt * tilt) / cosine

    def at(self, time: float) -> Motion:
        """Return the motion at a time [s]."""
        value, rate, change = blend(time, self.duration)
        way = self.alpha_end - self.start.alpha
        alpha, turn, turn2 = self.start.alpha + value * way, rate * way, change * way
        delta, by_alpha, by_alpha2 = self.declination(alpha)
        return Motion(
            np.array([alpha, delta, self.start.height]),
            np.array([turn, by_alpha * turn, 0.0]),
            np.array([turn2, by_alpha * turn2 + by_alpha2 * turn * turn, 0.0]),
        )

    def _check(self) -> None:
        """Raise InfeasibleError where sin(delta) would leave (0, 1) between the two azimuths."""
        azimuths = np.linspace(self.start.alpha, self.alpha_end, 1001)
        missing = [alpha for alpha in azimuths if math.isnan(self.declination(float(alpha))[0])]
        if missing:
            raise InfeasibleError(
                "no motion without torque goes there: SCS (48) has no declination in 0 to 90 deg",
                evidence={
                    "alpha_deg": math.degrees(missing[0]),
                    "alpha_end_deg": math.degrees(self.alpha_end),
                },
                where="reconfiguration",
                hint="allow a torque, or choose a nearer azimuth",
            )


CHECKS = 501  # times at which a motion is looked at before roots are searched between them
M3 = 2  # index among the inputs


@dataclass(frozen=True)
class Rule:
    """A function of time that must keep its sign, with its values at the checked times."""

    values: FloatArray
    function: Callable[[float], float]


@dataclass(frozen=True)
class ReconfigurationRecord:
    """A reconfiguration at n_t times; columns of (n_t, 3) arrays are saddle, vertical, diagonal.

    time (n_t,) [s]; alpha_deg, delta_deg (n_t,); length, rest_length (n_t, 3) [m]; tension (n_t, 3) [N];
    torque (n_t,) M_3 [N m]; residual (n_t,): largest entry that is left of the full equations [N, N m].
    """

    time: FloatArray
    alpha_deg: FloatArray
    delta_deg: FloatArray
    length: FloatArray
    rest_length: FloatArray
    tension: FloatArray
    torque: FloatArray
    residual: FloatArray

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the arrays to an .npz file, whole or not at all."""
        write_arrays(path, {"tendon_class": np.array(GROUPS), **vars(self)}, overwrite=overwrite)


@dataclass(frozen=True)
class Reconfiguration:
    """A checked motion of a tower: start and end, force F_3 [N], duration [s], with torque or without."""

    tower: SymmetricTower
    path: MotionPath
    start: SymmetricPose
    end: SymmetricPose
    duration: float
    force: float
    zero_torque: bool

    def control(self, time: float) -> Control:
        """Return tensions (saddle, vertical, diagonal) [N] and inputs M_1 to F_3 at a time [s]."""
        motion = self.path.at(time)
        instant = f"t = {time:.6g} s"
        return self.tower.compute_control(motion.s, motion.rate, motion.change, self.force, instant)

    def rest_lengths(self, time: float, tension: FloatArray | None = None) -> FloatArray:
        """Return S_0, V_0, D_0 (3,) [m] at a time [s] (SCS 35), for other tensions too if given."""
        pulled = self.control(time).tension if tension is None else tension
        return self.tower.rest_lengths(self.tower.restricted.group_length(self.path.at(time).s), pulled)

    def sample(self, n_t: int = 201) -> ReconfigurationRecord:
        """Return the motion and its controls at n_t equally spaced times from 0 to the duration."""
        time = np.linspace(0.0, self.duration, n_t)
        motions, controls = [self.path.at(t) for t in time], [self.control(t) for t in time]
        s = np.array([motion.s for motion in motions])
        length = np.array([self.tower.restricted.group_length(row) for row in s])
        tension = np.array([control.tension for control in controls])
        rest_length = [self.tower.rest_lengths(a, b) for a, b in zip(length, tension, strict=True)]
        return ReconfigurationRecord(
            time=time,
            alpha_deg=np.degrees(s[:, 0]),
            delta_deg=np.degrees(s[:, 1]),
            length=length,
            rest_length=np.array(rest_length),
            tension=tension,
            torque=np.array([control.input[M3] for control in controls]),
            residual=np.array([np.abs(control.residual).max() for control in controls]),
        )

    def summary(self) -> dict[str, Any]:
        """Return the facts of the motion as one JSON-ready object."""
        record = self.sample()
        smallest = record.tension.argmin(axis=0)
        return {
            "start_deg": self.start.in_degrees,
            "end_deg": self.end.in_degrees,
            "duration": self.duration,
            "force": self.force,
            "zero_torque": self.zero_torque,
            "tension_start": dict(zip(GROUPS, record.tension[0].tolist(), strict=True)),
            "tension_end": dict(zip(GROUPS, record.tension[-1].tolist(), strict=True)),
            "least_tension": {
                name: {"value": float(record.tension[row, k]), "time": float(record.time[row])}
                for k, (name, row) in enumerate(zip(GROUPS, smallest, strict=True))
            },
            "largest_torque": float(np.abs(record.torque).max()),
            "largest_residual": float(record.residual.max()),
        }


def plan_reconfiguration(
    tower: SymmetricTower,
    start: SymmetricPose,
    end: SymmetricPose | float,
    *,
    duration: float,
    force: float | None = None,
    zero_torque: bool = False,
) -> Reconfiguration:
    """Return the motion from `start` to `end` in `duration` [s] under F_3 = `force` [N], or the scene's.

    end: a configuration; with zero_torque an azimuth [rad], from which its declination follows (48).
    """
    check_positive(duration, "duration")
    load = tower.scene_force if force is None else force
    if not math.isfinite(load):
        raise InvalidValueError("out of range", where="force", given=load, allowed="a finite number")
    tower.check_pose(start, "start")
    path = _find_path(tower, start, end, duration, zero_torque)
    tower.check_pose(path.end, "end")
    plan = Reconfiguration(tower, path, start, path.end, duration, load, zero_torque)
    for pose, location in ((start, "start"), (path.end, "end")):
        tower.check_taut(tower.equilibrium(pose, load, location), location)
    # Refuse the first time at which the motion leaves its bounds, is singular or slackens a tendon
    times = np.linspace(0.0, plan.duration, CHECKS)
    _refuse_first(times, _geometry_rules(plan, times))
    tension = np.array([plan.control(float(t)).tension for t in times])
    rules = {
        name: Rule(tension[:, k], lambda t, k=k: float(plan.control(t).tension[k]))  # type: ignore[misc]
        for k, name in enumerate(GROUPS)
    }
    _refuse_first(times, rules)
    return plan


def _find_path(
    tower: SymmetricTower,
    start: SymmetricPose,
    end: SymmetricPose | float,
    duration: float,
    zero_torque: bool,
) -> QuinticPath | TorqueFreePath:
    if zero_torque:
        azimuth = end.alpha if isinstance(end, SymmetricPose) else float(end)
        if not math.isfinite(azimuth):
            raise NonFiniteError("not an azimuth", where="end", given=azimuth, allowed="a finite angle [rad]")
        return TorqueFreePath.of(tower, start, azimuth, duration)
    if not isinstance(end, SymmetricPose):
        raise InvalidValueError(
            "a motion with torque needs the declination at its end", where="end", given=end,
            allowed="alpha, delta and Z",
        )  # fmt: skip
    if end.height != start.height:
        raise InvalidValueError(
            "a motion between equilibria keeps the height",
            where="end",
            given=f"Z = {end.height:g} m",
            allowed=f"Z = {start.height:g} m (SCS 21)",
        )
    return QuinticPath(start, end, duration)


def _geometry_rules(plan: Reconfiguration, times: FloatArray) -> dict[str, Rule]:
    tower, reach = plan.tower, plan.tower.bar.length
    s = np.array([plan.path.at(float(t)).s for t in times])

    def crossing(t: float) -> float:
        # Changes sign where alpha passes 30 deg, or that and full turns.
        return math.sin(0.5 * (float(plan.path.at(t).s[0]) - math.radians(CROSSING)))

    def room(t: float) -> float:
        _, delta, height = plan.path.at(t).s
        return float(height - reach * math.cos(delta))

    def determinant(t: float) -> float:
        return float(tower.determinant(plan.path.at(t).s[None])[0])

    return {
        "crossing": Rule(np.array([crossing(float(t)) for t in times]), crossing),
        "reach": Rule(np.array([room(float(t)) for t in times]), room),
        "singular": Rule(tower.determinant(s), determinant),
    }


def _refuse_first(times: FloatArray, rules: Mapping[str, Rule]) -> None:
    """Raise InfeasibleError for the rule whose function changes sign first, with the time of its root."""
    violations = {}
    for name, rule in rules.items():
        values = rule.values
        changed = np.flatnonzero(np.sign(values) != np.sign(values[0]))
        if changed.size:
            row = int(changed[0])
            root = (
                brentq(rule.function, times[row - 1], times[row], xtol=1e-12) if values[row] else times[row]
            )
            violations[name] = float(root)
    if not violations:
        return
    earliest = min(violations, key=lambda name: violations[name])
    sentence = {
        "crossing": "bars intersect on the way: alpha passes 30 deg",
        "reach": "bars reach the other end of the tower on the way: Z = l cos(delta)",
        "singular": "A_r is singular on the way: tensions would grow without bound (SCS 42)",
    }
    raise InfeasibleError(
        sentence.get(earliest, f"the {earliest} tendons would have to push"),
        evidence={"time": f"{violations[earliest]:.6f} s"}
        | {f"{name} at": f"{t:.6f} s" for name, t in violations.items()},
        where="reconfiguration",
        hint="choose another end, force, or a longer duration",
    )
