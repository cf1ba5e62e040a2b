"""Our methods on a case: simulated as a user would, every run within a time limit."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import NonFiniteError, TensegrityError
from tensegrity_codegen.runtime.consistency import make_consistent
from tensegrity_codegen.runtime.evaluate_trajectory import evaluate_trajectory
from tensegrity_codegen.runtime.integrate import integrate
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.motion import Motion, Progress
from tensegrity_codegen.runtime.options import RunOptions, check_options
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.models import values_of

__all__ = ["SAMPLES", "Ending", "run_own", "tolerance_of"]

FloatArray = NDArray[np.float64]

SAMPLES = 5
ATOL_OF_RTOL = 1e-3


class OverTime(Exception):
    """A run that was stopped because its time was up."""


@dataclass(frozen=True)
class Ending:
    """How a run ended: "ok", another status, "error" (a named one) or "over time"; its states (n_t, n).

    vibration, vibration_speed: what the method says that stiff members vibrate about their smooth motion, and
    that it has damped out, of positions [m] and of velocities [m/s]; of nodes, where some members meet.
    """

    status: str
    message: str
    state: FloatArray
    seconds: float
    vibration: float = 0.0
    vibration_speed: float = 0.0


def run_own(model: CompiledModel, case: Case, method: str, rtol: float, limit: float) -> Ending:
    """Return how one of our methods ends on a case, its error at the samples controlled to `rtol`.

    A method with a fixed step takes the case's. limit: seconds of CPU time after which it is stopped.
    """
    started = time.process_time()
    nothing = np.zeros((0, 2 * len(model.manifest.coordinate_name)))
    try:
        raw, status, message = _simulate(model, case, method, rtol, partial(_watch, started + limit))
    except OverTime:
        return Ending("over time", f"stopped after {limit:g} s", nothing, time.process_time() - started)
    except TensegrityError as error:
        return Ending("error", error.problem, nothing, time.process_time() - started)
    told = [_class_of(case.structure) * _left_out(raw, name) for name in ("vibration", "vibration_speed")]
    return Ending(status, message, raw.state, time.process_time() - started, *told)


def tolerance_of(state: FloatArray, rtol: float) -> FloatArray:
    """Return the error that `rtol` allows at each component of states (n_t, n)."""
    allowed: FloatArray = ATOL_OF_RTOL * rtol + rtol * np.abs(state)
    return allowed


def _left_out(raw: RawTrajectory, name: str) -> float:
    """Return how much of the vibrations of stiff members a run leaves out, as it says itself."""
    return float(raw.evidence.get(f"{name}_error", raw.evidence.get(name, 0.0)))


def _class_of(structure: Structure) -> int:
    """Return how many stiff members meet in a node at most."""
    ends = structure.connectivity[~structure.tension_only]
    return int(np.bincount(ends.ravel(), minlength=1).max())


def _simulate(
    model: CompiledModel, case: Case, method: str, rtol: float, watch: Progress
) -> tuple[RawTrajectory, str, str]:
    """Return the samples, and the status and message that a simulation gives them."""
    values = dict(values_of(model, case.structure))
    step = None if case.step is None else case.step * case.t_end
    options = RunOptions(method, rtol, ATOL_OF_RTOL * rtol, step)
    check_options(options, case.t_end, SAMPLES)
    if not all(np.isfinite(value).all() for value in values.values()):
        raise NonFiniteError("the initial state is not finite", where="simulate")
    place, speed = make_consistent(model, values.pop("coordinate"), values.pop("velocity"), values)
    state, times = np.concatenate([place, speed]), np.linspace(0.0, case.t_end, SAMPLES)
    raw = integrate(Motion(model, state, times, values, watch), options)
    found = evaluate_trajectory(model, raw, values)
    return raw, found.status, found.message


def _watch(deadline: float, fraction: float) -> None:
    if fraction < 1.0 and time.process_time() > deadline:
        raise OverTime
