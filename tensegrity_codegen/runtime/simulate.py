"""Simulation: one entry, methods by name."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from tensegrity_codegen.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.runtime.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.automatic import PASSING_KINKS, integrate_auto
from tensegrity_codegen.runtime.choice import wanted_integrators
from tensegrity_codegen.runtime.condition import build_condition, is_comparison
from tensegrity_codegen.runtime.consistency import make_consistent
from tensegrity_codegen.runtime.double_only import require_double
from tensegrity_codegen.runtime.error_control import tighten_until_converged
from tensegrity_codegen.runtime.event_log import Condition, Watch
from tensegrity_codegen.runtime.flow import build_derivative
from tensegrity_codegen.runtime.keep import check_keep
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.motion_events import MotionEvent, stop_at_contact
from tensegrity_codegen.runtime.radau import integrate_radau
from tensegrity_codegen.runtime.rk4 import integrate_rk4
from tensegrity_codegen.runtime.run_end import MOST_STEPS
from tensegrity_codegen.runtime.sample_memory import check_sample_memory
from tensegrity_codegen.runtime.step_doubling import check_by_doubling
from tensegrity_codegen.runtime.trajectory import RawTrajectory, Schedule, Trajectory, evaluate_trajectory
from tensegrity_codegen.structure import Structure

__all__ = ["METHODS", "check_arguments", "check_options", "integrators_for", "simulate"]

FloatArray = NDArray[np.float64]
Progress = Callable[[float], None]

# Every method by name, and what it is.
METHODS = {
    "auto": "rk853, rk54 or radau, by stiffness, damping and tolerance, with ever tighter steps until the "
    "estimated error at the samples meets rtol and atol",
    "rk54": "Dormand and Prince's Runge-Kutta 5(4) in C, steps cut at events",
    "rk853": "Dormand and Prince's Runge-Kutta 8(5,3) in C, steps cut at events",
    "radau": "Radau IIA-5 in C, tensions of bars as unknowns: steps do not depend on how stiff bars are",
    "rk4": "Runge-Kutta 4 in C with the fixed step `step`, checked by a run with twice that",
    "scipy_dop853": "SciPy's explicit DOP853 over the same functions, a check",
    "scipy_rk45": "SciPy's explicit RK45 over the same functions, a check",
    "scipy_lsoda": "SciPy's LSODA over the same functions, a check",
    "scipy_radau": "SciPy's implicit Radau over the same functions, a check",
}
ADAPTIVE = ("rk54", "rk853")
MOST_FIXED_STEPS = 100_000_000  # unless --max-steps allows more: some seconds for a small structure
CONTROLS = ("samples", "steps")  # what the tolerance bounds: the error of every sample, or of each step
MOST_SAMPLES = 1_000_000
LARGEST_COUNT = 2**53  # steps; beyond, the time n h is no longer told from its neighbours
SMALLEST_SCIPY_RTOL = 100 * np.finfo(np.float64).eps  # SciPy raises smaller ones to this
SCIPY_NAME: dict[str, Any] = {
    "scipy_dop853": "DOP853",
    "scipy_rk45": "RK45",
    "scipy_lsoda": "LSODA",
    "scipy_radau": "Radau",
}


def simulate(
    model: CompiledModel,
    t_end: float,
    *,
    samples: int = 101,
    method: str = "auto",
    step: float | None = None,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    coordinate: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    schedule: Schedule | None = None,
    until_contact: bool = False,
    condition: str | Condition | None = None,
    until_condition: bool = False,
    progress: Progress | None = None,
    max_steps: int = MOST_STEPS,
    keep: str = "",
    control: str = "samples",
) -> Trajectory:
    """Simulate H q'' = f from t = 0 to t_end [s] and return `samples` equally spaced states.

    coordinate, velocity: initial state, the scene's own if not given; arguments: run-time parameters by
    name; schedule: time [s] -> run-time parameters and inputs by name that change with it, for SciPy's
    methods; step [s]: for the method "rk4" only; progress: called with the fraction done; max_steps: that one
    run with error control may try, "not_converged" where they do not reach the end. until_contact: end
    with the first contact of bars, as the last sample and in `events`, at t = 0 where they touch from the
    start; needs bar_distance and bar_distance_jacobian, else FormulationError.

    Methods in C with error control cut their steps where cables go slack or taut, if the library has that
    event, and where the sign of a condition changes: an expression over quantities, see condition.py, or
    (time, coordinate, velocity) -> number, for libraries with the event "condition"; `log` has all of them.
    until_condition: end with the first such change, as with a contact; where the condition is a comparison,
    at t = 0 if it holds from the start.

    control: what rtol and atol bound in rk54, rk853 and radau. "samples": the estimated error of all samples;
    the steps' tolerance is tightened until two runs agree so well, else the status is "not_converged"; rk4 is
    held to runs with other steps. "steps": the error of each step, in one run, and nothing is said of their
    sum, which may be far more over long times and for stiff members.

    keep: "energy", for undamped motions over long times: each step of rk54, rk853 or auto ends at the energy
    of the start; needs a library built with keep = ("energy",), else FormulationError.

    A run that becomes unstable or misses its tolerance comes back with that status and the samples it
    reached. Raises InvalidValueError for values outside their range, UnknownNameError for an unknown method
    or argument, FormulationError where the model lacks the integrator, NonFiniteError for values that are
    not finite.
    """
    check_options(
        t_end, samples, method, step, rtol, atol, until_contact=until_contact, max_steps=max_steps, keep=keep,
        control=control,
    )  # fmt: skip
    require_double(model.manifest, "a simulation from Python")
    check_sample_memory(model.manifest, samples)
    arguments = dict(arguments or {})
    check_arguments(model, arguments)
    if schedule is not None:
        _check_schedule(model, schedule, method)
    q0 = _initial(model, "coordinate", coordinate)
    v0 = _initial(model, "velocity", velocity)
    q0, v0 = make_consistent(model, q0, v0, arguments)
    state, sample_time = np.concatenate([q0, v0]), np.linspace(0.0, t_end, samples)

    watch = None if condition is None else _watch(model, method, condition, until_condition, arguments)

    def integrate(time: FloatArray, step: float | None = step) -> RawTrajectory:
        return _integrate(
            model,
            state,
            time,
            method,
            step,
            rtol,
            atol,
            arguments,
            schedule,
            progress,
            watch,
            max_steps,
            keep,
            control,
        )

    events: tuple[MotionEvent, ...] = ()
    if until_contact:
        raw, events = stop_at_contact(model, integrate, sample_time, arguments=arguments, schedule=schedule)
    elif watch is not None and until_condition and _holds(watch, condition, q0, v0):
        raw = RawTrajectory(
            sample_time[:1], state[None, :], "ok", "the condition holds from the start", method, 0, 0
        )
        events = (MotionEvent("condition", (str(condition),), 0.0, 0.0, q0, v0),)
    else:
        raw = (
            _checked(integrate, sample_time, step, model) if control == "samples" else integrate(sample_time)
        )
        events = _end_event(raw, condition) if until_condition else ()
    return replace(evaluate_trajectory(model, raw, arguments, schedule), events=events)


def integrators_for(
    method: str, structure: Structure | None = None, formulation: str = "node_position", rtol: float = 1e-6
) -> tuple[str, ...]:
    """Return the integrators that a library must hold for `method`, none for SciPy's methods.

    structure, formulation, rtol: what is simulated and how well, by which `auto` wants one or more.
    """
    if method in SCIPY_NAME:
        return ()
    return wanted_integrators(structure, formulation, rtol) if method == "auto" else (method,)


def _integrate(
    model: CompiledModel,
    state: FloatArray,
    sample_time: FloatArray,
    method: str,
    step: float | None,
    rtol: float,
    atol: float,
    arguments: Mapping[str, Any],
    schedule: Schedule | None,
    progress: Progress | None,
    watch: Watch | None,
    max_steps: int,
    keep: str,
    control: str,
) -> RawTrajectory:
    """Return the states at the sample times by one of METHODS."""
    if method == "rk4":
        return integrate_rk4(model, state, sample_time, float(step or 0.0), arguments, progress)
    if method in SCIPY_NAME:
        return _scipy(model, state, sample_time, SCIPY_NAME[method], rtol, atol, arguments, schedule)
    if method == "auto":
        return integrate_auto(
            model, state, sample_time, rtol, atol, arguments, progress, watch, max_steps=max_steps, keep=keep
        )

    def run(rtol: float, atol: float) -> RawTrajectory:
        given = (model, state, sample_time, rtol, atol, arguments, progress)
        if method == "radau":
            return integrate_radau(*given, max_steps=max_steps)
        return integrate_adaptive(method, *given, watch, max_steps=max_steps, keep=keep)

    if control == "steps":
        return run(rtol, atol)
    return tighten_until_converged(run, rtol, atol, trust=PASSING_KINKS if method == "radau" else 0.0)


def _checked(
    integrate: Callable[..., RawTrajectory],
    time: FloatArray,
    step: float | None,
    model: CompiledModel,
) -> RawTrajectory:
    """Return a run, one with a fixed step held to one with another step."""
    if step is None:
        return integrate(time)
    return check_by_doubling(lambda h: integrate(time, h), step, model.manifest)


def _watch(
    model: CompiledModel,
    method: str,
    condition: str | Condition,
    until_condition: bool,
    arguments: Mapping[str, Any],
) -> Watch:
    """Return what the integrator shall watch: the condition, and the cables if it knows them."""
    if method not in (*ADAPTIVE, "auto"):
        raise InvalidValueError(
            "this method watches no condition",
            where="condition",
            given=method,
            allowed=", ".join(("auto", *ADAPTIVE)),
        )
    call = build_condition(condition, model, arguments) if isinstance(condition, str) else condition
    known = next((spec.events for spec in model.manifest.integrators if spec.name in ADAPTIVE), ())
    kinds = (*(kind for kind in known if kind == "cable"), "condition")
    return Watch(kinds, ("condition",) if until_condition else (), call)


def _holds(watch: Watch, condition: str | Condition | None, q: FloatArray, v: FloatArray) -> bool:
    """Return whether a condition that is a comparison holds at the start."""
    call = watch.condition
    return (
        isinstance(condition, str) and is_comparison(condition) and call is not None and call(0.0, q, v) > 0
    )


def _end_event(raw: RawTrajectory, condition: str | Condition | None) -> tuple[MotionEvent, ...]:
    """Return the event of the condition that has ended a run, none if it went to its end."""
    if not raw.log.count or raw.log.kind[-1] != "condition" or raw.time[-1] < raw.log.time[-1]:
        return ()
    n = raw.state.shape[1] // 2
    name = condition if isinstance(condition, str) else "condition"
    state = raw.state[-1]
    return (MotionEvent("condition", (name,), float(raw.time[-1]), 0.0, state[:n], state[n:]),)


def _initial(model: CompiledModel, name: str, value: ArrayLike | None) -> FloatArray:
    nominal = model.nominal(name)
    given = nominal if value is None else np.asarray(value, dtype=np.float64)
    if given.shape != nominal.shape:
        raise InvalidValueError(
            "wrong shape", where=name, given=given.shape, allowed=f"shape {nominal.shape}"
        )
    if not np.all(np.isfinite(given)):
        raise NonFiniteError(f"the initial {name} is not finite", where="simulate", allowed="finite numbers")
    return given


def check_arguments(model: CompiledModel, arguments: Mapping[str, Any]) -> None:
    """Raise UnknownNameError for a word that is no argument of the model at run time."""
    known = [item.name for item in model.manifest.arguments if item.name not in ("coordinate", "velocity")]
    for name in arguments:
        if name not in known:
            raise UnknownNameError(
                "the model has no such argument at run time",
                where="arguments",
                given=name,
                allowed=", ".join(known) or "none",
                hint="keep it changeable under [parameters] of the scene; pass the initial state as "
                "coordinate= and velocity=",
            )


def _check_schedule(model: CompiledModel, schedule: Schedule, method: str) -> None:
    """Raise for a method that holds arguments constant, and for words that no schedule can change."""
    if method not in SCIPY_NAME:
        raise InvalidValueError(
            "this method holds parameters and inputs constant",
            where="schedule",
            given=method,
            allowed=", ".join(SCIPY_NAME),
        )
    first = schedule(0.0)
    check_arguments(model, first)
    if "anchor_position" in first:
        raise InvalidValueError("anchors stay where they are", where="schedule", given="anchor_position")


def _scipy(
    model: CompiledModel,
    state: FloatArray,
    sample_time: FloatArray,
    method: Any,
    rtol: float,
    atol: float,
    arguments: Mapping[str, Any],
    schedule: Schedule | None,
) -> RawTrajectory:
    derivative = build_derivative(model, arguments, schedule)

    def stopped(why: str) -> RawTrajectory:
        return RawTrajectory(sample_time[:1], state[None, :], "unstable", why, f"scipy {method}", 0, 0)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what they say is in the status
            found = solve_ivp(
                derivative, (0.0, sample_time[-1]), state, method, t_eval=sample_time, rtol=rtol, atol=atol
            )
    except NonFiniteError as error:
        return stopped(error.problem)
    if len(found.t) == 0:
        return stopped(str(found.message))
    return RawTrajectory(
        time=found.t,
        state=found.y.T,
        status="ok" if found.status == 0 else "unstable",
        message=str(found.message),
        method=f"scipy {method}",
        n_steps=len(found.t),
        n_evaluations=int(found.nfev),
    )


def check_options(
    t_end: float,
    samples: int,
    method: str,
    step: float | None,
    rtol: float,
    atol: float,
    *,
    until_contact: bool = False,
    max_steps: int = MOST_STEPS,
    keep: str = "",
    control: str = "samples",
) -> None:
    """Raise InvalidValueError or UnknownNameError for options that `simulate` cannot work with."""
    if method not in METHODS:
        raise UnknownNameError(
            "unknown method", where="--method", given=method, hint=suggest(method, METHODS)
        )
    if until_contact and method == "radau":
        raise InvalidValueError(
            "method 'radau' does not look for contacts",
            where="--method",
            given=method,
            allowed="with --until contact: auto, rk54, rk853, rk4 or SciPy's methods",
            hint="--method auto",
        )
    check_keep(keep, method)
    if control not in CONTROLS:
        raise InvalidValueError(
            "unknown control of the error", where="--control", given=control, allowed=", ".join(CONTROLS)
        )
    if control == "steps" and method not in (*ADAPTIVE, "radau", "rk4"):
        raise InvalidValueError(
            "this method's samples are always or never checked",
            where="--control",
            given=f"{control} with method {method!r}",
            allowed="steps with rk853, rk54, radau, rk4; samples with any",
        )
    for key, value in (("--t-end", t_end), ("--rtol", rtol), ("--atol", atol)):
        if not (np.isfinite(value) and value > 0):
            raise InvalidValueError("out of range", where=key, given=value, allowed="a finite number > 0")
    if rtol >= 1.0:
        raise InvalidValueError(
            "a relative tolerance that allows any result",
            where="--rtol",
            given=rtol,
            allowed="a number > 0 and < 1",
        )
    if not 2 <= samples <= MOST_SAMPLES:
        few = "few" if samples < 2 else "many"
        raise InvalidValueError(
            f"too {few} samples", where="--samples", given=samples, allowed=f"2 to {MOST_SAMPLES}"
        )
    if method in SCIPY_NAME and rtol < SMALLEST_SCIPY_RTOL:
        raise InvalidValueError(
            "too small for SciPy's methods",
            where="--rtol",
            given=rtol,
            allowed=f"at least {SMALLEST_SCIPY_RTOL:.3g}",
        )
    if method == "rk4" and step is None:
        raise InvalidValueError(
            "method 'rk4' needs a step",
            where="--step",
            allowed="a finite number > 0 [s]",
            hint="--method auto",
        )
    if method != "rk4" and step is not None:
        raise InvalidValueError(
            "only fixed-step methods take a step", where="--step", given=step, hint="--method rk4"
        )
    if step is not None and not (np.isfinite(step) and step > 0):
        raise InvalidValueError("out of range", where="--step", given=step, allowed="a finite number > 0 [s]")
    if not 1 <= max_steps <= LARGEST_COUNT:
        raise InvalidValueError(
            "out of range", where="--max-steps", given=max_steps, allowed=f"1 to {LARGEST_COUNT}"
        )
    most = max(max_steps, MOST_FIXED_STEPS)
    if step is not None and t_end > most * step * (1.0 + 1e-9):
        raise InvalidValueError(
            "too small for the simulated time",
            where="--step",
            given=step,
            allowed=f"at least {t_end / most:.3g} s, which makes {most} steps",
            hint="a longer step, a shorter time, or more steps by --max-steps",
        )
