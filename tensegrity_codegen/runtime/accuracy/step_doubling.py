"""What a fixed step is worth: the same run with twice the step, and by how much it differs."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.raw_results import RawBatch, RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import Manifest

FACTORS = (2.0, 0.5)  # steps to compare with, over the step, until one says that the result is of use
SHORT = (
    0.5,
    0.25,
    0.125,
    0.0625,
)  # the same where the step loses the fastest vibration: the longest that keeps it
PHASE = 0.1  # rad, by which the fastest vibration may be off at the end and still count as followed
KEPT = 0.3  # e-folds, by which it may have faded in a run that shows that it is there
MOST_ERROR = 5e-3  # over the mean member length and the largest speed: beyond, a result is lost


def check_by_doubling(
    run: Callable[[float], RawTrajectory], step: float, manifest: Manifest, frequency: float = 0.0
) -> RawTrajectory:
    """Return the run with this step [s], its status "inaccurate" where its estimated error is beyond use.

    run: step -> trajectory, with the step that it took. error_estimate: what the difference to a run with
    twice the step says of one of order 2, as where cables go slack, over half a hundredth of the mean member
    length in coordinates and of the largest speed in velocities; where that is beyond use, or that run fails,
    or the step is the whole time, the whole difference to a run with half the step. frequency [rad/s]: of the
    fastest vibration; where these steps lose it, longer ones do so too, and the run is held to one that does
    not.
    """
    found = run(step)
    if found.status != "ok":
        return found
    step = found.step or step  # a longer one was cut to the whole time
    error, n_evaluations = None, found.n_evaluations
    for factor in _factors(frequency, step, float(found.time[-1])):
        other = run(factor * step)
        n_evaluations += other.n_evaluations
        ratio = _ratio(other, found)
        if other.status == "ok" and (factor < 1.0 or ratio > 1.1):
            error = _apart(found, other, ratio, manifest)
            if error <= 1.0:
                break
    checked = replace(found, n_evaluations=n_evaluations, error_estimate=error)
    if error is not None and error <= 1.0:
        return replace(checked, message=f"{found.message}; {_tell(error)}")
    return replace(checked, status="inaccurate", message=_say(error))


def _factors(frequency: float, step: float, end: float) -> tuple[float, ...]:
    """Return steps to compare with, over the step.

    Runge-Kutta 4 with h takes a vibration w by (w h)^4 / 120 of its phase and (w h)^5 / 144 of its size.
    """
    turned, reach = frequency * end, frequency * step
    if turned * reach**4 <= 120.0 * PHASE:
        return FACTORS
    kept = (144.0 * KEPT / turned) ** 0.2 / reach
    return (next((factor for factor in SHORT if factor <= kept), SHORT[-1]),)


def check_batch_by_doubling(
    run: Callable[[float], RawBatch], step: float, manifest: Manifest, frequency: FloatArray
) -> RawBatch:
    """Return a batch of runs with this step [s], each held to another step as `check_by_doubling` does.

    frequency (n_batch,) [rad/s]: of the fastest vibration of each.
    """
    found = run(step)
    end, is_good = float(found.time[-1]), _is_ok(found)
    step = found.step or step  # a longer one was cut to the whole time
    error, n_evaluations = np.full(len(is_good), np.nan), found.n_evaluations.copy()
    wanted = [_factors(float(w), step, end) for w in frequency]
    for factor in (FACTORS[0], *SHORT):
        is_open = is_good & ~(error <= 1.0) & np.array([factor in factors for factors in wanted])
        if not is_open.any():
            continue
        other = run(factor * step)
        ratio = _ratio(other, found)
        n_evaluations[is_open] += other.n_evaluations[is_open]
        if factor < 1.0 or ratio > 1.1:
            known = is_open & _is_ok(other)
            error[known] = _error(found.state[known], other.state[known], ratio, end, manifest)
    status, message = list(found.status), list(found.message)
    for k in np.flatnonzero(is_good & (error <= 1.0)):
        message[k] += f"; {_tell(float(error[k]))}"
    for k in np.flatnonzero(is_good & ~(error <= 1.0)):
        status[k], message[k] = "inaccurate", _say(None if np.isnan(error[k]) else float(error[k]))
    return replace(
        found,
        status=tuple(status),
        message=tuple(message),
        n_evaluations=n_evaluations,
        error_estimate=error,
    )


def _apart(found: RawTrajectory, other: RawTrajectory, ratio: float, manifest: Manifest) -> float:
    """Return the estimated error of a run beside the other; infinite where an event has ended only one."""
    shared = min(len(found.time), len(other.time))
    if max(len(found.time), len(other.time)) > shared + 1:
        return float(np.inf)
    return float(_error(found.state[:shared], other.state[:shared], ratio, float(found.time[-1]), manifest))


def _is_ok(batch: RawBatch) -> NDArray[np.bool_]:
    return np.array([word == "ok" for word in batch.status])


def _error(state: FloatArray, other: FloatArray, ratio: float, end: float, manifest: Manifest) -> FloatArray:
    """Return the estimated error of runs (..., n_t, n_states) to `end` [s], over that which loses them."""
    share = min(1.0, 1.0 / abs(ratio**2 - 1.0))
    apart = np.abs(state - other) / _lost(state, end, manifest)[..., None, :]
    return share * np.asarray(apart.max(axis=(-2, -1)))


def _say(error: float | None) -> str:
    return f"{_tell(error)}: take a smaller step"


def _tell(error: float | None) -> str:
    told = "not known" if error is None else f"{100.0 * MOST_ERROR * error:.3g} % of the structure's size"
    return f"the estimated error is {told}"


def _ratio(other: RawTrajectory | RawBatch, found: RawTrajectory | RawBatch) -> float:
    return float(other.step or 0.0) / float(found.step or 1.0)


def _lost(state: FloatArray, end: float, manifest: Manifest) -> FloatArray:
    """Return the error of each component (..., n_states) at which runs (..., n_t, n_states) are lost."""
    n = state.shape[-1] // 2
    place = np.array(manifest.node_position).reshape(-1, 3)
    ends = place[np.array(manifest.connectivity, dtype=np.int64).reshape(-1, 2)]
    mean = float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()) if len(ends) else 0.0
    farthest, fastest = (np.abs(part).max(axis=(-2, -1)) for part in (state[..., :n], state[..., n:]))
    if find_formulation(manifest.formulation).has_angles or not mean > 0.0:
        length = np.where(farthest > 0.0, farthest, 1.0)
    else:
        length = np.full_like(farthest, mean)
    speed = np.maximum(fastest, length / end)
    return MOST_ERROR * np.repeat(np.stack([length, speed], axis=-1), n, axis=-1)
