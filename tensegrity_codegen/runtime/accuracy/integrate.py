"""One entry for all methods of integration, their error held to what is asked for.

The method `auto` is one of the others, by model and tolerance, tightened until its error holds.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.choice import MAX_STEPS_AT_RINGS, Choice, choose_method
from tensegrity_codegen.runtime.accuracy.damped_vibration import (
    add_vibration_errors,
    find_min_counted,
    has_too_many_unwatched_events,
    integrate_implicit_to_samples,
    read_vibration_errors,
    report_vibration,
)
from tensegrity_codegen.runtime.accuracy.error_control import Checks, tighten_until_converged
from tensegrity_codegen.runtime.accuracy.explicit import integrate_explicit_to_samples, integrate_scheduled
from tensegrity_codegen.runtime.accuracy.rates import find_fastest
from tensegrity_codegen.runtime.accuracy.rigid_bars import integrate_with_rigid_bars
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_motion, tolerance_of_options
from tensegrity_codegen.runtime.accuracy.step_doubling import check_by_doubling
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.implicit import integrate_implicit
from tensegrity_codegen.runtime.integrate.methods import Kind, find_method
from tensegrity_codegen.runtime.integrate.motion import Motion, Progress
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import NOT_ESTIMATED, RawTrajectory
from tensegrity_codegen.runtime.integrate.rk4 import integrate_rk4
from tensegrity_codegen.runtime.integrate.scipy_methods import integrate_scipy
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import follows_in_c
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.integrators import DAMPED_INTEGRATOR, INTEGRATORS, STIFF_INTEGRATOR, find_row

MAX_DISTANCE_RATIO = 1e5  # from the origin, over the size of the structure


def integrate_auto(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion by what choose_method says.

    The estimated error of positions is within atol + rtol |x| at every sample, component by component;
    that of velocities too, except with the implicit method: it adds vibrations of stiff members to its smooth
    motion in closed form, and `evidence` has bounds of their errors, vibration_error [m] and
    vibration_speed_error [m/s]; the message reports the latter where it is above the tolerance. Where the
    implicit method misses the tolerance the explicit one runs. SciPy's methods run with a schedule that the
    library does not follow in C. Status "not_converged" where no method meets the tolerance.
    Raises FormulationError where the library has no method with error control, and what the methods raise.
    """
    if motion.schedule is not None and not follows_in_c(motion.schedule, motion.model.manifest):
        return integrate_scheduled(motion, options)
    rigid = integrate_with_rigid_bars(motion, options)
    if rigid is not None:
        return rigid
    choice = choose_method(motion, options)
    # Errors of steps alone are controlled: one run, without refinements.
    if options.control == "steps":
        return replace(_run_once(motion, options, choice), why=choice.why)
    # Explicit method: refine until the error holds.
    if choice.name != STIFF_INTEGRATOR and _has_damped_integrator(motion.model):
        return _run_at_rings(motion, options, choice)
    if choice.name != STIFF_INTEGRATOR:
        trajectory = _name_auto(integrate_explicit_to_samples(motion, replace(options, method=choice.name)))
        return _add_hint_of_origin(replace(trajectory, why=choice.why), motion.model)
    # Implicit method; again without events where there are too many of them.
    trajectory = _run_implicit(motion, options, choice)
    if has_too_many_unwatched_events(motion, trajectory):
        trajectory = _run_implicit(replace(motion, watch=Watch()), options, choice)
    is_doubtful = bool(choice.fallback) and _vibrates_at_events(motion, options, choice, trajectory)
    if trajectory.status == "ok" and (trajectory.error_estimate or 0.0) <= 1.0 and not is_doubtful:
        return report_vibration(replace(trajectory, why=choice.why), options)
    # The implicit method missed the tolerance, or its error is not known.
    missed = "vibrates at events, whose error is not known" if is_doubtful else "missed the tolerance"
    if choice.fallback:
        max_steps = min(options.max_steps, choice.max_fallback_steps)
        fallback_options = replace(options, method=choice.fallback, max_steps=max_steps)
        fallback = _name_auto(integrate_explicit_to_samples(motion, fallback_options))
        if fallback.status == "ok":
            return replace(fallback, why=f"{choice.why}; {STIFF_INTEGRATOR} {missed}, so {choice.fallback}")
    return _add_hint_of_origin(report_vibration(replace(trajectory, why=choice.why), options), motion.model)


def _has_damped_integrator(model: CompiledModel) -> bool:
    """Return whether a library of a structure with rings with friction holds the method for these."""
    return bool(model.manifest.ring_name) and any(
        spec.name == DAMPED_INTEGRATOR for spec in model.manifest.integrators
    )


def _run_at_rings(motion: Motion, options: RunOptions, choice: Choice) -> RawTrajectory:
    """Return the explicit run, or where it takes too many steps, or fails, that of the method for rings."""
    explicit = replace(options, method=choice.name)
    most = min(options.max_steps, MAX_STEPS_AT_RINGS)
    found = integrate_explicit_to_samples(motion, replace(explicit, max_steps=most))
    why = choice.why
    if found.status not in ("ok", "unstable"):
        why = f"{why}; {choice.name} did not do it within {most:,} steps, so {DAMPED_INTEGRATOR}"
        first, found = (
            found,
            integrate_explicit_to_samples(motion, replace(options, method=DAMPED_INTEGRATOR)),
        )
        if found.status != "ok":
            why = f"{choice.why}; {DAMPED_INTEGRATOR} failed too"
            found = first if most == options.max_steps else integrate_explicit_to_samples(motion, explicit)
    return replace(_name_auto(found), why=why)


def _run_once(motion: Motion, options: RunOptions, choice: Choice) -> RawTrajectory:
    """Return one run of the chosen method, its steps' errors alone within the tolerance."""
    if choice.name == STIFF_INTEGRATOR:
        return _name_auto(_prepare_implicit(motion, options, choice)(options.rtol, options.absolute))
    options = replace(options, method=choice.name, atol=max(options.absolute, choice.noise))
    return _name_auto(integrate_adaptive(motion, options))


def _run_implicit(motion: Motion, options: RunOptions, choice: Choice) -> RawTrajectory:
    """Return an implicit run, its error within the tolerance."""
    run = _prepare_implicit(motion, options, choice)
    checks = Checks(
        vibration=read_vibration_errors, min_counted=find_min_counted(motion), is_open=options.is_open
    )
    tolerance = tolerance_of_options(motion.model.manifest, options)
    return _name_auto(tighten_until_converged(run, tolerance, checks))


def _prepare_implicit(
    motion: Motion, options: RunOptions, choice: Choice
) -> Callable[[float, float], RawTrajectory]:
    """Return (rtol, atol) -> implicit run from the smooth state, with the vibrations about it added."""
    options = replace(options, max_steps=min(options.max_steps, choice.max_steps))
    vibration = choice.vibration
    smooth_motion = motion if vibration is None else replace(motion, state=vibration.smooth(motion.state))

    def run(rtol: float, atol: float) -> RawTrajectory:
        raw = integrate_implicit(smooth_motion, options.within(rtol, atol), quiet=choice.damped_amplitude)
        if vibration is None:
            return raw
        error = vibration.error(float(motion.sample_time[1]), motion.t_end)
        stiff = raw.tension_member
        with_errors = add_vibration_errors(motion, raw, error, stiff, choice.frequency, counts_turns=True)
        return vibration.add_to(with_errors, motion.state)

    return run


def _vibrates_at_events(motion: Motion, options: RunOptions, choice: Choice, found: RawTrajectory) -> bool:
    """Return whether cables went slack or taut under a vibration that is larger than the tolerance.

    Its closed form, which is added to the smooth motion, does not know when they would have done so under it.
    """
    if choice.vibration is None or not found.log.count:
        return False
    size = float(np.abs(motion.state[: len(motion.state) // 2]).max(initial=0.0))
    allowed = options.absolute + options.rtol * size
    return bool(choice.vibration.alone[:, 0].max(initial=0.0) > allowed)


def _name_auto(raw: RawTrajectory) -> RawTrajectory:
    """Return the run with the name of its method marked as chosen: "auto (rk853)"."""
    return replace(raw, method=f"auto ({raw.method})")


def _add_hint_of_origin(raw: RawTrajectory, model: CompiledModel) -> RawTrajectory:
    """Return the run; after a failure far from the origin its message advises to move the structure there."""
    position = model.manifest.stated_position
    size = float(np.ptp(position, axis=0).max(initial=0.0))
    distance = float(np.abs(position).max(initial=0.0))
    in_nodes = find_formulation(model.manifest.formulation).in_nodes
    if raw.status != "not_converged" or not in_nodes or distance <= MAX_DISTANCE_RATIO * size:
        return raw
    message = (
        f"{raw.message}; positions of {distance:.2g} m have rounding errors of {distance * 1.1e-16:.2g} m: "
        "move the structure to the origin, or use formulation node_distance"
    )
    return replace(raw, message=message)


# By the kind of method: one run, and runs whose error at the samples is controlled.
ONCE = {
    "auto": integrate_auto,
    "fixed": integrate_rk4,
    "adaptive": integrate_adaptive,
    "implicit": integrate_implicit,
    "scipy": integrate_scipy,
}
TO_SAMPLES = {
    "auto": integrate_auto,
    "adaptive": integrate_explicit_to_samples,
    "implicit": integrate_implicit_to_samples,
    "scipy": integrate_explicit_to_samples,
}
# How many runs it takes until the error is within the tolerance is not known before. Measured on the prism,
# towers of 10 and 100 stages and a tower of bodies with `auto` and `rk54`: one to eight, in the middle four,
# each about 1.3 times as long as that before.
RUNS_AFTER_FIRST, RUNS_AFTER_OTHERS = 2.5, 1.0  # that are expected after the first one, and after any other
RUN_TIME_GROWTH = 1.3  # time of a run over that of the one before
NEW_RUN_DROP = 1e-6  # a fraction smaller than the last one by more than this is that of a new run


def integrate(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return the states at the sample times by one of METHODS, checked unless `control` is "steps"."""
    options = set_atol_by_motion(motion, options)
    if options.control == "steps":
        run = integrate_once(motion, options)
        return replace(run, message=f"{run.message}; {NOT_ESTIMATED}") if run.status == "ok" else run
    if options.step is not None:
        return check_by_doubling(
            lambda step: integrate_once(motion, replace(options, step=step)),
            options.step,
            motion.model.manifest,
            find_fastest(motion),
        )
    return TO_SAMPLES[_find_kind(motion, options)](motion, options)


def integrate_once(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return one run of a method, its whole error unchecked unless the method checks it itself."""
    return ONCE[_find_kind(motion, options)](motion, options)


def _find_kind(motion: Motion, options: RunOptions) -> Kind:
    """Return the kind of the method; of one in C the kind that it has for this structure."""
    method = find_method(options.method)
    is_in_c = method.name in INTEGRATORS
    return find_row(method.name, motion.model.manifest.needs_state_jacobian).kind if is_in_c else method.kind


def join_runs(progress: Progress | None) -> Progress | None:
    """Return the progress of one run, that of all runs together being `progress`.

    progress: called with the fraction done of all runs, 0 to 1; it does not decrease, and stays below 1.
    Returns to be called with the fraction done of each run, 0 to 1; where it falls, a new run has begun.
    """
    if progress is None:
        return None
    # Each run gets its expected part of what is left: base, share of the run that is under way.
    base, last, share = 0.0, 0.0, 1.0 / (1.0 + RUN_TIME_GROWTH * RUNS_AFTER_FIRST)

    def join(fraction: float) -> None:
        nonlocal base, last, share
        if fraction < last - NEW_RUN_DROP:
            base += share
            share = (1.0 - base) / (1.0 + RUN_TIME_GROWTH * RUNS_AFTER_OTHERS)
        last = fraction
        progress(base + share * min(fraction, 1.0))

    return join
