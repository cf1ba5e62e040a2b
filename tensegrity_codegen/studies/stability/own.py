"""Our methods on a case: one compiled model, every run within a time limit."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import TensegrityError
from tensegrity_codegen.pipeline import build_library
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.runtime.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.error_control import tighten_until_converged
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.radau import integrate_radau
from tensegrity_codegen.runtime.simulate import check_options
from tensegrity_codegen.runtime.trajectory import RawTrajectory, simulation_quantities
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case, as_springs

__all__ = ["Ending", "compile_cases", "methods_for", "run_own", "tolerance_of", "values_of"]

FloatArray = NDArray[np.float64]

EXPLICIT = ("rk54", "rk853")
FOR_STIFF_BARS = "radau"
SAMPLES = 5
ATOL_OF_RTOL = 1e-3


class OverTime(Exception):
    """A run that was stopped because its time was up."""


@dataclass(frozen=True)
class Ending:
    """How a run ended: "ok", another status, "error" (a named one) or "over time"; its states (n_t, n).

    vibration_speed: what the method says that it has damped out of velocities at most [m/s].
    """

    status: str
    message: str
    state: FloatArray
    seconds: float
    vibration_speed: float = 0.0


def methods_for(structure: Structure) -> tuple[str, ...]:
    """Return our methods with error control that a structure can have."""
    free = ~np.all(structure.node_anchored[:, list(structure.axes)], axis=1)
    moves = np.any(free[structure.connectivity], axis=1)
    is_stiff = bool((~structure.tension_only & moves).any())
    return (*EXPLICIT, FOR_STIFF_BARS) if is_stiff else EXPLICIT


def compile_cases(structure: Structure, *, compiler: str | None, flags: str) -> CompiledModel:
    """Return the model of a structure that keeps changeable whatever differs between its cases."""
    structure = as_springs(structure)
    members, anchored = tuple(range(structure.n_members)), structure.node_anchored.any(axis=1)
    kept = {
        "rest_length": members,
        "spring_constant": members,
        "damping": members,
        "node_mass": tuple(int(n) for n in np.flatnonzero(structure.node_mass)),
        "anchor_position": tuple(int(n) for n in np.flatnonzero(anchored)),
    }
    request = ModelRequest(
        simulation_quantities("node_position"),
        parameters={name: items for name, items in kept.items() if items},
        integrators=methods_for(structure),
    )
    return build_library(structure, request, compiler=compiler, flags=flags).load()


def values_of(model: CompiledModel, structure: Structure) -> dict[str, FloatArray]:
    """Return what the model needs to be this structure: state and run-time parameters."""
    places, axes = structure.coordinate_node_axis, list(structure.axes)
    found = {
        "coordinate": structure.node_position[places[:, 0], places[:, 1]],
        "velocity": structure.node_velocity[places[:, 0], places[:, 1]],
    }
    rows = {name: index for index, name in enumerate(structure.node_name)}
    for argument in model.manifest.arguments:
        if argument.name == "anchor_position":
            found["anchor_position"] = structure.node_position[[rows[n] for n in argument.over]][:, axes]
        elif argument.name == "node_mass":
            found["node_mass"] = structure.node_mass[[rows[n] for n in argument.over]]
        elif argument.name in ("rest_length", "spring_constant", "damping"):
            found[argument.name] = getattr(structure, argument.name)
    return found


def run_own(model: CompiledModel, case: Case, method: str, rtol: float, limit: float) -> Ending:
    """Return how one of our methods ends on a case, its error at the samples controlled to `rtol`.

    limit: seconds after which it is stopped.
    """
    values = values_of(model, case.structure)
    state = np.concatenate([values.pop("coordinate"), values.pop("velocity")])
    times, started = np.linspace(0.0, case.t_end, SAMPLES), time.monotonic()
    try:
        check_options(case.t_end, SAMPLES, method, None, rtol, ATOL_OF_RTOL * rtol)
    except TensegrityError as error:
        return Ending("error", error.problem, np.zeros((0, len(state))), 0.0)
    watch = partial(_watch, started + limit)
    step = partial(_integrate, model, method, state, times, values, watch)
    nothing = np.zeros((0, len(state)))
    try:
        raw = tighten_until_converged(step, rtol, ATOL_OF_RTOL * rtol)
    except OverTime:
        return Ending("over time", f"stopped after {limit:g} s", nothing, time.monotonic() - started)
    except TensegrityError as error:
        return Ending("error", error.problem, nothing, time.monotonic() - started)
    speed = float(raw.evidence.get("vibration_speed", 0.0))
    return Ending(raw.status, raw.message, raw.state, time.monotonic() - started, speed)


def _watch(deadline: float, fraction: float) -> None:
    if fraction < 1.0 and time.monotonic() > deadline:
        raise OverTime


def _integrate(
    model: CompiledModel,
    method: str,
    state: FloatArray,
    times: FloatArray,
    values: Mapping[str, Any],
    watch: Callable[[float], None],
    rtol: float,
    atol: float,
) -> RawTrajectory:
    if method == "radau":
        return integrate_radau(model, state, times, rtol, atol, values, watch)
    return integrate_adaptive(method, model, state, times, rtol, atol, values, watch)


def tolerance_of(state: FloatArray, rtol: float) -> FloatArray:
    """Return the error that `rtol` allows at each component of states (n_t, n)."""
    allowed: FloatArray = ATOL_OF_RTOL * rtol + rtol * np.abs(state)
    return allowed
