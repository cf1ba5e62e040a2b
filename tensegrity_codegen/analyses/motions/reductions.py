"""Reductions of the samples of a motion in a sweep: its end, extremes, means, first times."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.keep_text import EVERY, FIRST, KeptText
from tensegrity_codegen.analyses.cases.record import Output

RealArray = NDArray[Any]
# The sentence about a reduction.
SENTENCES = {
    "final": "at the end",
    "max": "largest over the samples",
    "min": "smallest over the samples",
    "mean": "mean over time",
    "rms": "root of the mean square over time",
}


def reduce_output(kept_text: KeptText, output: Output, time: RealArray) -> Output:
    """Return the array of a motion from that of one sample; time: of the samples, (n_t,) [s]."""
    if kept_text.reduction == FIRST:
        interpolation = "between samples on a straight line; NAN if never."
        sentence = f"First time at which {kept_text.expression} holds, {interpolation}"
        return replace(output, unit="s", sentence=sentence)
    if kept_text.reduction in SENTENCES:
        return replace(output, sentence=f"{output.sentence.rstrip('.')}: {SENTENCES[kept_text.reduction]}.")
    times = time[:: kept_text.step]
    dim = "time" if kept_text.step == 1 else f"time_{EVERY}_{kept_text.step}"
    return replace(
        output,
        dims=(dim, *output.dims),
        shape=(len(times), *output.shape),
        coordinates={**output.coordinates, dim: tuple(times.tolist())},
    )


def reduce_values(kept_text: KeptText, values: RealArray, time: RealArray) -> RealArray:
    """Return the reduction of values (count, n_t, ...) at times (n_t,) [s]."""
    if kept_text.reduction == FIRST:
        return find_first_time(values, time)
    if kept_text.reduction == "final":
        return values[:, -1]
    if kept_text.reduction == "max":
        return np.asarray(values.max(axis=1))
    if kept_text.reduction == "min":
        return np.asarray(values.min(axis=1))
    if kept_text.reduction in ("mean", "rms"):
        # Weights (n_t,) of the trapezoidal rule that add up to 1.
        span = np.zeros(len(time))
        span[1:] += np.diff(time) / 2
        span[:-1] += np.diff(time) / 2
        weight = np.asarray(span / span.sum()).reshape(-1, *(1,) * (values.ndim - 2))
        if kept_text.reduction == "mean":
            return np.asarray((weight * values).sum(axis=1))
        return np.asarray(np.sqrt((weight * values**2).sum(axis=1)))
    return values[:, :: kept_text.step]


def find_first_time(values: RealArray, time: RealArray) -> RealArray:
    """Return the first time at which values (count, n_t, ...) are positive, (count, ...) [s], NAN if never.

    Between the sample before and the one at which they are, they are taken as a straight line.
    """
    holds = values > 0
    k = holds.argmax(axis=1)
    before = np.maximum(k - 1, 0)
    low, high = (np.take_along_axis(values, index[:, None], axis=1)[:, 0] for index in (before, k))
    with np.errstate(all="ignore"):
        fraction = np.where(k > 0, -low / (high - low), 0.0)
    crossing: RealArray = time[before] + fraction * (time[k] - time[before])
    return np.asarray(np.where(holds.any(axis=1), crossing, np.nan))
