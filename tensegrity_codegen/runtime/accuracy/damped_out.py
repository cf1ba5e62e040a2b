"""Vibrations of stiff members that radau damps out: counted in the estimated error, and told in words."""

from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.error_control import CROWDED, Checks, tighten_until_converged
from tensegrity_codegen.runtime.accuracy.rounding import Rounding
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.accuracy.vibrations.jumps import bound_jumps
from tensegrity_codegen.runtime.accuracy.vibrations.kinks import bound_kinks
from tensegrity_codegen.runtime.accuracy.vibrations.rates import find_rates
from tensegrity_codegen.runtime.accuracy.vibrations.vibration import find_vibration
from tensegrity_codegen.runtime.integrate.event_log import Watch, choose_watch
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.radau import integrate_radau
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import JUMP_KINDS

LEFT_OUT = ("vibration_error", "vibration_speed_error", "vibration_tension_error")  # [m], [m/s], [N]
PASSING_KINKS = 0.7  # of the difference of two runs counts where steps do not end at kinks


def integrate_radau_to_samples(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate by radau, its steps tightened until the estimated error of every sample is within tolerance.

    Vibrations that it damps out count in the error of positions: where they are too large for them, the steps
    are tightened until they resolve them. For velocities they are told, as `auto` does. Where cables go slack
    and taut without end, as overdamped ones do, and nobody asked to watch them, steps pass over that. Raises
    as integrate_radau.
    """
    found = _tighten(motion, options)
    return _tighten(replace(motion, watch=Watch()), options) if is_crowded(motion, found) else found


def is_crowded(motion: Motion, found: RawTrajectory) -> bool:
    """Whether events that nobody asked for have held a run up."""
    return found.status == CROWDED and motion.watch is None


def _tighten(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return runs of radau, tightened until their error at the samples is within the tolerance."""
    model, state = motion.model, motion.state
    size = float(np.abs(state[: len(state) // 2]).max(initial=0.0))
    stiff, trust = find_integrator(model.manifest, "radau").tensions, trust_in_radau(motion)
    tolerance = tolerance_of_options(model.manifest, options)
    if not stiff:  # nothing that vibrates by itself
        return tighten_until_converged(
            lambda rtol, atol: integrate_radau(motion, options.within(rtol, atol)),
            tolerance,
            Checks(trust=trust),
        )
    rates = find_rates(model, stiff, motion.arguments)
    assert rates is not None  # a library with radau has what it takes
    with np.errstate(all="ignore"):  # members without a length have no direction
        vibration = find_vibration(model, state, stiff, rates, motion.arguments)

    def run(rtol: float, atol: float) -> RawTrajectory:
        raw = integrate_radau(motion, options.within(rtol, atol))
        jumps = bound_jumps(motion, raw, stiff, rates.frequency)
        kinks = bound_kinks(motion, raw, stiff)
        return note_left_out(raw, vibration.damped_out(atol + rtol * size) + jumps + kinks)

    rounding = Rounding(lambda: rates.frequency, model.manifest.is_centre)
    checks = Checks(left_out=find_left_out, trust=trust, resolves_left_out=True, rounding=rounding)
    return tell_left_out(tighten_until_converged(run, tolerance, checks), options)


def trust_in_radau(motion: Motion) -> float:
    """Return the part of the difference of two runs that counts at least: where cables are not watched."""
    spec = find_integrator(motion.model.manifest, "radau")
    watched = choose_watch(spec, motion.model.manifest, motion.watch).kinds
    unwatched = (set(JUMP_KINDS) & set(spec.events)) - set(watched)
    return PASSING_KINKS if spec.unwatched or (spec.cables and unwatched) else 0.0


def note_left_out(raw: RawTrajectory, off: FloatArray) -> RawTrajectory:
    """Return the run with the word how far positions, velocities and tensions are off at most, (3,)."""
    return replace(raw, evidence={**raw.evidence, **dict(zip(LEFT_OUT, map(float, off), strict=True))})


def find_left_out(raw: RawTrajectory) -> FloatArray:
    """Return how far positions [m] and velocities [m/s] may be off by vibrations of stiff members, (2,)."""
    return np.array([raw.evidence.get(name, 0.0) for name in LEFT_OUT[:2]])


def tell_left_out(raw: RawTrajectory, options: RunOptions) -> RawTrajectory:
    """Return the run with a word on velocities and tensions that miss the tolerance; positions must not."""
    n = raw.state.shape[1] // 2
    _, speed, pull = (raw.evidence.get(name, 0.0) for name in LEFT_OUT)
    speed -= raw.evidence.get("rounding_speed_error", 0.0)  # no method resolves that
    allowed = options.absolute + options.rtol * float(np.abs(raw.state[:, n:]).max(initial=0.0))
    pulled = 0.0 if raw.tension is None else options.rtol * float(np.abs(raw.tension).max(initial=0.0))
    message = raw.message
    if speed > allowed or pull > pulled:
        message += (
            f"; bar velocities may be wrong by up to {speed:.2g} m/s, bar tensions by up to {pull:.2g} N: "
            'method "rk853" resolves them'
        )
    return replace(raw, message=message)
