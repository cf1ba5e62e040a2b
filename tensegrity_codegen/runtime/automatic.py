"""The method `auto`: one of the others, by model and tolerance, tightened until its error holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.choice import choose_method
from tensegrity_codegen.runtime.error_control import MOST_OF_TOLERANCE, tighten_until_converged
from tensegrity_codegen.runtime.event_log import Watch
from tensegrity_codegen.runtime.integration import Progress
from tensegrity_codegen.runtime.jumps import bound_jumps
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.radau import integrate_radau
from tensegrity_codegen.runtime.run_end import MOST_STEPS
from tensegrity_codegen.runtime.trajectory import RawTrajectory
from tensegrity_codegen.runtime.vibration import Vibration

__all__ = ["PASSING_KINKS", "integrate_auto"]

FloatArray = NDArray[np.float64]

PASSING_KINKS = 0.7  # of the difference of two runs of radau counts: it does not end steps at kinks
FAR = 1e5  # from the origin, over the size of the structure
NEAR = ("node_position", "rigid_bar")  # formulations in which positions are coordinates


def integrate_auto(
    model: CompiledModel,
    state: FloatArray,
    sample_time: FloatArray,
    rtol: float,
    atol: float,
    arguments: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
    *,
    max_steps: int = MOST_STEPS,
    keep: str = "",
) -> RawTrajectory:
    """Integrate from state (n_states,) over sample_time (n_t,) [s] by what choose_method says.

    The estimated error of positions is within atol + rtol |x| at every sample, component by component;
    that of velocities too, but where radau runs: to its smooth motion vibrations of stiff members are added
    in closed form, and `evidence` says how far off these may be, vibration_error [m] and
    vibration_speed_error [m/s]; the message does so where the latter is more than the tolerance. Where radau
    misses the tolerance the explicit method has its turn. Status "not_converged" where none meets it. Raises
    FormulationError where the library has no method with error control, and what the methods raise.
    """
    given = arguments or {}
    span = float(sample_time[1]), float(sample_time[-1])
    choice = choose_method(model, state, span, rtol, atol, given, watches=watch is not None or bool(keep))

    def explicit(name: str, most: int = max_steps) -> RawTrajectory:
        found = tighten_until_converged(
            lambda r, a: integrate_adaptive(
                name, model, state, sample_time, r, a, given, progress, watch, max_steps=most, keep=keep
            ),
            rtol,
            atol,
            least_atol=choice.noise,
        )
        return _by_auto(found)

    if choice.name != "radau":
        return _advise(replace(explicit(choice.name), why=choice.why), model)

    vibration = choice.vibration
    smooth = state if vibration is None else vibration.smooth(state)

    def run(step_rtol: float, step_atol: float) -> RawTrajectory:
        raw = integrate_radau(
            model, smooth, sample_time, step_rtol, step_atol, given, progress,
            quiet=choice.quiet, max_steps=min(max_steps, choice.most_steps),
        )  # fmt: skip
        if vibration is None:
            return raw
        jumps = bound_jumps(model, raw, raw.tension_member, choice.frequency, given)
        return _with_vibration(raw, state, vibration, span, jumps)

    found = _by_auto(tighten_until_converged(run, rtol, atol, _left_out, trust=PASSING_KINKS))
    if found.status == "ok" and (found.error_estimate or 0.0) <= 1.0:
        return _tell(found, choice.why, rtol, atol)
    if choice.otherwise:
        other = explicit(choice.otherwise, min(max_steps, choice.most_otherwise))
        if other.status == "ok":
            return replace(other, why=f"{choice.why}; radau missed the tolerance, so {choice.otherwise}")
    return _advise(_tell(found, choice.why, rtol, atol), model)


def _by_auto(raw: RawTrajectory) -> RawTrajectory:
    """Return the run with the word that its method was chosen."""
    return replace(raw, method=f"auto ({raw.method})")


def _advise(raw: RawTrajectory, model: CompiledModel) -> RawTrajectory:
    """Return the run with the cure where it fails since coordinates are huge beside the structure."""
    place = model.manifest.stated_position
    size = float(np.ptp(place, axis=0).max(initial=0.0))
    far = float(np.abs(place).max(initial=0.0))
    if raw.status != "not_converged" or model.manifest.formulation not in NEAR or far <= FAR * size:
        return raw
    message = (
        f"{raw.message}; positions of {far:.2g} m round by {far * 1.1e-16:.2g} m: move the structure to the "
        "origin, or use formulation node_distance"
    )
    return replace(raw, message=message)


def _with_vibration(
    raw: RawTrajectory,
    start: FloatArray,
    vibration: Vibration,
    span: tuple[float, float],
    jumps: tuple[float, float],
) -> RawTrajectory:
    """Return a run of radau with the vibrations that it leaves out, and with how far off these may be."""
    position, speed = vibration.error(*span)
    added = vibration.add_to(raw, start)
    errors = {"vibration_error": position + jumps[0], "vibration_speed_error": speed + jumps[1]}
    return replace(added, evidence={**raw.evidence, **errors})


def _left_out(raw: RawTrajectory) -> FloatArray:
    """Return how far the states may be off by vibrations of stiff members, (n_states,)."""
    amounts = [raw.evidence.get(name, 0.0) for name in ("vibration_error", "vibration_speed_error")]
    return np.repeat(amounts, raw.state.shape[1] // 2)


def _tell(raw: RawTrajectory, why: str, rtol: float, atol: float) -> RawTrajectory:
    """Return the run with its reason, and a word on velocities where they do not meet the tolerance."""
    n = raw.state.shape[1] // 2
    speed = raw.evidence.get("vibration_speed_error", 0.0)
    allowed = atol + rtol * float(np.abs(raw.state[:, n:]).max(initial=0.0))
    message = raw.message
    if speed > allowed:
        message += f"; velocities of bars are known to {speed:.2g} m/s: rk853 by name resolves them"
    if raw.status == "ok" and (raw.error_estimate or 0.0) > MOST_OF_TOLERANCE:
        message += "; vibrations of bars exceed the tolerance: name rk853"
        raw = replace(raw, status="not_converged")
    return replace(raw, message=message, why=why)
