"""Figures of a summary: histograms, curves, scatter plots, heat maps, failures, indices."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import HEIGHT, TEXT_SIZE, WIDTH, dress_axes
from tensegrity_codegen.report.pages.page import Figure
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.canvas import new_figure
from tensegrity_codegen.report.pictures.palette import GRID, INK, MUTED, SEQUENCE
from tensegrity_codegen.sweeps.summary.chosen import ChosenResult
from tensegrity_codegen.sweeps.summary.indices import Indices
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.system.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing


MOST_POINTS = 5000  # of a scatter plot; more cases become a two-dimensional histogram
BINS, MAP_BINS = 40, 60
COLORS = "cividis"
WIDE = 50.0  # largest over least value from which on a positive range is shown on a logarithmic axis


def draw_histogram(result: ChosenResult, name: str) -> Figure:
    """Return the histogram of a result over the cases that have one."""
    values = result.values[np.isfinite(result.values)]
    edges = make_bins(values, min(BINS, max(8, math.isqrt(len(values)))))
    counts, _ = np.histogram(values, edges)
    figure, axes = _start()
    axes.stairs(counts, edges, fill=True, color=SEQUENCE[0], alpha=0.85)
    dress_axes(axes, result.label, "cases", log=(is_logarithmic(edges), False))
    if is_logarithmic(edges):
        axes.set_xscale("log")
    caption = f"{result.name}: {len(values):,} cases."
    data = {"edges": edges.tolist(), "count": counts.tolist()}
    return _finish(figure, name, caption, data)


def draw_curve(results: SweepResults, place: int, result: ChosenResult, name: str) -> Figure:
    """Return a result over the only key of a grid: one point a case, gaps where cases failed."""
    x, y = results.key_values[:, place], result.values
    order = np.argsort(x, kind="stable")
    figure, axes = _start()
    marker = "o" if len(x) <= 60 else ""
    axes.plot(x[order], y[order], color=SEQUENCE[0], linewidth=1.7, marker=marker, markersize=3.5)
    key = results.keys[place]
    _scale(axes, x, None)
    dress_axes(axes, results.label_key(key), result.label, log=(_log(x), False))
    lost = int((~np.isfinite(y)).sum())
    caption = f"{result.name} over {key}" + (f"; {lost} cases without result are gaps." if lost else ".")
    return _finish(figure, name, caption, {"x": _plain(x[order]), "y": _plain(y[order])})


def draw_scatter(results: SweepResults, place: int, result: ChosenResult, name: str) -> Figure:
    """Return a result over a key: a point a case; of many cases how many lie where."""
    rows = np.isfinite(result.values)
    x, y = results.key_values[rows, place], result.values[rows]
    key = results.keys[place]
    figure, axes = _start()
    data: dict[str, Any]
    if len(x) <= MOST_POINTS:
        axes.plot(x, y, "o", color=SEQUENCE[0], markersize=3.0, alpha=0.55, mew=0, rasterized=True)
        caption = f"{result.name} over {key}: a point a case."
        data = {"x": _plain(x), "y": _plain(y)}
        _scale(axes, x, y)
    else:
        edges = make_bins(x, MAP_BINS), make_bins(y, MAP_BINS)
        counts, _, _ = np.histogram2d(x, y, bins=[edges[0], edges[1]])
        _paint(figure, axes, edges, np.where(counts > 0, counts, np.nan), "cases", log=True)
        caption = f"{result.name} over {key}: {len(x):,} cases in {counts.shape[0]} x {counts.shape[1]} bins."
        data = {"x_edges": edges[0].tolist(), "y_edges": edges[1].tolist(), "count": counts.tolist()}
    dress_axes(axes, results.label_key(key), result.label, log=(_log(x), _log(y)))
    return _finish(figure, name, caption, data)


def draw_heat_map(results: SweepResults, places: tuple[int, int], result: ChosenResult, name: str) -> Figure:
    """Return the mean of a result over two keys: the points of two axes of a grid, or bins of a sample."""
    grid = dict(results.axes)
    keys = [results.keys[place] for place in places]
    columns = [results.key_values[:, place] for place in places]
    edges = [
        find_edges(np.unique(grid[key])) if key in grid else make_bins(column, 24)
        for key, column in zip(keys, columns, strict=True)
    ]
    means = bin_means(columns[0], columns[1], result.values, edges[0], edges[1])
    figure, axes = _start()
    _paint(figure, axes, (edges[0], edges[1]), means, result.label)
    axes.set_facecolor(GRID)
    names = [results.label_key(key) for key in keys]
    dress_axes(axes, names[0], names[1], log=(_log(columns[0]), _log(columns[1])))
    others = len(results.keys) > 2 or results.count > means.size
    caption = f"{'Mean of ' if others else ''}{result.name} over {keys[0]} and {keys[1]}"
    caption += "; grey: no result." if not np.isfinite(means).all() else "."
    data = {"x_edges": edges[0].tolist(), "y_edges": edges[1].tolist(), "mean": _plain(means)}
    return _finish(figure, name, caption, data)


def draw_failures(results: SweepResults, places: Sequence[int], name: str) -> Figure:
    """Return where cases failed: part of failed cases over one key, or over two."""
    run = results.is_computed
    failed = np.where(results.is_good[run], 0.0, 100.0)
    columns = [results.key_values[run, place] for place in places[:2]]
    keys = [results.keys[place] for place in places[:2]]
    names = [results.label_key(key) for key in keys]
    grid = dict(results.axes)
    bins = 24 if len(failed) >= 2000 else 8
    edges = [
        find_edges(np.unique(grid[key])) if key in grid else make_bins(column, bins)
        for key, column in zip(keys, columns, strict=True)
    ]
    figure, axes = _start()
    if len(keys) == 1:
        inside = np.digitize(columns[0], edges[0][1:-1])
        count = np.bincount(inside, minlength=len(edges[0]) - 1)
        total = np.bincount(inside, weights=failed, minlength=len(edges[0]) - 1)
        part = np.divide(total, count, out=np.zeros(len(count)), where=count > 0)
        axes.stairs(part, edges[0], fill=True, color=SEQUENCE[1], alpha=0.85)
        _scale(axes, columns[0], None)
        axes.set_ylim(0.0, 100.0)
        dress_axes(axes, names[0], "failed cases [%]", log=(_log(columns[0]), False))
    else:
        part = bin_means(columns[0], columns[1], failed, edges[0], edges[1])
        _paint(figure, axes, (edges[0], edges[1]), part, "failed cases [%]", colors="Oranges")
        axes.set_facecolor(GRID)
        dress_axes(axes, names[0], names[1], log=(_log(columns[0]), _log(columns[1])))
    grey = "; grey: no cases" if not np.isfinite(part).all() else ""
    caption = f"Share of failed cases over {' and '.join(keys)}{grey}."
    return _finish(figure, name, caption, {"failed_percent": _plain(part)})


def draw_indices(result: ChosenResult, indices: Indices, name: str) -> Figure:
    """Return first-order and total indices of the keys, with their intervals."""
    n = len(indices.keys)
    figure, axes = _start(height=max(2.2, 0.42 * n + 1.5))
    order = np.argsort(indices.total, kind="stable")  # the largest on top
    place = np.arange(n)
    for shift, values, errors, word, color in (
        (0.19, indices.first, indices.first_error, "first order", SEQUENCE[0]),
        (-0.19, indices.total, indices.total_error, "total", SEQUENCE[1]),
    ):
        axes.barh(
            place + shift, values[order], 0.34, xerr=errors[order] if errors.any() else None, color=color,
            label=word,
            error_kw={"ecolor": INK, "elinewidth": 1.0, "capsize": 2.5},
        )  # fmt: skip
    dress_axes(axes, "share of the variance", "")
    axes.set_yticks(place, [_shorten(indices.keys[k]) for k in order])
    figure.legend(
        loc="outside upper center", ncols=2, frameon=False, fontsize=TEXT_SIZE - 0.5, labelcolor=INK
    )
    data = {"key": list(indices.keys), "first": _plain(indices.first), "total": _plain(indices.total)}
    return _finish(figure, name, f"Which share of the variance of {result.name} each key causes.", data)


def _paint(
    figure: "Drawing",
    axes: "Axes",
    edges: tuple[FloatArray, FloatArray],
    table: FloatArray,
    label: str,
    *,
    log: bool = False,
    colors: str = COLORS,
) -> None:
    """Draw a table over its bins with a bar of colours; NaN stays empty."""
    from matplotlib.colors import LogNorm

    finite = table[np.isfinite(table)]
    norm = LogNorm(1, max(2.0, float(finite.max()))) if log and len(finite) else None
    mesh = axes.pcolormesh(
        edges[0], edges[1], np.ma.masked_invalid(table.T), cmap=colors, norm=norm, rasterized=True
    )
    for scale, points in ((axes.set_xscale, edges[0]), (axes.set_yscale, edges[1])):
        if is_logarithmic(points):
            scale("log")
    bar = figure.colorbar(mesh, ax=axes, pad=0.02)
    bar.set_label(label, fontsize=TEXT_SIZE, color=INK)
    bar.ax.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=0, which="both")
    bar.outline.set_visible(False)


def _start(height: float = HEIGHT) -> "tuple[Drawing, Axes]":
    figure = new_figure(WIDTH, height)
    return figure, figure.add_subplot()


def _scale(axes: "Axes", x: FloatArray, y: FloatArray | None) -> None:
    """Make axes logarithmic whose values are."""
    if _log(x):
        axes.set_xscale("log")
    if y is not None and _log(y):
        axes.set_yscale("log")


def _log(values: FloatArray) -> bool:
    return is_logarithmic(values[np.isfinite(values)])


def _finish(figure: "Drawing", name: str, caption: str, data: dict[str, Any]) -> Figure:
    return Figure(draw_picture(figure, name), caption, caption, data)


def _plain(values: FloatArray) -> Any:
    """Return nested lists with None for what is not finite."""
    table = values.astype(object)
    table[~np.isfinite(values)] = None
    return table.tolist()


def _shorten(key: str, most: int = 24) -> str:
    """Return the end of a long key: what differs stands there."""
    return key if len(key) <= most else "…" + key[1 - most :]


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
