"""Lines that coincide, drawn as one with all their names; the looks of many named lines on one page."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series, draw_diagram
from tensegrity_codegen.report.pages.page import Figure
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.palette import SEQUENCE

Look = tuple[int, Literal["line", "dashed", "dotted", "dashdot"]]

# Of the height of a diagram: lines that are nowhere further apart cannot be told apart.
INDISTINGUISHABLE_DISTANCE = 0.004
MOST_NAMES = 3
STYLES: tuple[Literal["line", "dashed", "dotted", "dashdot"], ...] = ("line", "dashed", "dotted", "dashdot")


def choose_looks(names: Iterable[str]) -> Mapping[str, Look]:
    """Return number of the colour and style of each name: all colours solid, then dashed, then dotted."""
    order = list(dict.fromkeys(names))
    count = len(SEQUENCE)
    return {name: (k % count, STYLES[k // count % len(STYLES)]) for k, name in enumerate(order)}


def join_series(series: Sequence[Series]) -> tuple[Series, ...]:
    """Return series of which those that coincide are one line, with the look of the first and all names."""
    # The range of all finite values, zero without any.
    values = np.concatenate([np.zeros(0), *(np.ravel(np.asarray(item.y, dtype=float)) for item in series)])
    finite = values[np.isfinite(values)]
    height = float(np.ptp(finite)) if len(finite) else 0.0
    groups: list[list[Series]] = []
    for item in series:
        for group in groups:
            if _coincide(group[0], item, INDISTINGUISHABLE_DISTANCE * height):
                group.append(item)
                break
        else:
            groups.append([item])
    return tuple(replace(group[0], name=join_names([item.name for item in group])) for group in groups)


def join_names(names: Sequence[str], most: int = MOST_NAMES) -> str:
    """Return names in one text: "v1, v2, v3", or "v1, v2 and 4 more"."""
    shown = [name for name in names if name]
    if len(shown) <= most:
        return ", ".join(shown)
    return f"{', '.join(shown[: most - 1])} and {len(shown) - most + 1} more"


def joined_figure(name: str, diagram: Diagram, caption: str, alt: str) -> Figure:
    """Return a diagram as a figure whose coinciding lines are drawn as one; its data has every line."""
    drawn = replace(diagram, series=join_series(diagram.series))
    return Figure(draw_picture(draw_diagram(drawn), name), caption, alt, diagram.as_dict())


def _coincide(one: Series, other: Series, near: float) -> bool:
    """Return whether two lines have the same places and values within `near`."""
    if one.style != other.style and "points" in (one.style, other.style):
        return False
    first, second = (np.asarray(item.y, dtype=float) for item in (one, other))
    places = [np.asarray(item.x, dtype=float) for item in (one, other)]
    if first.shape != second.shape or not np.array_equal(places[0], places[1]):
        return False
    known = np.isfinite(first)
    if not np.array_equal(known, np.isfinite(second)):
        return False
    return bool(np.all(np.abs(first[known] - second[known]) <= near))
