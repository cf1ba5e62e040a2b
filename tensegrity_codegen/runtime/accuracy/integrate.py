"""One entry for all methods of integration, their error held to what is asked for."""

from dataclasses import replace

from tensegrity_codegen.runtime.accuracy.automatic import integrate_auto
from tensegrity_codegen.runtime.accuracy.damped_vibration import integrate_implicit_to_samples
from tensegrity_codegen.runtime.accuracy.explicit import integrate_explicit_to_samples
from tensegrity_codegen.runtime.accuracy.rates import find_fastest
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_motion
from tensegrity_codegen.runtime.accuracy.step_doubling import check_by_doubling
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.implicit import integrate_implicit
from tensegrity_codegen.runtime.integrate.methods import Kind, find_method
from tensegrity_codegen.runtime.integrate.motion import Motion, Progress
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import NOT_ESTIMATED, RawTrajectory
from tensegrity_codegen.runtime.integrate.rk4 import integrate_rk4
from tensegrity_codegen.runtime.integrate.scipy_methods import integrate_scipy
from tensegrity_codegen.tables.integrators import INTEGRATORS, find_row

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
