"""The method `auto`: one of the others, by model and tolerance, tightened until its error holds."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.choice import Choice, choose_method
from tensegrity_codegen.runtime.accuracy.damped_vibration import (
    find_min_counted,
    is_held_up,
    note_vibration,
    read_vibration,
    tell_vibration,
)
from tensegrity_codegen.runtime.accuracy.error_control import Checks, tighten_until_converged
from tensegrity_codegen.runtime.accuracy.explicit import integrate_explicit_to_samples, integrate_scheduled
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.implicit import integrate_implicit
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import follows_in_c
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

MAX_DISTANCE = 1e5  # from the origin, over the size of the structure


def integrate_auto(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion by what choose_method says.

    The estimated error of positions is within atol + rtol |x| at every sample, component by component;
    that of velocities too, but where the implicit method runs: vibrations of stiff members are added to its
    smooth motion in closed form, and `evidence` says how far off these may be, vibration_error [m] and
    vibration_speed_error [m/s]; the message does so where the latter is more than the tolerance. Where it
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
    if choice.name != STIFF_INTEGRATOR:
        found = _by_auto(integrate_explicit_to_samples(motion, replace(options, method=choice.name)))
        return _advise(replace(found, why=choice.why), motion.model)
    found = _run_implicit(motion, options, choice)
    if is_held_up(motion, found):
        found = _run_implicit(replace(motion, watch=Watch()), options, choice)
    if found.status == "ok" and (found.error_estimate or 0.0) <= 1.0:
        return tell_vibration(replace(found, why=choice.why), options)
    if choice.otherwise:
        most = min(options.max_steps, choice.most_otherwise)
        options_of_other = replace(options, method=choice.otherwise, max_steps=most)
        other = _by_auto(integrate_explicit_to_samples(motion, options_of_other))
        if other.status == "ok":
            return replace(
                other, why=f"{choice.why}; {STIFF_INTEGRATOR} missed the tolerance, so {choice.otherwise}"
            )
    return _advise(tell_vibration(replace(found, why=choice.why), options), motion.model)


def _run_once(motion: Motion, options: RunOptions, choice: Choice) -> RawTrajectory:
    """Return one run of the chosen method, its steps' errors alone within the tolerance."""
    if choice.name == STIFF_INTEGRATOR:
        return _by_auto(_prepare_implicit(motion, options, choice)(options.rtol, options.absolute))
    options = replace(options, method=choice.name, atol=max(options.absolute, choice.noise))
    return _by_auto(integrate_adaptive(motion, options))


def _run_implicit(motion: Motion, options: RunOptions, choice: Choice) -> RawTrajectory:
    """Return an implicit run, its error within the tolerance."""
    run = _prepare_implicit(motion, options, choice)
    checks = Checks(vibration=read_vibration, min_counted=find_min_counted(motion))
    tolerance = tolerance_of_options(motion.model.manifest, options)
    return _by_auto(tighten_until_converged(run, tolerance, checks))


def _prepare_implicit(
    motion: Motion, options: RunOptions, choice: Choice
) -> Callable[[float, float], RawTrajectory]:
    """Return (rtol, atol) -> implicit run from the smooth state, with the vibrations about it added."""
    options = replace(options, max_steps=min(options.max_steps, choice.most_steps))
    vibration = choice.vibration
    smooth = motion if vibration is None else replace(motion, state=vibration.smooth(motion.state))

    def run(rtol: float, atol: float) -> RawTrajectory:
        raw = integrate_implicit(smooth, options.within(rtol, atol), quiet=choice.quiet)
        if vibration is None:
            return raw
        error = vibration.error(float(motion.sample_time[1]), motion.t_end)
        noted = note_vibration(motion, raw, error, raw.tension_member, choice.frequency)
        return vibration.add_to(noted, motion.state)

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
    if raw.status != "not_converged" or not in_nodes or far <= MAX_DISTANCE * size:
        return raw
    message = (
        f"{raw.message}; positions of {far:.2g} m have rounding errors of {far * 1.1e-16:.2g} m: "
        "move the structure to the origin, or use formulation node_distance"
    )
    return replace(raw, message=message)
