"""The full model of the tower, driven open loop by the controls of a reconfiguration.

The generated C of all 18 coordinates starts at rest and knows nothing of symmetry: it is given 18 rest
lengths and the torque M_3 as functions of time. How far it leaves the planned motion measures the plan.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.motion import Schedule
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.studies.papers.scs.printed import PrintedTower
from tensegrity_codegen.studies.papers.scs.reconfiguration import Reconfiguration
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricTower
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import UnstableError
from tensegrity_codegen.tables.request import ModelRequest


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


def compile_tower(tower: SymmetricTower) -> CompiledModel:
    """Return the full model in C, with all rest lengths changeable and the inputs M_1 to F_3."""
    everything = {"rest_length": tuple(range(tower.system.n_members))}
    request = ModelRequest(simulation_quantities("bodies"), everything, formulation="bodies")
    return build_library(tower.system, request).load()


def drive(plan: Reconfiguration) -> Schedule:
    """Return the plan's rest lengths and inputs as functions of time."""

    def schedule(time: float) -> Mapping[str, Any]:
        control = plan.control(time)
        inputs = np.array([0.0, 0.0, control.input[2], 0.0, 0.0, plan.force])
        rest = plan.rest_lengths(time, control.tension)
        return {"rest_length": plan.tower.spread(rest), "input": inputs}

    return schedule


def drive_as_printed(plan: Reconfiguration) -> Schedule:
    """Return controls with the tensions of (34) as printed, without the centrifugal term; M_3 by (33)."""
    printed = PrintedTower.of(plan.tower)

    def schedule(time: float) -> Mapping[str, Any]:
        motion = plan.path.at(time)
        tension = printed.tension(motion.s, motion.rate, motion.change, plan.force, as_printed=True)
        torque = printed.torque(motion.s, motion.rate, motion.change)
        rest = plan.rest_lengths(time, tension)
        return {
            "rest_length": plan.tower.spread(rest),
            "input": np.array([0.0, 0.0, torque, 0.0, 0.0, plan.force]),
        }

    return schedule


def track(
    plan: Reconfiguration,
    *,
    schedule: Schedule | None = None,
    model: CompiledModel | None = None,
    samples: int = 201,
    method: str = "scipy_dop853",
    rtol: float = 1e-11,
    atol: float = 1e-12,
    t_end: float | None = None,
) -> Tracking:
    """Return how the full model follows the plan, from rest at its start, driven by `schedule` alone.

    schedule: `drive(plan)` if not given; model: `compile_tower(plan.tower)` if not given; t_end [s]: the
    plan's duration if not given. Raises UnstableError if the simulation does not reach its end.
    """
    restricted = plan.tower.restricted
    start = restricted.coordinate(plan.path.at(0.0).s)
    trajectory = simulate(
        model or compile_tower(plan.tower),
        plan.duration if t_end is None else t_end,
        samples=samples,
        method=method,
        rtol=rtol,
        atol=atol,
        coordinate=start,
        velocity=np.zeros(len(start)),
        schedule=schedule or drive(plan),
        control="steps",
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
    others = [k for k in range(len(names)) if k not in (*tilt, *turn)]
    return Tracking(
        trajectory=trajectory,
        error=error,
        angle_error_deg=float(np.degrees(np.abs(error[:, [*tilt, *turn]]).max())),
        other_error=float(np.abs(error[:, others]).max()),
        asymmetry=max(float(np.ptp(error[:, columns], axis=1).max()) for columns in (tilt, turn)),
    )
