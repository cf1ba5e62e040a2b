"""Error control at the samples of motions side by side: runs with ever tighter steps, the rest alone."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tensegrity_codegen.runtime.accuracy.error_control import EPS, LEAST_SHARE_OF_STEPS, LOOSE_RTOL
from tensegrity_codegen.runtime.accuracy.explicit import (
    LOSS_SAFETY,
    MIN_COUNTED_OVER_JUMPS,
    NEGLIGIBLE_LOSS,
    has_force_jumps,
)
from tensegrity_codegen.runtime.accuracy.integrate import integrate
from tensegrity_codegen.runtime.accuracy.rates import find_fastest_of_batch
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_length, tolerance_of_options
from tensegrity_codegen.runtime.accuracy.tolerance import BLOCK_SIZE, Tolerance
from tensegrity_codegen.runtime.integrate.batch_integration import integrate_batch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawBatch, RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.integrators import find_row

FACTORS = (1.0, 0.03, 1e-3, 3e-5, 1e-6)  # tolerance of the steps of each run over that of the samples


def integrate_batch_to_samples(motion: Motion, options: RunOptions, threads: int) -> RawBatch:
    """Return motions whose estimated error is within the tolerance at every sample, or whose status tells.

    Steps are not cut at events: the whole difference of two runs counts as the error of the tighter one, more
    where forces jump. Motions that the steps of FACTORS are not expected to bring within the tolerance, or
    whose fastest vibration they lose, are integrated one by one, their steps cut at events. What becomes of a
    motion depends neither on the others nor on the threads.
    """
    limits = set_atol_by_length(motion.model.manifest, options)
    tolerance = tolerance_of_options(motion.model.manifest, limits)
    counted = MIN_COUNTED_OVER_JUMPS if has_force_jumps(motion) else 1.0
    factor, power = find_row(options.method, False).vibration_loss
    first = integrate_batch(motion, limits, threads)
    batch = replace(first, error_estimate=np.full(len(first.status), np.nan))
    rows = np.flatnonzero(np.array(first.status) == "ok")
    frequency = find_fastest_of_batch(motion, threads)
    alone: list[int] = []
    for before, after in pairwise(FACTORS):
        if not rows.size:
            break
        within = limits.within(after * limits.rtol, after * limits.absolute)
        finer = integrate_batch(_select(motion, rows), within, threads)
        error, slowest = _compare(batch.state[rows], finer.state, tolerance)
        error = np.maximum(counted * error, LEAST_SHARE_OF_STEPS * after)
        # A vibration that steps lose, or that rounding excites beyond the tolerance, is left to single runs.
        turned = frequency[rows] * motion.t_end
        lost = LOSS_SAFETY * factor * turned**power / np.maximum(finer.n_steps, 1) ** (power - 1.0)
        largest = np.abs(finer.state[..., : finer.state.shape[2] // 2]).max(axis=(1, 2))
        is_above_rounding = EPS * frequency[rows] * largest <= slowest
        is_fit = is_above_rounding & (lost <= NEGLIGIBLE_LOSS)
        # Errors are taken to shrink with the tolerance of steps.
        reachable = (is_above_rounding if options.atol is None else is_fit) & (error * FACTORS[-2] <= before)
        good = is_fit & (error <= 1.0) & (before * limits.rtol <= LOOSE_RTOL)
        batch = _put(batch, rows, finer, np.where(good, error, np.nan))
        alone += rows[~good & ~reachable].tolist()
        rows = rows[~good & reachable]
    return _put_alone(batch, motion, options, sorted([*alone, *rows.tolist()]), threads)


def _select(motion: Motion, rows: IntArray | int) -> Motion:
    """Return some motions of a batch, or one."""
    nominal = motion.model.nominal
    arguments = {
        name: value[rows] if np.ndim(value) > nominal(name).ndim else value
        for name, value in motion.arguments.items()
    }
    return replace(motion, state=motion.state[rows], arguments=arguments)


def _compare(loose: FloatArray, tight: FloatArray, tolerance: Tolerance) -> tuple[FloatArray, FloatArray]:
    """Return differences over the tolerance, and the least error allowed of velocities [m/s], (n_batch,)."""
    n_batch, n_times, n_states = tight.shape
    error, speed = np.empty((2, n_batch))
    size = max(1, BLOCK_SIZE // (n_times * n_states))
    for start in range(0, n_batch, size):
        rows = slice(start, start + size)
        states = tight[rows].reshape(-1, n_states)
        apart = tolerance.lengths(states - loose[rows].reshape(-1, n_states))
        allowed = np.concatenate([tolerance.measure(one).allowed(one) for one in tight[rows]])
        error[rows] = (apart / allowed).reshape(-1, n_times * allowed.shape[1]).max(axis=1)
        speeds = allowed[:, len(tolerance.first) :]
        speed[rows] = speeds.reshape(-1, n_times * speeds.shape[1]).min(axis=1)
    return error, speed


def _put(batch: RawBatch, rows: IntArray, finer: RawBatch, error: FloatArray) -> RawBatch:
    """Return a batch with these rows by tighter steps; error (n_rows,): their estimates, or NAN."""
    batch.state[rows], batch.n_reached[rows] = finer.state, finer.n_reached
    batch.n_steps[rows], batch.n_rejected[rows] = finer.n_steps, finer.n_rejected
    batch.n_evaluations[rows] += finer.n_evaluations
    assert batch.error_estimate is not None
    batch.error_estimate[rows] = error
    status, message = list(batch.status), list(batch.message)
    for k, word, told, one in zip(rows.tolist(), finer.status, finer.message, error.tolist(), strict=True):
        status[k], message[k] = word, f"{told}; estimated error {one:.2g} of the tolerance"
    return replace(batch, status=tuple(status), message=tuple(message))


def _put_alone(
    batch: RawBatch, motion: Motion, options: RunOptions, rows: Sequence[int], threads: int
) -> RawBatch:
    """Return a batch with these rows integrated one by one, their errors controlled as `simulate` does."""
    motion = replace(motion, progress=None)
    status, message = list(batch.status), list(batch.message)
    assert batch.error_estimate is not None

    def run(k: int) -> RawTrajectory:
        return integrate(_select(motion, k), options)

    with ThreadPoolExecutor(threads) as pool:  # the calls into C hold no lock of Python's
        try:
            for k, raw in zip(rows, pool.map(run, rows), strict=True):
                reached = len(raw.time)
                batch.state[k, :reached], batch.state[k, reached:] = raw.state, np.nan
                batch.n_reached[k], batch.n_steps[k], batch.n_rejected[k] = reached, raw.n_steps, -1
                batch.n_evaluations[k] += raw.n_evaluations
                batch.error_estimate[k] = np.nan if raw.error_estimate is None else raw.error_estimate
                status[k], message[k] = raw.status, raw.message
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return replace(batch, status=tuple(status), message=tuple(message))
