"""Bins of values: their edges, linear or logarithmic, and means in them."""

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray

WIDE = 50.0  # largest over least value from which on a positive range is shown on a logarithmic axis


def is_logarithmic(values: FloatArray) -> bool:
    """Return whether values are all positive and lie so far apart that a logarithmic axis shows them better.

    They must also fill it: the middle value lies nearer to the middle of the logarithms.
    """
    if not len(values) or values.min() <= 0.0 or values.max() < WIDE * values.min():
        return False
    low, high, middle = float(values.min()), float(values.max()), float(np.median(values))
    return (middle - low) / (high - low) < 0.25


def make_bins(values: FloatArray, count: int) -> FloatArray:
    """Return the edges (count + 1,) of bins that hold all finite values, logarithmic where these are.

    Values that are equal, but for rounding, are in the middle of one bin.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return np.array([0.0, 1.0])
    low, high = float(finite.min()), float(finite.max())
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        half = 0.5 * max(abs(low) * 1e-3, 1e-9 if low == 0.0 else 0.0)
        return np.array([low - half, high + half])
    if is_logarithmic(finite):
        edges = np.geomspace(low, high, count + 1)
    else:
        edges = np.linspace(low, high, count + 1)
    edges[0], edges[-1] = low, high
    return edges


def find_edges(points: FloatArray) -> FloatArray:
    """Return the edges (n + 1,) of cells around increasing points (n,), half way between neighbours."""
    if len(points) == 1:
        return make_bins(points, 1)
    log = is_logarithmic(points)
    place = np.log(points) if log else points
    middle = 0.5 * (place[1:] + place[:-1])
    ends = 2 * place[0] - middle[0], 2 * place[-1] - middle[-1]
    edges = np.concatenate([[ends[0]], middle, [ends[1]]])
    result: FloatArray = np.exp(edges) if log else edges
    return result


def bin_means(
    x: FloatArray, y: FloatArray, values: FloatArray, x_edges: FloatArray, y_edges: FloatArray
) -> FloatArray:
    """Return the mean of the finite values in each bin, (n_x, n_y); NaN in bins without any."""
    rows = np.isfinite(values)
    column = np.digitize(x[rows], x_edges[1:-1])
    row = np.digitize(y[rows], y_edges[1:-1])
    shape = (len(x_edges) - 1, len(y_edges) - 1)
    place = column * shape[1] + row
    count = np.bincount(place, minlength=shape[0] * shape[1])
    total = np.bincount(place, weights=values[rows], minlength=len(count))
    means: FloatArray = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return means.reshape(shape)
