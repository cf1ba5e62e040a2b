"""How methods look in diagrams: one colour, dash and marker for each, the same on every page.

The colour says which scheme it is, dash and marker whose code runs it and in which variant, so that lines
are told apart without colours too.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal
from zlib import crc32

from numpy.typing import ArrayLike

from tensegrity_codegen.report.pages.diagram import Series
from tensegrity_codegen.report.pictures.palette import SEQUENCE
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

Dash = Literal["line", "dashed", "dotted", "dashdot"]

BLUE, VERMILION, GREEN, VIOLET, BROWN, SLATE = range(6)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "p", "h")


@dataclass(frozen=True)
class MethodStyle:
    """Number of a colour of SEQUENCE, dash, and marker of matplotlib."""

    color: int
    dash: Dash = "line"
    marker: str = "o"

    @property
    def light(self) -> str:
        """The colour on white paper, #rrggbb."""
        return SEQUENCE[self.color]


# Methods of integration, formulations, other programs, ways to evaluate; names without upper case.
METHOD_STYLES: dict[str, MethodStyle] = {
    "auto": MethodStyle(SLATE, "line", "*"),
    "rk4": MethodStyle(BROWN, "line", "v"),
    "rk54": MethodStyle(GREEN, "line", "s"),
    "tsit5": MethodStyle(VIOLET, "line", "D"),
    "rk853": MethodStyle(BLUE, "line", "o"),
    STIFF_INTEGRATOR: MethodStyle(VERMILION, "line", "^"),
    "scipy dop853": MethodStyle(BLUE, "dashed", "P"),
    "scipy rk45": MethodStyle(GREEN, "dashed", "X"),
    "scipy lsoda": MethodStyle(SLATE, "dashed", "h"),
    "scipy radau": MethodStyle(VERMILION, "dashed", "<"),
    "scipy": MethodStyle(SLATE, "dashed", "h"),
    "ours": MethodStyle(BLUE, "line", "o"),
    "cvodes": MethodStyle(VIOLET, "dotted", ">"),
    "idas": MethodStyle(SLATE, "dotted", "<"),
    "mujoco rk4": MethodStyle(BROWN, "dashdot", "v"),
    "mujoco euler": MethodStyle(BROWN, "dotted", "s"),
    "mujoco implicit": MethodStyle(VERMILION, "dashdot", "D"),
    "mujoco implicitfast": MethodStyle(VERMILION, "dotted", "p"),
    "node_position": MethodStyle(BLUE, "line", "o"),
    "node_position by table": MethodStyle(BLUE, "dashed", "X"),
    "node_distance": MethodStyle(GREEN, "line", "^"),
    "rigid_bar": MethodStyle(VERMILION, "line", "s"),
    "rigid_bar all bars": MethodStyle(VERMILION, "dashed", "D"),
    "rigid_bar corrected": MethodStyle(BROWN, "dotted", "v"),
    "bodies": MethodStyle(VIOLET, "line", "D"),
    "unrolled": MethodStyle(BLUE, "line", "o"),
    "lanes": MethodStyle(VERMILION, "line", "s"),
    "table": MethodStyle(GREEN, "line", "^"),
    "casadi c": MethodStyle(SLATE, "dashed", "D"),
    "casadi vm": MethodStyle(SLATE, "dotted", "v"),
    "numpy": MethodStyle(VIOLET, "dashed", "P"),
    "numba": MethodStyle(VIOLET, "dotted", "X"),
    "jax": MethodStyle(BROWN, "dashed", "<"),
    "mujoco": MethodStyle(BROWN, "dotted", ">"),
}
_WORD = re.compile(r"[a-z0-9_]+")


def find_style(name: str) -> MethodStyle:
    """Return how a method looks: that of the longest name of METHOD_STYLES whose words it has, in order.

    What none of them describes has a look that depends on its name alone.
    """
    words = _WORD.findall(name.lower().replace("scipy_", "scipy "))
    fitting = [key for key in METHOD_STYLES if _has(words, _WORD.findall(key))]
    if fitting:
        return METHOD_STYLES[max(fitting, key=lambda key: (len(_WORD.findall(key)), len(key)))]
    number = crc32(name.encode())
    dashes: tuple[Dash, ...] = ("dashed", "dotted", "dashdot")
    return MethodStyle(number % len(SEQUENCE), dashes[number // 7 % 3], MARKERS[number // 31 % len(MARKERS)])


def choose_styles(names: Iterable[str]) -> dict[str, MethodStyle]:
    """Return the looks of methods that one diagram shows: where two are the same, one has another marker.

    The colours are those of `find_style`.
    """
    chosen: dict[str, MethodStyle] = {}
    for name in names:
        style = find_style(name)
        others = set(chosen.values())
        start = MARKERS.index(style.marker)
        for step in range(1, len(MARKERS)):
            if style not in others:
                break
            style = replace(style, marker=MARKERS[(start + step) % len(MARKERS)])
        chosen[name] = style
    return chosen


def method_series(name: str, x: ArrayLike, y: ArrayLike, style: MethodStyle | None = None) -> Series:
    """Return the line of a method for a Diagram; style: of `choose_styles`, else that of its name."""
    style = find_style(name) if style is None else style
    return Series(name, x, y, style.dash, style.color, style.marker)


def _has(words: list[str], wanted: list[str]) -> bool:
    """Return whether words have those wanted, in order, others between them or not."""
    rest = iter(words)
    return all(word in rest for word in wanted)
