"""Control of the error at the end, not of each step: tighten the steps until two runs agree."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory

__all__ = ["CROWDED", "MOST_OF_TOLERANCE", "tighten_until_converged"]

FloatArray = NDArray[np.float64]
LeftOut = Callable[[RawTrajectory], FloatArray]

MOST_ROUNDS = 7
TIGHTEST_RTOL = 1e-15  # below, a step's error is rounding
MOST_WORK = 3e10  # evaluations times states; some minutes on one core
ORDER = 5  # the number of steps grows as the tolerance to the power -1 / ORDER
FLOORS_APART = 3.0  # times the least tolerance: nearer to it two runs are as wrong as each other
BLOCK = 2**20  # numbers compared at a time
CROWDED = "too_many_events"  # the status of a run that events hold up
MOST_OF_TOLERANCE = 10.0  # that is still good where nothing better can be had


def tighten_until_converged(
    run: Callable[[float, float], RawTrajectory],
    rtol: float,
    atol: float,
    left_out: LeftOut | None = None,
    *,
    least_atol: float = 0.0,
    trust: float = 0.0,
    resolves_left_out: bool = False,
) -> RawTrajectory:
    """Return a run whose estimated error is within atol + rtol |x| at every sample, component by component.

    run: (rtol, atol) of one step -> trajectory. Each round tightens the steps' tolerance by a factor s of at
    most 1/10, and takes min(1/3, 3 s^p) of the difference of the two runs for the error of the tighter one,
    which is returned: errors shrink with the tolerance, here trusted to a third of that, and with the power
    p <= 1 with which they did so in the round before. Where rounding ends the tightening, ten times the
    tolerance is still good. Status "not_converged" with the last run and estimate if the rounds do not come
    together, or the next one would take all beyond MOST_WORK.

    left_out: run -> amounts (n_states,) that all runs are off by alike. They do not keep the rounds going;
    those of positions count in the estimate, those of velocities are the caller's to tell. least_atol: below
    which the steps' absolute tolerance does not go; there the whole difference to a run with ten times that
    counts. trust: the part of a difference that counts at least, for methods that pass over kinks.
    resolves_left_out: whether tighter steps leave less out, so that amounts of positions keep the rounds
    going after all.
    """
    if rtol < 10.0 * TIGHTEST_RTOL:
        return _beyond_rounding(run, rtol, atol)
    factor, previous, error, least = 1.0, run(rtol, atol), np.inf, min(least_atol, atol)
    n_evaluations = previous.n_evaluations
    last, apart = 0.1, np.inf  # tightening and difference of the round before
    for _ in range(MOST_ROUNDS):
        if previous.status == "unstable":
            return replace(previous, method=_name(previous))
        if previous.status != "ok":
            return _give_up(previous, error, previous.message, previous.status)
        shrink = float(np.clip(0.3 / error, 1e-3, 0.1)) if np.isfinite(error) else 0.1
        shrink = min(0.1, max(shrink, TIGHTEST_RTOL / (rtol * factor)))
        shrink = 0.1 if atol * factor <= least else shrink  # rounding is near
        expected = n_evaluations + previous.n_evaluations * shrink ** (-1.0 / ORDER)
        if expected * previous.state.shape[1] > MOST_WORK:
            why = f"a run with steps of rtol = {rtol * factor * shrink:.3g} would take too long to wait for"
            return _give_up(previous, error, why)
        before, factor = max(atol * factor, least), factor * shrink
        finer = run(rtol * factor, max(atol * factor, least))
        n_evaluations += finer.n_evaluations
        is_short = finer.n_evaluations < 0.5 * previous.n_evaluations
        if finer.status == "not_converged" and is_short and shrink < 0.1:
            # It stopped early, perhaps since rounding lets no step be so exact: halfway there.
            factor /= math.sqrt(shrink)
            shrink = math.sqrt(shrink)
            finer = run(rtol * factor, max(atol * factor, least))
            n_evaluations += finer.n_evaluations
        if finer.status != "ok":
            reached = previous if previous.status == "ok" else finer
            return _give_up(reached, error, finer.message, finer.status)
        if atol * factor <= least and before < FLOORS_APART * least:
            before = 10.0 * least
            previous = run(10.0 * rtol * factor, before)
            n_evaluations += previous.n_evaluations
        off = left_out(finer) if left_out else np.zeros(finer.state.shape[1])
        trusted = max(shrink, max(atol * factor, least) / before)
        wider, apart = apart, _difference(previous, finer, rtol, atol, off)
        part = min(1.0 / 3.0, 3.0 * trusted ** _power(wider, apart, last)) if atol * factor > least else 1.0
        error, last = apart * max(part, trust), trusted
        at_floor = factor * rtol <= TIGHTEST_RTOL or atol * factor <= least
        share, most = _share(finer, rtol, atol, off), MOST_OF_TOLERANCE if at_floor else 1.0
        if error <= most and (not resolves_left_out or error + share <= most):
            error += share
            message = f"{finer.message}; estimated error {error:.2g} of the tolerance"
            return replace(
                finer, method=_name(finer), message=message, error_estimate=error, n_evaluations=n_evaluations
            )
        if factor * rtol <= TIGHTEST_RTOL:
            return _give_up(finer, error, "rounding keeps the runs apart")
        error += share if resolves_left_out else 0.0
        previous = finer
    return _give_up(previous, error, f"{MOST_ROUNDS} rounds did not come together")


def _power(before: float, apart: float, shrink: float) -> float:
    """Return the power p of s with which the difference of two runs shrank when the tolerance did by s."""
    if not 0.0 < apart < before < np.inf:
        return 1.0 if not np.isfinite(before) or apart == 0.0 else 0.0
    return min(1.0, float(np.log(apart / before) / np.log(shrink))) if shrink < 1.0 else 0.0


def _beyond_rounding(run: Callable[[float, float], RawTrajectory], rtol: float, atol: float) -> RawTrajectory:
    """Return the best run there is for a tolerance below rounding, and how far it is from that tolerance."""
    scale = TIGHTEST_RTOL / rtol
    loose, tight = run(10.0 * scale * rtol, 10.0 * scale * atol), run(scale * rtol, scale * atol)
    if tight.status == "unstable":
        return replace(tight, method=_name(tight))
    error = _difference(loose, tight, rtol, atol) if tight.status == "ok" else np.inf
    stopped = "" if tight.status == "ok" else f" ({tight.message})"
    return _give_up(tight, error, f"the tolerance is below rounding{stopped}")


def _difference(
    loose: RawTrajectory, tight: RawTrajectory, rtol: float, atol: float, off: FloatArray | float = 0.0
) -> float:
    """Return the largest difference over off + atol + rtol |x|; infinite if a run ended early."""
    if loose.status != "ok" or loose.state.shape != tight.state.shape:
        return float(np.inf)
    count, width = tight.state.shape
    rows = max(1, BLOCK // max(width, 1))
    parts = [slice(start, start + rows) for start in range(0, count, rows)]
    return float(np.max([_worst(tight.state[part], loose.state[part], off, rtol, atol) for part in parts]))


def _worst(tight: FloatArray, loose: FloatArray, off: FloatArray | float, rtol: float, atol: float) -> float:
    return float(np.max(np.abs(tight - loose) / (off + atol + rtol * np.abs(tight)), initial=0.0))


def _share(run: RawTrajectory, rtol: float, atol: float, off: FloatArray) -> float:
    """Return the largest part of the tolerance that positions are off by after the start."""
    n = run.state.shape[1] // 2
    if not off[:n].any():
        return 0.0
    return float(np.max(off[:n] / (atol + rtol * np.abs(run.state[1:, :n])), initial=0.0))


def _give_up(last: RawTrajectory, error: float, why: str, stopped: str = "not_converged") -> RawTrajectory:
    """Return the last run with what ended the rounds; stopped: the status of the run that did."""
    estimate = error if np.isfinite(error) else None
    told = "unknown" if estimate is None else f"{estimate:.3g} times the tolerance"
    return replace(
        last,
        status=stopped if stopped == CROWDED else "not_converged",
        message=f"{why}; estimated error {told}: loosen --rtol and --atol, simulate a shorter time, "
        "or ask for control of each step's error only",
        method=_name(last),
        error_estimate=estimate,
    )


def _name(run: RawTrajectory) -> str:
    """Return the method's name: what ran, and that its tolerance was tightened."""
    return f"{run.method}, tolerance tightened"
