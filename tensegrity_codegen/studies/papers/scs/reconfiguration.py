"""Symmetrical reconfiguration: the rest lengths and the torque that lead from one configuration to another.

Tensions and torque are those that balance the full equations of motion along the path (SCS 32, 33), rest
lengths follow from tensions and lengths (SCS 35). A motion that leaves the bounds, passes a singular A_r or
needs a tendon to push is refused, with the time at which it does.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from tensegrity_codegen.runtime.model.array_file import write_arrays
from tensegrity_codegen.studies.papers.scs.paths import MotionPath, QuinticPath, TorqueFreePath
from tensegrity_codegen.studies.papers.scs.symmetry import CROSSING, GROUPS, SymmetricPose, SymmetricTower
from tensegrity_codegen.symbolic.restriction import Control
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import InfeasibleError, InvalidValueError, NonFiniteError

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
        """Write the arrays to an .npz file, whole or not at all.

        Raises OutputError if it cannot be written, or exists (without `overwrite`).
        """
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
        where = f"t = {time:.6g} s"
        return self.tower.compute_control(motion.s, motion.rate, motion.change, self.force, where)

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
        rest = [self.tower.rest_lengths(a, b) for a, b in zip(length, tension, strict=True)]
        return ReconfigurationRecord(
            time=time,
            alpha_deg=np.degrees(s[:, 0]),
            delta_deg=np.degrees(s[:, 1]),
            length=length,
            rest_length=np.array(rest),
            tension=tension,
            torque=np.array([control.input[M3] for control in controls]),
            residual=np.array([np.abs(control.residual).max() for control in controls]),
        )

    def summary(self) -> dict[str, Any]:
        """Return the facts of the motion as one JSON-ready object."""
        record = self.sample()
        least = record.tension.argmin(axis=0)
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
                for k, (name, row) in enumerate(zip(GROUPS, least, strict=True))
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
    Raises InvalidValueError for configurations outside their bounds, other heights or a wrong duration;
    InfeasibleError where tendons would have to push, A_r is singular, or (48) has no solution.
    """
    check_positive(duration, "duration")
    load = tower.scene_force if force is None else force
    if not math.isfinite(load):
        raise InvalidValueError("out of range", where="force", given=load, allowed="a finite number")
    tower.check_pose(start, "start")
    path = _find_path(tower, start, end, duration, zero_torque)
    tower.check_pose(path.end, "end")
    plan = Reconfiguration(tower, path, start, path.end, duration, load, zero_torque)
    for pose, where in ((start, "start"), (path.end, "end")):
        tower.check_taut(tower.equilibrium(pose, load, where), where)
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
    found = {}
    for name, rule in rules.items():
        values = rule.values
        changed = np.flatnonzero(np.sign(values) != np.sign(values[0]))
        if changed.size:
            row = int(changed[0])
            root = (
                brentq(rule.function, times[row - 1], times[row], xtol=1e-12) if values[row] else times[row]
            )
            found[name] = float(root)
    if not found:
        return
    first = min(found, key=lambda name: found[name])
    sentence = {
        "crossing": "bars intersect on the way: alpha passes 30 deg",
        "reach": "bars reach the other end of the tower on the way: Z = l cos(delta)",
        "singular": "A_r is singular on the way: tensions would grow without bound (SCS 42)",
    }
    raise InfeasibleError(
        sentence.get(first, f"the {first} tendons would have to push"),
        evidence={"time": f"{found[first]:.6f} s"}
        | {f"{name} at": f"{t:.6f} s" for name, t in found.items()},
        where="reconfiguration",
        hint="choose another end, force, or a longer duration",
    )
