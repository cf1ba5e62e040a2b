"""Stiff bars taken as rigid by the method `auto`, their lengths following their tensions to first order.

What that leaves out, and how large it is: the vibration of the bars, s'' + omega^2 s = 0 about the stretch
that their tension asks for, from the start on; what jumps of forces, or of their rates where cables go slack
and taut, excite on the way; and the next order of the stretch, which `rigidity_error` states and which shifts
the phases of the motion with time.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.damped_vibration import (
    add_vibration_errors,
    read_vibration_errors,
    report_vibration,
)
from tensegrity_codegen.runtime.accuracy.explicit import LeftOut, integrate_explicit_to_samples
from tensegrity_codegen.runtime.accuracy.rates import Rates, find_rates
from tensegrity_codegen.runtime.accuracy.vibration import (
    AMPLITUDE_SAFETY,
    TENSION_COMPLIANCE,
    find_end_coordinates,
    find_vectors,
)
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.consistent import make_consistent
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

METHOD = "rk853"
MAX_SHARE = 0.3  # of the tolerance of positions, that rigid bars may take
MIN_STEPS = 100.0  # radians of the fastest vibration: a shorter motion is as cheap with elastic bars
# Times what the stretch leaves out: of bars alone, of bars that share nodes, where cables go slack or taut;
# and how fast it grows, over the bound of the slow frequencies. Measured over 500 random motions.
LAG_SAFETY, JOINED_SAFETY, EVENT_SAFETY, LAG_GROWTH = 3.0, 10.0, 25.0, 0.1
LEAST_LAG = 1e-3  # of (slow / fast)^2 of the stretch, that is left out at least
TENSION_SAFETY = 3.0  # times what the next order of the stretch makes of tensions
# Measured over 228 random motions: after many events the error was up to 250 times what is bounded here.
MAX_EVENTS = 50
MAX_ENERGY_SHARE = 0.03  # of the largest kinetic energy, that is in the vibration at the start


def integrate_with_rigid_bars(motion: Motion, options: RunOptions) -> RawTrajectory | None:
    """Return the motion by the model with rigid bars, None where it cannot do, or would not pay.

    `vibration_error` and `vibration_speed_error` in its evidence, errors of positions [m] and velocities
    [m/s] by the model, count in the estimated error; `vibration_tension_error` [N] is that of tensions.
    """
    model = motion.model
    if (
        model.build_twin is None
        or options.keep
        or options.control != "samples"
        or motion.schedule is not None
    ):
        return None
    if all(spec.name != STIFF_INTEGRATOR for spec in model.manifest.integrators):
        return None
    stiff = find_integrator(model.manifest, STIFF_INTEGRATOR).tensions
    rates = find_rates(model, stiff, motion.arguments)
    if rates is None or not stiff or rates.frequency * motion.t_end < MIN_STEPS:
        return None
    # The vibration at the start, and whether there is a model without it that watches the same events.
    size = float(np.abs(motion.state[: len(motion.state) // 2]).max(initial=0.0))
    allowed = MAX_SHARE * (options.absolute + options.rtol * size)
    speed = options.atol_speed or options.absolute  # allowed, by a guess of the largest speed, see scales.py
    vibration = _bound_vibration(motion, stiff, rates)
    if not (vibration[0] <= allowed and vibration[1] <= speed):
        return None
    least = vibration + _bound_least_drift(motion, stiff, rates)
    if not (least[0] <= allowed and least[1] <= speed):
        return None
    if model.rigid_twin is None:
        return None
    watched = set(motion.watch.kinds) if motion.watch else set()
    if any(not watched <= set(spec.events) for spec in model.rigid_twin.manifest.integrators):
        return None

    # What is left out along the motion counts in the estimated error.
    def add_errors(run: RawTrajectory) -> RawTrajectory:
        error = vibration + _bound_drift(motion, run, rates)
        return add_vibration_errors(motion, run, error, stiff, rates.frequency, counts_turns=True)

    found = _run(motion, options, rates, add_errors)
    if found is None:
        return None
    ratio = f"bars are {float(f'{rates.stiffness_ratio:.2g}'):,.0f} times stiffer than cables"
    why = f"{ratio} and vibrate by {vibration[0]:.2g} m, less than the tolerance: rigid bars, corrected"
    return report_vibration(replace(found, method=f"auto ({found.method}, rigid bars)", why=why), options)


def _run(
    motion: Motion, options: RunOptions, rates: Rates, add_errors: Callable[[RawTrajectory], RawTrajectory]
) -> RawTrajectory | None:
    """Return the run of the model with rigid bars, its first sample the start; None where it is of no use."""
    twin, n = motion.model.rigid_twin, len(motion.state) // 2
    assert twin is not None
    try:
        start = make_consistent(twin, motion.state[:n], motion.state[n:], motion.arguments)
        rigid = replace(motion, model=twin, state=np.concatenate(start))
        found = integrate_explicit_to_samples(
            rigid,
            replace(options, method=METHOD),
            LeftOut(lambda run: read_vibration_errors(add_errors(run)), rates.slow_frequency),
        )
    except NonFiniteError:  # the elastic model reports it
        return None
    if found.status != "ok" or found.log.count > MAX_EVENTS or not _keeps_energy(motion, rigid, found):
        return None
    state = found.state.copy()
    state[0] = motion.state
    return replace(add_errors(found), state=state)


def _bound_vibration(motion: Motion, stiff: tuple[int, ...], rates: Rates) -> FloatArray:
    """Return the vibration of bars at the start, [m], [m/s] and [N]; infinite where something is not finite.

    Bars whose lengths accelerate by l'' are s away from the stretches that their tensions ask for, with
    M mu s = -l'', M = G H^-1 G^T and G the rows of their directions. Bars that share a node pass it on: all
    of their vibrations together count for each node.
    """
    model, n = motion.model, len(motion.state) // 2
    q, v = motion.state[:n], motion.state[n:]
    try:
        acceleration = model.compute("acceleration", coordinate=q, velocity=v, **motion.arguments)
        law = np.asarray(model.compute("member_law", **motion.arguments))[list(stiff)]
    except NonFiniteError:
        return np.full(3, np.inf)
    ends = model.keep(("ends", stiff), lambda: find_end_coordinates(model, np.array(stiff, dtype=np.int64)))
    is_elastic = law[:, 1] > 0.0
    ends, law = ends[is_elastic], law[is_elastic]
    mu, offset = law[:, 1], law[:, 3:]
    vector, moving = find_vectors(q, ends, offset), find_vectors(v, ends, np.zeros_like(offset))
    pulled = find_vectors(acceleration, ends, np.zeros_like(offset))
    with np.errstate(all="ignore"):  # members without a length have no direction, and no bound
        length = np.sqrt(np.sum(vector**2, axis=1))
        direction = vector / length[:, None]
        along = np.sum(direction * moving, axis=1)
        bend = np.sum(direction * pulled, axis=1) + (np.sum(moving**2, axis=1) - along**2) / length
    if not np.isfinite(bend).all():
        return np.full(3, np.inf)
    # Modes of the bars alone: y = sqrt(mu) s, y'' = -K y.
    root = np.sqrt(mu)
    square, mode = np.linalg.eigh(root[:, None] * _find_mobility(motion, ends, direction) * root)
    if not (square > TENSION_COMPLIANCE * square.max(initial=0.0)).all():
        return np.full(3, np.inf)
    omega = np.sqrt(square)
    amount = np.hypot((mode.T @ (root * bend)) / square, (mode.T @ (root * along)) / omega)
    far = np.abs(mode) @ np.stack([amount, amount * omega], axis=1) / root[:, None]
    far = np.column_stack([far, far[:, 0] * mu])
    return np.asarray(
        AMPLITUDE_SAFETY * (far.max(axis=0, initial=0.0) if rates.meeting == 1 else far.sum(axis=0))
    )


def _find_mobility(motion: Motion, ends: IntArray, direction: FloatArray) -> FloatArray:
    """Return G H^-1 G^T of members (n, n) [1/kg], from coordinates of their ends and their directions."""
    row, column, value = motion.model.compute_entries("mass_matrix", **motion.arguments)
    n = len(motion.state) // 2
    mass = np.zeros((n, n))
    mass[row, column] = value
    g = np.zeros((len(ends), n + 1))  # the last column stands for anchored axes
    for end, sign in ((0, 1.0), (1, -1.0)):
        g[np.arange(len(ends))[:, None], ends[:, end]] += sign * direction
    g = g[:, :n]
    return np.asarray(g @ np.linalg.solve(mass, g.T))


def _bound_drift(motion: Motion, found: RawTrajectory, rates: Rates) -> FloatArray:
    """Return by how much the next order of the stretch shifts a motion [m], [m/s], and tensions [N]."""
    twin, n = motion.model.rigid_twin, found.state.shape[1] // 2
    assert twin is not None
    rows = {"coordinate": found.state[:, :n], "velocity": found.state[:, n:]}
    left_out = twin.compute_rows("rigidity_error", rows, motion.arguments, len(found.time))
    largest = float(np.max(np.nan_to_num(left_out, nan=np.inf), initial=0.0))
    safety = EVENT_SAFETY if found.log.count else JOINED_SAFETY if rates.meeting > 1 else LAG_SAFETY
    stiffest = float(np.asarray(motion.model.compute("member_law", **motion.arguments))[:, 1].max())
    return np.array([*_shift(motion, safety * largest, rates), TENSION_SAFETY * largest * stiffest])


def _bound_least_drift(motion: Motion, stiff: tuple[int, ...], rates: Rates) -> FloatArray:
    """Return what _bound_drift finds at least [m], [m/s], before there is a model with rigid bars to tell.

    What the stretch T / mu leaves out is of the order of (slow / fast)^2 of it; measured 1 / 45 to 1 / 700.
    """
    n, chosen = len(motion.state) // 2, list(stiff)
    at = {**motion.arguments, "coordinate": motion.state[:n], "velocity": motion.state[n:]}
    tension = np.abs(motion.model.compute("member_tension", **at))[chosen]
    mu = np.asarray(motion.model.compute("member_law", **motion.arguments))[chosen, 1]
    stretch = float(np.max(tension[mu > 0.0] / mu[mu > 0.0], initial=0.0))
    left_out = LEAST_LAG * stretch * (rates.slow_frequency / rates.frequency) ** 2
    return np.array([*_shift(motion, LAG_SAFETY * left_out, rates), 0.0])


def _shift(motion: Motion, left_out: float, rates: Rates) -> tuple[float, float]:
    """Return by how much a length that is left out [m] shifts a motion [m], [m/s]."""
    shift = left_out * (1.0 + LAG_GROWTH * rates.slow_frequency * motion.t_end)
    return shift, shift * rates.slow_frequency


def _keeps_energy(motion: Motion, rigid: Motion, found: RawTrajectory) -> bool:
    """Return whether the vibration at the start, which rigid bars leave out, has little of the energy."""
    n = len(motion.state) // 2
    starts = np.stack([motion.state, rigid.state])
    rows = [{"coordinate": states[:, :n], "velocity": states[:, n:]} for states in (starts, found.state)]
    energy = motion.model.compute_rows("total_energy", rows[0], motion.arguments, 2)[:, 0]
    kinetic = motion.model.compute_rows("kinetic_energy", rows[1], motion.arguments, len(found.time))
    return bool(abs(energy[0] - energy[1]) <= MAX_ENERGY_SHARE * float(np.max(kinetic)))
