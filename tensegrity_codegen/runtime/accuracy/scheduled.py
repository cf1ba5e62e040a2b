"""SciPy's methods, their error checked; they are the method `auto` where a schedule is a function of time."""

from dataclasses import replace
from functools import cache, partial

import numpy as np

from tensegrity_codegen.runtime.accuracy.damped_out import PASSING_KINKS
from tensegrity_codegen.runtime.accuracy.error_control import Checks, tighten_until_converged
from tensegrity_codegen.runtime.accuracy.lost_vibration import LostVibration
from tensegrity_codegen.runtime.accuracy.rounding import Rounding
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.accuracy.vibrations.fastest import find_decay, find_fastest, find_noise
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import SMALLEST_SCIPY_RTOL, RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.integrate.scipy_methods import integrate_scipy

WHY = "methods in C take values over time from a Profile of inputs only, so this schedule runs through SciPy"
MANY_STEPS = 20_000  # of an explicit method, from which on SciPy's implicit one has its turn first


def integrate_scheduled(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion with a schedule by SciPy's DOP853 or Radau, whichever meets the tolerance.

    Radau has its turn first where the fastest vibration or damping would take the explicit method more than
    MANY_STEPS steps. The estimated error at the samples is within atol + rtol |x|, unless `control` is
    "steps"; status "not_converged" where neither method meets that.
    """
    begun = _begin(motion)
    frequency = find_fastest(begun)
    steps, noise = motion.t_end * (0.75 * frequency + 0.2 * find_decay(begun)), _find_noise(begun, frequency)
    names = ("scipy_radau", "scipy_dop853") if steps > MANY_STEPS else ("scipy_dop853", "scipy_radau")
    why, found = _explain(names[0], steps), _run(motion, options, names[0], noise)
    if found.status != "ok":
        other = _run(motion, options, names[1], noise)
        if other.status == "ok":
            why, found = f"{why}; {names[0]} missed the tolerance, so {names[1]}", other
    return replace(found, method=f"auto ({found.method})", why=why)


def integrate_scipy_to_samples(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return a run of the SciPy method of the options, its estimated error within the tolerance.

    As integrate_explicit_to_samples; steps pass over the kinks where cables go slack and taut. Raises as
    integrate_scipy.
    """
    structure, manifest = motion.model.structure, motion.model.manifest
    begun = _begin(motion)
    find_frequency = cache(partial(find_fastest, begun))
    tolerance = tolerance_of_options(manifest, options)
    has_kinks = structure is None or bool(np.any(structure.tension_only | structure.has_switch))
    like = "rk853" if options.method == "scipy_dop853" else "rk54"
    lost = LostVibration(motion, options, find_frequency, integrate_scipy, like)
    checks = Checks(
        least_atol=_find_noise(begun, find_frequency()),
        least_rtol=SMALLEST_SCIPY_RTOL,
        trust=PASSING_KINKS if has_kinks else 0.0,
        rounding=Rounding(find_frequency, manifest.is_centre),
        lost=partial(lost.estimate, tolerance=tolerance),
    )

    def run(rtol: float, atol: float) -> RawTrajectory:
        return integrate_scipy(motion, options.within(max(rtol, SMALLEST_SCIPY_RTOL), atol))

    return tighten_until_converged(run, tolerance, checks)


def _begin(motion: Motion) -> Motion:
    """Return the motion with the arguments that it has at the start."""
    changed = motion.schedule(0.0) if motion.schedule else {}
    return replace(motion, arguments={**motion.arguments, **changed})


def _find_noise(motion: Motion, frequency: float) -> float:
    is_centre = motion.model.manifest.is_centre
    return find_noise(motion.state[: len(is_centre)][~is_centre], frequency)


def _explain(name: str, steps: float) -> str:
    if name == "scipy_radau":
        return f"{WHY}: scipy_radau, since an explicit method needs about {steps:,.0f} steps"
    return f"{WHY}: scipy_dop853" + (f", for about {steps:,.0f} steps" if steps >= 1 else "")


def _run(motion: Motion, options: RunOptions, name: str, noise: float) -> RawTrajectory:
    """Return the run of one method, checked unless the error of its steps is all that is asked for."""
    if options.control == "steps":
        return integrate_scipy(motion, replace(options, method=name, atol=max(options.absolute, noise)))
    return integrate_scipy_to_samples(motion, replace(options, method=name))
