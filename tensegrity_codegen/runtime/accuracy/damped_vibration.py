"""Vibrations of stiff members that implicit steps damp out: part of the estimated error, and told in words.

A motion has them from the start, and gets more where the force of a damped cable jumps as it goes taut, and
at kinks of a profile, where forces or their rates jump.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.accuracy.error_control import (
    MIN_COUNTED_WITH_KINKS,
    TOO_MANY_EVENTS,
    Checks,
    Rounding,
    tighten_until_converged,
)
from tensegrity_codegen.runtime.accuracy.rates import find_rates
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.accuracy.vibration import find_end_coordinates, find_vibration
from tensegrity_codegen.runtime.integrate.event_log import Watch, choose_watch
from tensegrity_codegen.runtime.integrate.implicit import integrate_implicit
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR
from tensegrity_codegen.tables.manifest import JUMP_KINDS

# What the evidence of a run says of them [m], [m/s], [N].
VIBRATION_ERRORS = ("vibration_error", "vibration_speed_error", "vibration_tension_error")
KINK_SAFETY = 2.0  # times what a member on two free masses does: others at its ends change it a little
LONGEST_TO_MEAN_STEP = 3.0  # over the mean one
RESOLVED_ANGLE = 0.5  # rad of a vibration in one step, up to which the implicit method follows it
# Measured over random motions; and the phase of the fastest slow motion within which the rest answers.
PULL, SLOW_ANGLE = 0.15, 10.0
RATE_SPAN = 1e-3  # of a piece, over which the rate of a force is taken


def integrate_implicit_to_samples(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate implicitly, steps tightened until the estimated error of every sample is within tolerance.

    Vibrations that it damps out count in the error of positions: where they are too large for them, the steps
    are tightened until they resolve them. For velocities they are told, as `auto` does. Where cables go slack
    and taut without end, as overdamped ones do, and nobody asked to watch them, steps pass over that. Raises
    as integrate_implicit.
    """
    found = _tighten(motion, options)
    return (
        _tighten(replace(motion, watch=Watch()), options)
        if has_too_many_unwatched_events(motion, found)
        else found
    )


def has_too_many_unwatched_events(motion: Motion, found: RawTrajectory) -> bool:
    """Return whether a run ended by too many events, which were not requested."""
    return found.status == TOO_MANY_EVENTS and motion.watch is None


def _tighten(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return implicit runs, tightened until their error at the samples is within the tolerance."""
    model, state = motion.model, motion.state
    size = float(np.abs(state[: len(state) // 2]).max(initial=0.0))
    stiff, min_counted = find_integrator(model.manifest, STIFF_INTEGRATOR).tensions, find_min_counted(motion)
    tolerance = tolerance_of_options(model.manifest, options)
    if not stiff:  # nothing that vibrates by itself
        return tighten_until_converged(
            lambda rtol, atol: integrate_implicit(motion, options.within(rtol, atol)),
            tolerance,
            Checks(min_counted=min_counted, is_open=options.is_open),
        )
    rates = find_rates(model, stiff, motion.arguments)
    assert rates is not None  # a library with the implicit method has what it takes
    with np.errstate(all="ignore"):  # members without a length have no direction
        vibration = find_vibration(motion, stiff, rates)

    def run(rtol: float, atol: float) -> RawTrajectory:
        raw = integrate_implicit(motion, options.within(rtol, atol))
        return add_vibration_errors(
            motion,
            raw,
            vibration.damped_out(atol + rtol * size),
            stiff,
            rates.frequency,
            counts_turns=options.is_open,
        )

    rounding = Rounding(lambda: rates.frequency, model.manifest.is_centre)
    checks = Checks(
        vibration=read_vibration_errors,
        min_counted=min_counted,
        resolves_vibration=True,
        rounding=rounding,
        is_open=options.is_open,
    )
    return report_vibration(tighten_until_converged(run, tolerance, checks), options)


def find_min_counted(motion: Motion, method: str = STIFF_INTEGRATOR) -> float:
    """Return the part of the difference of two runs that counts at least: where cables are not watched."""
    spec = find_integrator(motion.model.manifest, method)
    watched = choose_watch(spec, motion.model.manifest, motion.watch).kinds
    unwatched = (set(JUMP_KINDS) & set(spec.events)) - set(watched)
    return MIN_COUNTED_WITH_KINKS if spec.unwatched or (spec.cables and unwatched) else 0.0


# --- what a run says of vibrations -------------------------------------------------------------------


def add_vibration_errors(
    motion: Motion,
    raw: RawTrajectory,
    error: FloatArray,
    stiff: tuple[int, ...],
    frequency: float,
    *,
    counts_turns: bool = False,
) -> RawTrajectory:
    """Return the run with bounds of the errors of positions, velocities and tensions in its evidence.

    error (3,): by the vibrations of the start, to which those that jumps and kinks excite are added;
    stiff: the members that vibrate; frequency [rad/s]: the fastest of their vibrations; counts_turns: whether
    those count that cables without damping excite as they go slack and taut, and what vibrations pull.
    """
    error = error + _bound_jumps(motion, raw, stiff, frequency) + _bound_kinks(motion, raw, stiff)
    if counts_turns:
        error = error + _bound_turns(motion, raw, stiff, frequency) + _bound_pull(motion, raw, stiff)
    evidence = dict(zip(VIBRATION_ERRORS, map(float, error), strict=True))
    return replace(raw, evidence={**raw.evidence, **evidence})


def read_vibration_errors(raw: RawTrajectory) -> FloatArray:
    """Return how far positions [m] and velocities [m/s] may be off by vibrations of stiff members, (2,)."""
    return np.array([raw.evidence.get(name, 0.0) for name in VIBRATION_ERRORS[:2]])


def report_vibration(raw: RawTrajectory, options: RunOptions) -> RawTrajectory:
    """Return the run; its message reports velocities and tensions that miss the tolerance."""
    n = raw.state.shape[1] // 2
    _, speed, pull = (raw.evidence.get(name, 0.0) for name in VIBRATION_ERRORS)
    speed -= raw.evidence.get("rounding_speed_error", 0.0)  # no method resolves that
    allowed = options.absolute + options.rtol * float(np.abs(raw.state[:, n:]).max(initial=0.0))
    pulled = 0.0 if raw.tension is None else options.rtol * float(np.abs(raw.tension).max(initial=0.0))
    is_within = not (speed > allowed or pull > pulled)
    if is_within:
        return raw
    message = (
        f"{raw.message}; bar velocities may be wrong by up to {speed:.2g} m/s, bar tensions by up to "
        f'{pull:.2g} N: method "rk853" resolves them'
    )
    return replace(raw, message=message)


# --- vibrations that damped cables excite ------------------------------------------------------------


def _bound_jumps(motion: Motion, raw: RawTrajectory, stiff: tuple[int, ...], frequency: float) -> FloatArray:
    """Return bounds of amplitudes [m], speeds [m/s], tensions [N]: sums of c |l'| at a member, over its mu.

    Of the cables that the run pulls taut, and those whose events it does not watch; |l'| is the largest at
    any sample. Vibrations that the steps resolve do not count.
    """
    model = motion.model
    law = np.asarray(model.compute("member_law", **motion.arguments))
    mu, c = law[:, 1], law[:, 2] * _may_go_taut(motion, raw)
    c[list(stiff)] = 0.0
    is_resolved = frequency * LONGEST_TO_MEAN_STEP * float(raw.time[-1]) < RESOLVED_ANGLE * raw.n_steps
    if not c.any() or is_resolved:
        return np.zeros(3)
    # The force that may jump at each node, and at both ends of each elastic member.
    ends = np.array(model.manifest.connectivity, dtype=np.int64)
    force = np.zeros(len(model.manifest.node_name))
    strands = model.manifest.strands
    jump = strands.spread(c * _find_largest_rate(model, raw, motion.arguments))
    for end in (0, 1):
        np.add.at(force, strands.ends[:, end], jump)
    chosen = np.array([e for e in stiff if mu[e] > 0], dtype=np.int64)
    pull = force[ends[chosen, 0]] + force[ends[chosen, 1]]
    largest = float((pull / mu[chosen]).max(initial=0.0))
    return np.array([largest, largest * frequency, float(pull.max(initial=0.0))])


def _bound_turns(motion: Motion, raw: RawTrajectory, stiff: tuple[int, ...], frequency: float) -> FloatArray:
    """Return bounds [m], [m/s], [N] of the vibrations that cables excite by a kink of their force, all turns.

    A rate of force that jumps by k l' makes a member vibrate by k l' / (mu omega).
    """
    turns, n = raw.log.count, raw.state.shape[1] // 2
    if not turns:
        return np.zeros(3)
    mu = np.asarray(motion.model.compute("member_law", **motion.arguments))[:, 1]
    is_stiff = np.isin(np.arange(len(mu)), stiff) & (mu > 0.0)
    softest, stiffest = float(mu[is_stiff].min(initial=np.inf)), float(mu[is_stiff].max(initial=0.0))
    speed = 2.0 * float(np.abs(raw.state[:, n:]).max(initial=0.0))
    rate = float(mu[~is_stiff].max(initial=0.0)) * speed
    far = turns * rate / (softest * frequency * np.sqrt(softest / stiffest)) if stiffest > 0.0 else 0.0
    return np.array([far, far * frequency, far * softest])


def _bound_pull(motion: Motion, raw: RawTrajectory, stiff: tuple[int, ...]) -> FloatArray:
    """Return bounds [m], [m/s], [N] of what the vibration of the start makes of the smooth motion.

    A member that vibrates across itself pulls its ends together, on the mean by PULL v^2 / l of acceleration.
    """
    speed, n = raw.evidence.get("vibration_speed", 0.0), len(motion.state) // 2
    rates = find_rates(motion.model, stiff, motion.arguments)
    if rates is None or not speed > 0.0:
        return np.zeros(3)
    anchors = motion.arguments.get("anchor_position")
    place = place_nodes(motion.model, motion.state[:n], anchors, arguments=motion.arguments)
    length = float(motion.model.manifest.strands.lengths(place)[list(stiff)].min(initial=np.inf))
    pull, time = PULL * speed**2 / length, min(motion.t_end, SLOW_ANGLE / max(rates.slow_frequency, 1e-300))
    return np.array([0.5 * pull * time**2, pull * time, 0.0])


def _may_go_taut(motion: Motion, raw: RawTrajectory) -> NDArray[np.bool_]:
    """Return which members go taut in a run, or may have done so unseen, (n_members,)."""
    manifest = motion.model.manifest
    spec = find_integrator(manifest, STIFF_INTEGRATOR)
    if "cable" not in choose_watch(spec, manifest, motion.watch).kinds or raw.log.count > len(raw.log.time):
        return np.ones(len(manifest.member_name), dtype=np.bool_)
    taut = {name for name, direction in zip(raw.log.name, raw.log.direction, strict=True) if direction > 0}
    watched = {manifest.member_name[member] for member in spec.cables}
    return np.array([name in taut or name not in watched for name in manifest.member_name])


def _find_largest_rate(model: CompiledModel, raw: RawTrajectory, arguments: Mapping[str, Any]) -> FloatArray:
    """Return the largest rate of each member's length at any sample, (n_members,) [m/s]."""
    strands = model.manifest.strands
    n, largest = raw.state.shape[1] // 2, np.zeros(strands.n_members)
    anchors = arguments.get("anchor_position")
    for state in raw.state:
        position = place_nodes(model, state[:n], anchors, arguments=arguments)
        velocity = place_velocities(model, state[:n], state[n:], arguments=arguments)
        vector, moving = strands.vectors(position), strands.vectors(velocity)
        length = np.maximum(np.linalg.norm(vector, axis=1), 1e-300)
        largest = np.maximum(largest, np.abs(strands.add_up(np.sum(vector * moving, axis=1) / length)))
    return largest


# --- vibrations that kinks of a profile excite -------------------------------------------------------


def _bound_kinks(motion: Motion, raw: RawTrajectory, stiff: tuple[int, ...]) -> FloatArray:
    """Return bounds of amplitudes [m], speeds [m/s], tensions [N] of the vibrations that a run leaves out.

    A jump F of the force at the ends of a member of stiffness mu and frequency w makes it vibrate by F / mu,
    a jump F' of its rate by F' / (mu w); all kinks add up. Members whose vibration the steps resolve do not
    count.
    """
    schedule, model = motion.schedule, motion.model
    if not isinstance(schedule, DrivenArguments) or not schedule.pieces.is_kink.any() or len(raw.time) < 2:
        return np.zeros(3)
    # The elastic ones of the stiff members: stiffness [N/m], frequency [rad/s], coordinates of both ends.
    law = np.asarray(model.compute("member_law", **motion.arguments))
    members = np.array([member for member in stiff if law[member, 1] > 0.0], dtype=np.int64)
    if not len(members):
        return np.zeros(3)
    mu, ends = law[members, 1], find_end_coordinates(model, members)
    mass = model.compute("mass_matrix", **motion.arguments).diagonal()
    least = np.where(ends >= 0, 1.0 / mass[ends], np.inf).min(axis=2)
    omega = np.sqrt(mu * np.where(np.isfinite(least), least, 0.0).sum(axis=1))
    # What all kinks together make of them, and which of that the steps resolve.
    amplitude = np.zeros(len(mu))
    for kink in np.flatnonzero(schedule.pieces.is_kink):
        force, rate = _find_jumps(motion, raw, schedule, int(kink))
        amplitude += (_pull(force, ends) + _pull(rate, ends) / omega) / mu
    step = LONGEST_TO_MEAN_STEP * float(raw.time[-1]) / max(raw.n_steps, 1)
    amplitude = np.where(omega * step < RESOLVED_ANGLE, 0.0, KINK_SAFETY * amplitude)
    return np.array([amplitude.max(), (amplitude * omega).max(), (amplitude * mu).max()])


def _find_jumps(
    motion: Motion, raw: RawTrajectory, schedule: DrivenArguments, kink: int
) -> tuple[FloatArray, FloatArray]:
    """Return by how much forces [N] and their rates [N/s] jump at a kink, at the sample before it."""
    pieces, n = schedule.pieces, raw.state.shape[1] // 2
    time = float(pieces.time[kink])
    state = raw.state[max(int(np.searchsorted(raw.time, time, side="right")) - 1, 0)]
    span = RATE_SPAN * float(min(pieces.time[kink] - pieces.time[kink - 1], pieces.time[kink + 1] - time))

    def force(piece: int, later: float) -> FloatArray:
        values = pieces.polynomial(piece, time + later - float(pieces.time[piece]))
        given = {**motion.arguments, **schedule.put(values)}
        return np.asarray(
            motion.model.compute("cable_force", coordinate=state[:n], velocity=state[n:], **given)
        )

    before, after = force(kink - 1, 0.0), force(kink, 0.0)
    rate = (force(kink, span) - after) / span - (before - force(kink - 1, -span)) / span
    return np.abs(after - before), np.abs(rate)


def _pull(force: FloatArray, ends: NDArray[np.int64]) -> FloatArray:
    """Return the sum of the forces at both ends of each member."""
    parts = np.where(ends >= 0, force[ends], 0.0)
    return np.asarray(np.linalg.norm(parts, axis=2).sum(axis=1))
