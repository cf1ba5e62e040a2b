"""Our methods on a case: simulated as a user would, every run within a time limit."""

import time
from dataclasses import dataclass
from functools import partial

import numpy as np

from tensegrity_codegen.runtime.accuracy.integrate import integrate
from tensegrity_codegen.runtime.integrate.motion import Motion, Progress
from tensegrity_codegen.runtime.integrate.options import RunOptions, check_options
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.consistency import make_consistent
from tensegrity_codegen.runtime.trajectory.evaluate_trajectory import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.models import values_of
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError, TensegrityError

SAMPLES = 5
ATOL_OF_RTOL = 1e-3


class OverTime(Exception):
    """A run that was stopped because its time was up."""


@dataclass(frozen=True)
class Ending:
    """How a run ended: "ok", another status, "error" (a named one) or "over time"; its states (n_t, n).

    speed_bound [m/s]: by how much velocities are off at most since stiff members vibrate unseen, as the run
    itself says; tension (n_t, n_members) [N], None where the run has none; tension_bound [N]: as speed_bound,
    of two-sided members whose tensions are unknowns of the method; None where they follow from lengths.
    """

    status: str
    message: str
    state: FloatArray
    seconds: float
    speed_bound: float = 0.0
    tension: FloatArray | None = None
    tension_bound: float | None = None


def run_own(model: CompiledModel, case: Case, method: str, rtol: float, limit: float) -> Ending:
    """Return how one of our methods ends on a case, its error at the samples controlled to `rtol`.

    A method with a fixed step takes the case's. limit: seconds of CPU time after which it is stopped.
    """
    started = time.process_time()
    nothing = np.zeros((0, 2 * len(model.manifest.coordinate_name)))
    try:
        raw, found = _simulate(model, case, method, rtol, partial(_watch, started + limit))
    except OverTime:
        return Ending("over time", f"stopped after {limit:g} s", nothing, time.process_time() - started)
    except TensegrityError as error:
        return Ending("error", error.problem, nothing, time.process_time() - started)
    speed = float(raw.evidence.get("vibration_speed_error", 0.0))
    pull = raw.evidence.get("vibration_tension_error")
    seconds = time.process_time() - started
    return Ending(found.status, found.message, raw.state, seconds, speed, found.member_tension, pull)


def tolerance_of(structure: Structure, state: FloatArray, rtol: float) -> FloatArray:
    """Return the error that `rtol` allows of each component of states (n_t, n): by its node's vector."""
    node = structure.coordinate_node_axis[:, 0]
    same = (node[:, None] == node[None, :]).astype(np.float64)
    lengths = [np.sqrt(part**2 @ same) for part in np.split(state, 2, axis=1)]
    allowed: FloatArray = ATOL_OF_RTOL * rtol + rtol * np.hstack(lengths)
    return allowed


def _simulate(
    model: CompiledModel, case: Case, method: str, rtol: float, watch: Progress
) -> tuple[RawTrajectory, Trajectory]:
    """Return the samples, and the result that a simulation makes of them."""
    values = dict(values_of(model, case.structure))
    step = None if case.step is None else case.step * case.t_end
    options = RunOptions(method, rtol, ATOL_OF_RTOL * rtol, step)
    check_options(options, case.t_end, SAMPLES)
    if not all(np.isfinite(value).all() for value in values.values()):
        raise NonFiniteError("the initial state is not finite", where="simulate")
    place, speed = make_consistent(model, values.pop("coordinate"), values.pop("velocity"), values)
    state, times = np.concatenate([place, speed]), np.linspace(0.0, case.t_end, SAMPLES)
    raw = integrate(Motion(model, state, times, values, watch), options)
    return raw, evaluate_trajectory(model, raw, values)


def _watch(deadline: float, fraction: float) -> None:
    if fraction < 1.0 and time.process_time() > deadline:
        raise OverTime
