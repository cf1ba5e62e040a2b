"""Figures of a summary: histograms, curves, scatter plots, heat maps, failures, indices."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import HEIGHT, TEXT_SIZE, WIDTH, dress_axes
from tensegrity_codegen.report.pages.page import Figure
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.canvas import GRID, INK, MUTED, SEQUENCE, new_figure
from tensegrity_codegen.sweeps.summary.results import SweepResults, shorten_key
from tensegrity_codegen.sweeps.summary.statistics import Indices
from tensegrity_codegen.sweeps.summary.summary import ChosenResult
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing


MOST_POINTS = 5000  # of a scatter plot; more cases become a two-dimensional histogram
BINS, MAP_BINS = 40, 60
COLOR_MAP = "cividis"
MIN_LOGARITHMIC_RATIO = 50.0  # largest over least value from which on an axis may be logarithmic


def draw_histogram(result: ChosenResult, name: str) -> Figure:
    """Return the histogram of a result over the cases that have one."""
    values = result.values[np.isfinite(result.values)]
    edges = make_bins(values, min(BINS, max(8, math.isqrt(len(values)))))
    counts, _ = np.histogram(values, edges)
    figure, axes = _new_axes()
    axes.stairs(counts, edges, fill=True, color=SEQUENCE[0], alpha=0.85)
    dress_axes(axes, result.label, "cases", log=(is_logarithmic(edges), False))
    if is_logarithmic(edges):
        axes.set_xscale("log")
    caption = f"{result.name}: {len(values):,} cases."
    data = {"edges": edges.tolist(), "count": counts.tolist()}
    return _make_figure(figure, name, caption, data)


def draw_curve(results: SweepResults, key_index: int, result: ChosenResult, name: str) -> Figure:
    """Return a result over the only key of a grid: one point a case, gaps for failed cases."""
    x, y = results.key_values[:, key_index], result.values
    order = np.argsort(x, kind="stable")
    figure, axes = _new_axes()
    marker = "o" if len(x) <= 60 else ""
    axes.plot(x[order], y[order], color=SEQUENCE[0], linewidth=1.7, marker=marker, markersize=3.5)
    key = results.keys[key_index]
    _set_logarithmic_axes(axes, x, None)
    dress_axes(axes, results.label_key(key), result.label, log=(_has_logarithmic_axis(x), False))
    n_failed = int((~np.isfinite(y)).sum())
    gaps = f"; {n_failed} cases without result are gaps." if n_failed else "."
    caption = f"{result.name} over {key}{gaps}"
    return _make_figure(figure, name, caption, {"x": _to_json(x[order]), "y": _to_json(y[order])})


def draw_scatter(results: SweepResults, key_index: int, result: ChosenResult, name: str) -> Figure:
    """Return a result over a key: one point a case; of many cases, the number of cases in each bin."""
    has_result = np.isfinite(result.values)
    x, y = results.key_values[has_result, key_index], result.values[has_result]
    key = results.keys[key_index]
    figure, axes = _new_axes()
    data: dict[str, Any]
    if len(x) <= MOST_POINTS:
        axes.plot(x, y, "o", color=SEQUENCE[0], markersize=3.0, alpha=0.55, mew=0, rasterized=True)
        caption = f"{result.name} over {key}: a point a case."
        data = {"x": _to_json(x), "y": _to_json(y)}
        _set_logarithmic_axes(axes, x, y)
    else:
        edges = make_bins(x, MAP_BINS), make_bins(y, MAP_BINS)
        counts, _, _ = np.histogram2d(x, y, bins=[edges[0], edges[1]])
        _draw_colored_bins(figure, axes, edges, np.where(counts > 0, counts, np.nan), "cases", log=True)
        caption = f"{result.name} over {key}: {len(x):,} cases in {counts.shape[0]} x {counts.shape[1]} bins."
        data = {"x_edges": edges[0].tolist(), "y_edges": edges[1].tolist(), "count": counts.tolist()}
    log = _has_logarithmic_axis(x), _has_logarithmic_axis(y)
    dress_axes(axes, results.label_key(key), result.label, log=log)
    return _make_figure(figure, name, caption, data)


def draw_heat_map(
    results: SweepResults, key_indices: tuple[int, int], result: ChosenResult, name: str
) -> Figure:
    """Return the mean of a result over two keys: the points of two axes of a grid, or bins of a sample."""
    keys, columns, edges = _bin_keys(results, key_indices, np.ones(results.count, dtype=np.bool_), 24)
    means = bin_means(columns[0], columns[1], result.values, edges[0], edges[1])
    figure, axes = _new_axes()
    _draw_colored_bins(figure, axes, (edges[0], edges[1]), means, result.label)
    axes.set_facecolor(GRID)
    names = [results.label_key(key) for key in keys]
    log = _has_logarithmic_axis(columns[0]), _has_logarithmic_axis(columns[1])
    dress_axes(axes, names[0], names[1], log=log)
    is_mean = len(results.keys) > 2 or results.count > means.size
    caption = f"{'Mean of ' if is_mean else ''}{result.name} over {keys[0]} and {keys[1]}"
    caption += "; grey: no result." if not np.isfinite(means).all() else "."
    data = {"x_edges": edges[0].tolist(), "y_edges": edges[1].tolist(), "mean": _to_json(means)}
    return _make_figure(figure, name, caption, data)


def draw_failures(results: SweepResults, key_indices: Sequence[int], name: str) -> Figure:
    """Return the percentage of failed cases over one key, or over two."""
    is_computed = results.is_computed
    failed = np.where(results.is_good[is_computed], 0.0, 100.0)
    bins = 24 if len(failed) >= 2000 else 8
    keys, columns, edges = _bin_keys(results, key_indices[:2], is_computed, bins)
    names = [results.label_key(key) for key in keys]
    figure, axes = _new_axes()
    # Over one key a histogram of percentages, over two a map of them.
    if len(keys) == 1:
        inside = np.digitize(columns[0], edges[0][1:-1])
        count = np.bincount(inside, minlength=len(edges[0]) - 1)
        total = np.bincount(inside, weights=failed, minlength=len(edges[0]) - 1)
        failed_percent = np.divide(total, count, out=np.zeros(len(count)), where=count > 0)
        axes.stairs(failed_percent, edges[0], fill=True, color=SEQUENCE[1], alpha=0.85)
        _set_logarithmic_axes(axes, columns[0], None)
        axes.set_ylim(0.0, 100.0)
        dress_axes(axes, names[0], "failed cases [%]", log=(_has_logarithmic_axis(columns[0]), False))
    else:
        failed_percent = bin_means(columns[0], columns[1], failed, edges[0], edges[1])
        _draw_colored_bins(
            figure, axes, (edges[0], edges[1]), failed_percent, "failed cases [%]", color_map="Oranges"
        )
        axes.set_facecolor(GRID)
        log = _has_logarithmic_axis(columns[0]), _has_logarithmic_axis(columns[1])
        dress_axes(axes, names[0], names[1], log=log)
    grey = "; grey: no cases" if not np.isfinite(failed_percent).all() else ""
    caption = f"Share of failed cases over {' and '.join(keys)}{grey}."
    return _make_figure(figure, name, caption, {"failed_percent": _to_json(failed_percent)})


def draw_indices(result: ChosenResult, indices: Indices, name: str) -> Figure:
    """Return first-order and total indices of the keys, with their intervals."""
    n = len(indices.keys)
    figure, axes = _new_axes(height=max(2.2, 0.42 * n + 1.5))
    order = np.argsort(indices.total, kind="stable")  # the largest on top
    bar_position = np.arange(n)
    for bar_offset, values, errors, legend, color in (
        (0.19, indices.first, indices.first_error, "first order", SEQUENCE[0]),
        (-0.19, indices.total, indices.total_error, "total", SEQUENCE[1]),
    ):
        axes.barh(
            bar_position + bar_offset, values[order], 0.34, xerr=errors[order] if errors.any() else None,
            color=color, label=legend,
            error_kw={"ecolor": INK, "elinewidth": 1.0, "capsize": 2.5},
        )  # fmt: skip
    dress_axes(axes, "share of the variance", "")
    axes.set_yticks(bar_position, [shorten_key(indices.keys[k], 24) for k in order])
    figure.legend(
        loc="outside upper center", ncols=2, frameon=False, fontsize=TEXT_SIZE - 0.5, labelcolor=INK
    )
    data = {"key": list(indices.keys), "first": _to_json(indices.first), "total": _to_json(indices.total)}
    return _make_figure(figure, name, f"Which share of the variance of {result.name} each key causes.", data)


def _bin_keys(
    results: SweepResults, key_indices: Sequence[int], is_chosen: BoolArray, count: int
) -> tuple[list[str], list[FloatArray], list[FloatArray]]:
    """Return keys, their values in some cases, and edges: around points of a grid, else of `count` bins."""
    grid = dict(results.axes)
    keys = [results.keys[key_index] for key_index in key_indices]
    columns = [results.key_values[is_chosen, key_index] for key_index in key_indices]
    edges = [
        find_edges(np.unique(grid[key])) if key in grid else make_bins(column, count)
        for key, column in zip(keys, columns, strict=True)
    ]
    return keys, columns, edges


def _draw_colored_bins(
    figure: "Drawing",
    axes: "Axes",
    edges: tuple[FloatArray, FloatArray],
    values: FloatArray,
    label: str,
    *,
    log: bool = False,
    color_map: str = COLOR_MAP,
) -> None:
    """Draw the values of two-dimensional bins in colours, with a colour bar; NaN stays empty."""
    from matplotlib.colors import LogNorm

    finite = values[np.isfinite(values)]
    norm = LogNorm(1, max(2.0, float(finite.max()))) if log and len(finite) else None
    colored = axes.pcolormesh(
        edges[0], edges[1], np.ma.masked_invalid(values.T), cmap=color_map, norm=norm, rasterized=True
    )
    for scale, points in ((axes.set_xscale, edges[0]), (axes.set_yscale, edges[1])):
        if is_logarithmic(points):
            scale("log")
    color_bar = figure.colorbar(colored, ax=axes, pad=0.02)
    color_bar.set_label(label, fontsize=TEXT_SIZE, color=INK)
    color_bar.ax.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=0, which="both")
    color_bar.outline.set_visible(False)


def _new_axes(height: float = HEIGHT) -> "tuple[Drawing, Axes]":
    figure = new_figure(WIDTH, height)
    return figure, figure.add_subplot()


def _set_logarithmic_axes(axes: "Axes", x: FloatArray, y: FloatArray | None) -> None:
    """Make axes logarithmic whose values are."""
    if _has_logarithmic_axis(x):
        axes.set_xscale("log")
    if y is not None and _has_logarithmic_axis(y):
        axes.set_yscale("log")


def _has_logarithmic_axis(values: FloatArray) -> bool:
    """Return whether the finite values are shown on a logarithmic axis."""
    return is_logarithmic(values[np.isfinite(values)])


def _make_figure(figure: "Drawing", name: str, caption: str, data: dict[str, Any]) -> Figure:
    return Figure(draw_picture(figure, name), caption, caption, data)


def _to_json(values: FloatArray) -> Any:
    """Return nested lists with None for numbers that are not finite."""
    table = values.astype(object)
    table[~np.isfinite(values)] = None
    return table.tolist()


def is_logarithmic(values: FloatArray) -> bool:
    """Return whether values are positive, far apart, and fill a logarithmic axis better than a linear one."""
    if not len(values) or values.min() <= 0.0 or values.max() < MIN_LOGARITHMIC_RATIO * values.min():
        return False
    low, high, middle = float(values.min()), float(values.max()), float(np.median(values))
    return (middle - low) / (high - low) < 0.25


def make_bins(values: FloatArray, count: int) -> FloatArray:
    """Return the edges (count + 1,) of bins of all finite values, logarithmic where these are."""
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
    is_log = is_logarithmic(points)
    position = np.log(points) if is_log else points
    midpoints = 0.5 * (position[1:] + position[:-1])
    ends = 2 * position[0] - midpoints[0], 2 * position[-1] - midpoints[-1]
    edges = np.concatenate([[ends[0]], midpoints, [ends[1]]])
    result: FloatArray = np.exp(edges) if is_log else edges
    return result


def bin_means(
    x: FloatArray, y: FloatArray, values: FloatArray, x_edges: FloatArray, y_edges: FloatArray
) -> FloatArray:
    """Return the mean of the finite values in each bin, (n_x, n_y); NaN in bins without any."""
    is_finite = np.isfinite(values)
    column = np.digitize(x[is_finite], x_edges[1:-1])
    row = np.digitize(y[is_finite], y_edges[1:-1])
    shape = (len(x_edges) - 1, len(y_edges) - 1)
    bin_number = column * shape[1] + row
    count = np.bincount(bin_number, minlength=shape[0] * shape[1])
    total = np.bincount(bin_number, weights=values[is_finite], minlength=len(count))
    means: FloatArray = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return means.reshape(shape)
