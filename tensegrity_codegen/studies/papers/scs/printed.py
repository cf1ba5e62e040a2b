"""The paper's own formulas of symmetrical motions, as printed and as corrected (SCS 17 to 42, Appendix A).

None of them is used to compute results: they are what the reduction of the full model is compared with.
Angles in rad. Entries of A_r and of e are in the order delta, alpha, Z.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.integrate.motion import Schedule
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.studies.papers.scs.reconfiguration import Reconfiguration
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose, SymmetricTower
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import UnstableError
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest

PAPER_DURATION = 5.0  # [s], tau
PRINTED_SIDE = 0.67  # [m], b of (43); 2/3 m gives the printed tensions


@dataclass(frozen=True)
class PaperPose:
    """A printed equilibrium: equation, angles [deg], Z as printed and as it must have been [m], F_3, T_r [N].

    height: with b = 2/3 m, the Z at which the largest error of the tensions is smallest. The
    declination of (53) was printed as 22.03 deg; it is computed from (48).
    """

    equation: str
    alpha_deg: float
    delta_deg: float
    printed_height: float
    height: float
    force: float
    tension: tuple[float, float, float]

    @property
    def pose(self) -> SymmetricPose:
        """The configuration at the height that gives the printed tensions."""
        return SymmetricPose.from_degrees(self.alpha_deg, self.delta_deg, self.height)

    @property
    def printed_pose(self) -> SymmetricPose:
        """The configuration as printed."""
        return SymmetricPose.from_degrees(self.alpha_deg, self.delta_deg, self.printed_height)


PAPER_POSES = {
    "44": PaperPose("(44)", 55.0, 40.0, 1.11, 1.1106553, -50.0, (26.11, 1.85, 18.38)),
    "45": PaperPose("(45)", 65.0, 35.0, 1.11, 1.1106553, -50.0, (46.97, 12.27, 43.0)),
    "52": PaperPose("(52)", 70.0, 30.0, 1.6, 1.60504, 50.0, (0.49, 8.91, 8.79)),
    "53": PaperPose("(53)", 65.0, 22.03, 1.6, 1.60504, 50.0, (3.58, 4.93, 11.29)),
}


THIRTY, SIXTY = math.radians(30.0), math.radians(60.0)


@dataclass(frozen=True)
class PrintedTower:
    """Closed forms over l, b, J~, m~ and d of SCS (26), in SI units."""

    length: float
    side: float
    bar_inertia: float
    bar_moment: float
    friction: float

    @classmethod
    def of(cls, tower: SymmetricTower) -> "PrintedTower":
        """Return the closed forms with a tower's numbers."""
        return cls(tower.bar.length, tower.side, tower.bar_inertia, tower.bar_moment, tower.friction)

    def lengths(self, alpha: float, delta: float, height: float) -> FloatArray:
        """Return S, V, D (17), (18), (19), (3,) [m]."""
        l, b, root = self.length, self.side, math.sqrt(3.0)  # noqa: E741, as in the paper
        sine, cosine = math.sin(delta), math.cos(delta)
        saddle = height**2 + l**2 + 3 * l**2 * cosine**2 - 4 * l * height * cosine + b**2 / 3
        diagonal = l**2 + b**2 / 3 + height**2 - 2 * l * height * cosine
        return np.sqrt(
            [
                saddle - 2 / root * l * b * sine * math.cos(alpha - THIRTY),
                l**2 + b**2 - 2 * l * b * sine * math.sin(alpha + THIRTY),
                diagonal - 2 / root * l * b * sine * math.sin(alpha),
            ]
        )

    def matrix(self, alpha: float, delta: float, height: float, *, as_printed: bool = False) -> FloatArray:
        """Return A_r of (A.1) to (A.9), (3, 3); as printed, cos(delta) stands in the second row."""
        l, b, root = self.length, self.side, math.sqrt(3.0)  # noqa: E741, as in the paper
        sine, cosine = math.sin(delta), math.cos(delta)
        across = cosine if as_printed else sine
        scaled = np.array(
            [
                [
                    (2 * height - 3 * l * cosine) * l * sine
                    - l * b * cosine * math.cos(alpha - THIRTY) / root,
                    -l * b * cosine * math.sin(alpha + THIRTY),
                    l * height * sine - l * b * cosine * math.sin(alpha) / root,
                ],
                [
                    l * b * across * math.sin(alpha - THIRTY) / root,
                    -l * b * across * math.cos(alpha + THIRTY),
                    -l * b * across * math.cos(alpha) / root,
                ],
                [6 * height - 12 * l * cosine, 0.0, 6 * height - 6 * l * cosine],
            ]
        )
        matrix: FloatArray = scaled / self.lengths(alpha, delta, height)
        return matrix

    def own_force(
        self, s: FloatArray, rate: FloatArray, change: FloatArray, force: float, *, as_printed: bool = False
    ) -> FloatArray:
        """Return e of (34), (3,); as printed, the centrifugal term of its first entry is missing."""
        (_, delta, _), (turn, tilt, _), (turn2, tilt2, _) = s, rate, change
        sine, cosine, inertia = math.sin(delta), math.cos(delta), self.bar_inertia
        centrifugal = 0.0 if as_printed else inertia * sine * cosine * turn**2
        return np.array(
            [
                inertia * tilt2 - self.friction * tilt - centrifugal,
                inertia * sine**2 * turn2
                - self.friction * turn
                + inertia * math.sin(2 * delta) * turn * tilt,
                self.bar_moment * (sine * tilt2 + cosine * tilt**2) - force,
            ]
        )

    def tension(
        self, s: FloatArray, rate: FloatArray, change: FloatArray, force: float, *, as_printed: bool = False
    ) -> FloatArray:
        """Return -A_r^-1 e, (3,) [N] (32), with the corrected A_r and e corrected or as printed."""
        own_force = self.own_force(s, rate, change, force, as_printed=as_printed)
        solved = np.linalg.solve(self.matrix(*(float(x) for x in s)), own_force)
        return np.asarray(-solved, dtype=np.float64)

    def torque(self, s: FloatArray, rate: FloatArray, change: FloatArray) -> float:
        """Return M_3 [N m], (33) with its derivatives carried out."""
        (alpha, delta, _), (turn, tilt, _), (turn2, tilt2, _) = s, rate, change
        sine, cosine = math.sin(delta), math.cos(delta)
        across, along = math.cos(alpha + SIXTY), math.sin(alpha + SIXTY)
        spin = 3 * self.bar_inertia * (sine**2 * turn2 + 2 * sine * cosine * turn * tilt)
        coupling = (
            (cosine * tilt2 - sine * tilt**2) * across
            - 2 * cosine * tilt * along * turn
            - sine * (across * turn**2 + along * turn2)
        )
        return float(spin + self.bar_moment * self.side / math.sqrt(3.0) * coupling)


# The full model of the tower, driven open loop by the controls of a reconfiguration.
#
# The generated C of all 18 coordinates starts at rest and knows nothing of symmetry: it is given 18 rest
# lengths and the torque M_3 as functions of time. How far it leaves the planned motion measures the plan.


@dataclass(frozen=True)
class Tracking:
    """The full model's motion against the planned one, at n_t times.

    trajectory: of all 18 coordinates; error (n_t, 18) [rad, m]: what it has beyond the plan.
    angle_error_deg: largest error of the bars' angles [deg]; other_error: largest one of the top's
    coordinates [rad, m]; asymmetry: largest difference among the bars' own errors [rad].
    """

    trajectory: Trajectory
    error: FloatArray
    angle_error_deg: float
    other_error: float
    asymmetry: float

    def summary(self) -> dict[str, Any]:
        """Return the largest errors as one JSON-ready object."""
        return {
            "angle_error_deg": self.angle_error_deg,
            "other_error": self.other_error,
            "asymmetry": self.asymmetry,
            "n_evaluations": self.trajectory.n_evaluations,
            "method": self.trajectory.method,
            "status": self.trajectory.status,
        }


def compile_tower(tower: SymmetricTower, integrators: tuple[str, ...] = ()) -> CompiledModel:
    """Return the full model in C, with all rest lengths changeable and the inputs M_1 to F_3."""
    everything = {"rest_length": tuple(range(tower.system.n_members))}
    request = ModelRequest(
        simulation_quantities("bodies"), everything, integrators, "bodies", events=AUTO_EVENTS
    )
    return build_library(tower.system, request, calls=MANY_CALLS).load()


def drive(plan: Reconfiguration) -> Schedule:
    """Return the plan's rest lengths and inputs as functions of time."""

    def schedule(time: float) -> Mapping[str, Any]:
        control = plan.control(time)
        inputs = np.array([0.0, 0.0, control.input[2], 0.0, 0.0, plan.force])
        rest_length = plan.rest_lengths(time, control.tension)
        return {"rest_length": plan.tower.spread(rest_length), "input": inputs}

    return schedule


def drive_as_printed(plan: Reconfiguration) -> Schedule:
    """Return controls with the tensions of (34) as printed, without the centrifugal term; M_3 by (33)."""
    printed = PrintedTower.of(plan.tower)

    def schedule(time: float) -> Mapping[str, Any]:
        motion = plan.path.at(time)
        tension = printed.tension(motion.s, motion.rate, motion.change, plan.force, as_printed=True)
        torque = printed.torque(motion.s, motion.rate, motion.change)
        rest_length = plan.rest_lengths(time, tension)
        return {
            "rest_length": plan.tower.spread(rest_length),
            "input": np.array([0.0, 0.0, torque, 0.0, 0.0, plan.force]),
        }

    return schedule


def track(
    plan: Reconfiguration,
    *,
    schedule: Schedule | None = None,
    model: CompiledModel | None = None,
    samples: int = 201,
    rtol: float = 1e-11,
    atol: float = 1e-12,
    t_end: float | None = None,
) -> Tracking:
    """Return how the full model follows the plan, from rest at its start, driven by `schedule` alone.

    schedule: `drive(plan)` if not given; model: `compile_tower(plan.tower)` if not given; t_end [s]: the
    plan's duration if not given.
    """
    restricted = plan.tower.restricted
    start = restricted.coordinate(plan.path.at(0.0).s)
    trajectory = simulate(
        model or compile_tower(plan.tower),
        plan.duration if t_end is None else t_end,
        samples=samples,
        method="scipy_dop853",
        rtol=rtol,
        stepping=Stepping(atol=atol, control="steps"),
        coordinate=start,
        velocity=np.zeros(len(start)),
        schedule=schedule or drive(plan),
    )
    if trajectory.status != "ok":
        raise UnstableError(
            f"the simulation of the plan ended with status {trajectory.status!r}",
            evidence={"reached": float(trajectory.time[-1]), "message": trajectory.message},
            where=plan.tower.system.name,
        )
    planned = np.array([restricted.coordinate(plan.path.at(float(t)).s) for t in trajectory.time])
    return _compare(trajectory, trajectory.coordinate - planned, plan.tower)


def _compare(trajectory: Trajectory, error: FloatArray, tower: SymmetricTower) -> Tracking:
    names = tower.system.coordinate_name
    tilt = [k for k, name in enumerate(names) if name.endswith("_declination")]
    turn = [k for k, name in enumerate(names) if name.endswith("_azimuth")]
    remaining = [k for k in range(len(names)) if k not in (*tilt, *turn)]
    return Tracking(
        trajectory=trajectory,
        error=error,
        angle_error_deg=float(np.degrees(np.abs(error[:, [*tilt, *turn]]).max())),
        other_error=float(np.abs(error[:, remaining]).max()),
        asymmetry=max(float(np.ptp(error[:, columns], axis=1).max()) for columns in (tilt, turn)),
    )
