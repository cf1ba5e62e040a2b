"""The method `auto`: one of the others, by model and tolerance, tightened until its error holds."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.choice import Choice, choose_method
from tensegrity_codegen.runtime.accuracy.damped_out import (
    find_left_out,
    is_crowded,
    note_left_out,
    tell_left_out,
    trust_in_radau,
)
from tensegrity_codegen.runtime.accuracy.error_control import Checks, tighten_until_converged
from tensegrity_codegen.runtime.accuracy.explicit import integrate_explicit_to_samples
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.accuracy.scheduled import integrate_scheduled
from tensegrity_codegen.runtime.accuracy.vibrations.jumps import bound_jumps
from tensegrity_codegen.runtime.accuracy.vibrations.kinks import bound_kinks
from tensegrity_codegen.runtime.accuracy.vibrations.vibration import Vibration
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.radau import integrate_radau
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.knots import follows_in_c
from tensegrity_codegen.tables.formulations import find_formulation

FAR = 1e5  # from the origin, over the size of the structure


def integrate_auto(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion by what choose_method says.

    The estimated error of positions is within atol + rtol |x| at every sample, component by component;
    that of velocities too, but where radau runs: to its smooth motion vibrations of stiff members are added
    in closed form, and `evidence` says how far off these may be, vibration_error [m] and
    vibration_speed_error [m/s]; the message does so where the latter is more than the tolerance. Where radau
    misses the tolerance the explicit method has its turn. SciPy's methods run with a schedule that the
    library does not follow in C. Status
    "not_converged" where none meets it. Raises FormulationError where the library has no method with error
    control, and what the methods raise.
    """
    if motion.schedule is not None and not follows_in_c(motion.schedule, motion.model.manifest):
        return integrate_scheduled(motion, options)
    choice = choose_method(motion, options)
    if options.control == "steps":
        return replace(_run_once(motion, options, choice), why=choice.why)
    if choice.name != "radau":
        found = _run_explicit(motion, replace(options, method=choice.name))
        return _advise(replace(found, why=choice.why), motion.model)
    found = _run_radau(motion, options, choice)
    if is_crowded(motion, found):
        found = _run_radau(replace(motion, watch=Watch()), options, choice)
    if found.status == "ok" and (found.error_estimate or 0.0) <= 1.0:
        return tell_left_out(replace(found, why=choice.why), options)
    if choice.otherwise:
        most = min(options.max_steps, choice.most_otherwise)
        other = _run_explicit(motion, replace(options, method=choice.otherwise, max_steps=most))
        if other.status == "ok":
            return replace(other, why=f"{choice.why}; radau missed the tolerance, so {choice.otherwise}")
    return _advise(tell_left_out(replace(found, why=choice.why), options), motion.model)


def _run_once(motion: Motion, options: RunOptions, choice: Choice) -> RawTrajectory:
    """Return one run of the chosen method, its steps' errors alone within the tolerance."""
    if choice.name == "radau":
        return _by_auto(_prepare_radau(motion, options, choice)(options.rtol, options.absolute))
    options = replace(options, method=choice.name, atol=max(options.absolute, choice.noise))
    return _by_auto(integrate_adaptive(motion, options))


def _run_explicit(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return a run of the explicit method of the options, its error within the tolerance."""
    return _by_auto(integrate_explicit_to_samples(motion, options))


def _run_radau(motion: Motion, options: RunOptions, choice: Choice) -> RawTrajectory:
    """Return a run of radau, its error within the tolerance."""
    run = _prepare_radau(motion, options, choice)
    checks = Checks(left_out=find_left_out, trust=trust_in_radau(motion))
    tolerance = tolerance_of_options(motion.model.manifest, options)
    return _by_auto(tighten_until_converged(run, tolerance, checks))


def _prepare_radau(
    motion: Motion, options: RunOptions, choice: Choice
) -> Callable[[float, float], RawTrajectory]:
    """Return (rtol, atol) -> run of radau from the smooth state, with the vibrations about it added."""
    options = replace(options, max_steps=min(options.max_steps, choice.most_steps))
    vibration = choice.vibration
    smooth = motion if vibration is None else replace(motion, state=vibration.smooth(motion.state))

    def run(rtol: float, atol: float) -> RawTrajectory:
        raw = integrate_radau(smooth, options.within(rtol, atol), quiet=choice.quiet)
        return raw if vibration is None else _with_vibration(raw, motion, vibration, choice.frequency)

    return run


def _by_auto(raw: RawTrajectory) -> RawTrajectory:
    """Return the run with the word that its method was chosen."""
    return replace(raw, method=f"auto ({raw.method})")


def _advise(raw: RawTrajectory, model: CompiledModel) -> RawTrajectory:
    """Return the run with the cure where it fails since coordinates are huge beside the structure."""
    place = model.manifest.stated_position
    size = float(np.ptp(place, axis=0).max(initial=0.0))
    far = float(np.abs(place).max(initial=0.0))
    in_nodes = find_formulation(model.manifest.formulation).in_nodes
    if raw.status != "not_converged" or not in_nodes or far <= FAR * size:
        return raw
    message = (
        f"{raw.message}; positions of {far:.2g} m have rounding errors of {far * 1.1e-16:.2g} m: "
        "move the structure to the origin, or use formulation node_distance"
    )
    return replace(raw, message=message)


def _with_vibration(
    raw: RawTrajectory, motion: Motion, vibration: Vibration, frequency: float
) -> RawTrajectory:
    """Return a run of radau with the vibrations that it leaves out, and with how far off these may be."""
    off = vibration.error(float(motion.sample_time[1]), motion.t_end)
    jumps = bound_jumps(motion, raw, raw.tension_member, frequency)
    kinks = bound_kinks(motion, raw, raw.tension_member)
    return note_left_out(vibration.add_to(raw, motion.state), off + jumps + kinks)
