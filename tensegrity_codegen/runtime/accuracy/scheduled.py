"""The method `auto` where a schedule changes arguments with time: SciPy's methods, their error checked."""

from __future__ import annotations

from dataclasses import replace

from tensegrity_codegen.runtime.accuracy.error_control import Checks, tighten_until_converged
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.accuracy.vibrations.fastest import find_decay, find_fastest, find_noise
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import SMALLEST_SCIPY_RTOL, RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.integrate.scipy_methods import integrate_scipy

__all__ = ["integrate_scheduled"]

WHY = "methods in C take values over time from a Profile of inputs only, so this schedule runs through SciPy"
MANY_STEPS = 20_000  # of an explicit method, from which on SciPy's implicit one has its turn first


def integrate_scheduled(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion with a schedule by SciPy's DOP853 or Radau, whichever meets the tolerance.

    Radau has its turn first where the fastest vibration or damping would take the explicit method more than
    MANY_STEPS steps. The estimated error at the samples is within atol + rtol |x|, unless `control` is
    "steps"; status "not_converged" where neither method meets that.
    """
    steps, noise = _find_steps(motion)
    names = ("scipy_radau", "scipy_dop853") if steps > MANY_STEPS else ("scipy_dop853", "scipy_radau")
    why, found = _explain(names[0], steps), _run(motion, options, names[0], noise)
    if found.status != "ok":
        other = _run(motion, options, names[1], noise)
        if other.status == "ok":
            why, found = f"{why}; {names[0]} missed the tolerance, so {names[1]}", other
    return replace(found, method=f"auto ({found.method})", why=why)


def _find_steps(motion: Motion) -> tuple[float, float]:
    """Return about how many explicit steps the motion takes, and the rounding of velocities [m/s]."""
    given = {**motion.arguments, **(motion.schedule(0.0) if motion.schedule else {})}
    begun = replace(motion, arguments=given)
    frequency = find_fastest(begun)
    steps = motion.t_end * (0.75 * frequency + 0.2 * find_decay(begun))
    return steps, find_noise(motion.state[: len(motion.state) // 2], frequency)


def _explain(name: str, steps: float) -> str:
    if name == "scipy_radau":
        return f"{WHY}: scipy_radau, since an explicit method needs about {steps:,.0f} steps"
    return f"{WHY}: scipy_dop853" + (f", for about {steps:,.0f} steps" if steps >= 1 else "")


def _run(motion: Motion, options: RunOptions, name: str, noise: float) -> RawTrajectory:
    """Return one method's run, tightened until its error is within the tolerance."""

    def run(rtol: float, atol: float) -> RawTrajectory:
        least = max(rtol, SMALLEST_SCIPY_RTOL)
        raw = integrate_scipy(motion, replace(options, method=name, rtol=least, atol=atol))
        if raw.status != "ok" or rtol == least:
            return raw
        why = f"the smallest relative tolerance of SciPy is {least:.2g}"
        return replace(raw, status="not_converged", message=why)

    if options.control == "steps":
        return run(options.rtol, max(options.absolute, noise))
    tolerance = tolerance_of_options(motion.model.manifest, options)
    return tighten_until_converged(run, tolerance, Checks(least_atol=noise))
