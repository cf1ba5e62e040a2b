"""Vibrations of stiff members that kinks of a profile excite: forces, or their rates, jump there."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.system.arrays import FloatArray

ROUGHLY = 2.0  # times what a member on two free masses does: others at its ends change it a little
SPREAD = 3.0  # longest step over the mean one
RESOLVED = 0.5  # rad of a vibration in one step, up to which radau follows it
PART = 1e-3  # of a piece, over which the rate of a force is taken


def bound_kinks(motion: Motion, raw: RawTrajectory, stiff: tuple[int, ...]) -> FloatArray:
    """Return bounds of amplitudes [m], speeds [m/s], tensions [N] of the vibrations that a run leaves out.

    A jump F of the force at the ends of a member of stiffness mu and frequency w makes it vibrate by F / mu,
    a jump F' of its rate by F' / (mu w); all kinks add up. Members whose vibration the steps resolve do not
    count. stiff: the members.
    """
    schedule = motion.schedule
    if not isinstance(schedule, DrivenArguments) or not schedule.pieces.is_kink.any() or len(raw.time) < 2:
        return np.zeros(3)
    mu, omega, ends = _find_members(motion, stiff)
    if not len(mu):
        return np.zeros(3)
    far = np.zeros(len(mu))
    for kink in np.flatnonzero(schedule.pieces.is_kink):
        force, rate = _find_jumps(motion, raw, schedule, int(kink))
        far += (_pull(force, ends) + _pull(rate, ends) / omega) / mu
    step = SPREAD * float(raw.time[-1]) / max(raw.n_steps, 1)
    far = np.where(omega * step < RESOLVED, 0.0, ROUGHLY * far)
    return np.array([far.max(), (far * omega).max(), (far * mu).max()])


def _find_members(motion: Motion, stiff: tuple[int, ...]) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Return stiffness [N/m], frequency [rad/s] and coordinates (n, 2 n_axes) of the elastic members.

    Coordinates of anchored ends are -1.
    """
    manifest = motion.model.manifest
    place = {(int(node), int(axis)): k for k, (node, axis) in enumerate(manifest.coordinate_node_axis)}
    law = np.asarray(motion.model.compute("member_law", **motion.arguments))
    mass = motion.model.compute("mass_matrix", **motion.arguments).diagonal()
    rows, inverse = [], []
    chosen = [member for member in stiff if law[member, 1] > 0.0]
    for member in chosen:
        row = [
            place.get((node, axis), -1) for node in manifest.connectivity[member] for axis in manifest.axes
        ]
        rows.append(row)
        half = len(row) // 2
        free = [[1.0 / mass[k] for k in part if k >= 0] for part in (row[:half], row[half:])]
        inverse.append(sum(min(part) for part in free if part))
    mu = law[chosen, 1]
    return mu, np.sqrt(mu * np.array(inverse)), np.array(rows, dtype=np.int64).reshape(len(chosen), -1)


def _find_jumps(
    motion: Motion, raw: RawTrajectory, schedule: DrivenArguments, kink: int
) -> tuple[FloatArray, FloatArray]:
    """Return by how much forces [N] and their rates [N/s] jump at a kink, at the sample before it."""
    pieces, n = schedule.pieces, raw.state.shape[1] // 2
    time = float(pieces.time[kink])
    state = raw.state[max(int(np.searchsorted(raw.time, time, side="right")) - 1, 0)]
    span = PART * float(min(pieces.time[kink] - pieces.time[kink - 1], pieces.time[kink + 1] - time))

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
    parts = np.where(ends >= 0, force[ends], 0.0).reshape(len(ends), 2, -1)
    return np.asarray(np.linalg.norm(parts, axis=2).sum(axis=1))
