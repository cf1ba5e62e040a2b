"""A small picture of a structure, SVG whose colours follow the page from light to dark."""

import numpy as np

from tensegrity_codegen.report.pictures.view import find_box, fit_view
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.outline import outline_bodies

WIDTH, HEIGHT, MARGIN = 320, 240, 18
MOST_WIDTH = {"bar": 5.0, "cable": 2.0}  # of lines, for few members; pixels of the screen, whatever the size
LEAST_WIDTH = {"bar": 2.5, "cable": 2.0}


def write_thumbnail(subject: Subject, name: str) -> str:
    """Return an <svg> of a structure at its stated positions; what is nearer is drawn over what is not."""
    structure = outline_bodies(subject)
    position = structure.node_position
    view = fit_view(structure, find_box(position, structure.axes), position)
    place, depth = view.project(position)
    low, high = place.min(axis=0), place.max(axis=0)
    room = np.array([WIDTH, HEIGHT]) - 2.0 * MARGIN
    scale = float(np.min(room / np.maximum(high - low, 1e-9)))
    place = (place - (low + high) / 2) * (scale, -scale) + (WIDTH / 2, HEIGHT / 2)
    thinner = float(np.clip((40 / max(structure.n_members, 1)) ** 0.4, 0.3, 1.0))
    pair = structure.connectivity
    lines = [
        _write_line(place[pair[e]], "bar" if structure.is_bar[e] else "cable", thinner)
        for e in np.argsort(depth[pair].mean(axis=1), kind="stable")
    ]
    feet = [_write_foot(place[n]) for n in np.flatnonzero(structure.node_anchored.all(axis=1))]
    return (
        f'<svg class="thumbnail" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{name}">'
        f"{''.join(feet)}{''.join(lines)}</svg>"
    )


def _write_line(ends: np.ndarray, kind: str, thinner: float) -> str:
    """Return a member: first a rim in the colour of the page, which parts it from those behind it."""
    (x, y), (u, v) = ends.round(1).tolist()
    width = max(MOST_WIDTH[kind] * thinner, LEAST_WIDTH[kind])
    line = f'x1="{x}" y1="{y}" x2="{u}" y2="{v}"'
    rim = f'<line class="rim" {line} stroke-width="{width + 1.6 * thinner:.1f}"/>'
    return f'{rim}<line class="{kind}" {line} stroke-width="{width:.1f}"/>'


def _write_foot(place: np.ndarray) -> str:
    x, y = place.round(1).tolist()
    return f'<path class="foot" d="M{x} {y}l7 11h-14z"/>'
