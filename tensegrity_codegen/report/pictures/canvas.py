"""Figures that are drawn off screen: Agg canvas, own sizes, no state shared with the caller; their colours.

The hues are those of M. Okabe and K. Ito, "Color Universal Design" (2008); tension runs from blue
(compression) over grey (none) to vermilion (tension), so that an unloaded member stays visible on white.
"""

import io
import textwrap
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.extras import import_extra
from tensegrity_codegen.system.files import replaced

if TYPE_CHECKING:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
    from matplotlib.text import Text


INK = "#1f2933"  # text, and lines that are read first
MUTED = "#5c6670"  # secondary text: axis ticks, notes
GRID = "#d9dee3"  # grid lines, and areas without data
SOIL = "#efe9df"  # the plane of a ground
PAPER = "#ffffff"  # background

BAR = "#33506e"
CABLE = "#d55e00"
SLACK = "#8c949c"  # slack cables
NODE = "#f4f6f8"
UNKNOWN = "#f2e2a0"  # a member whose tension is not known; on no scale of tensions

LOAD = "#b0478a"  # as in live pages
REACTION = "#00805c"
GROUND_FORCE = "#8a5a00"
BODY = "#46586b"  # edges and faces of rigid bodies

# Lines of a diagram, in the order in which they are used: each has a contrast of at least 3 to white paper.
SEQUENCE = ("#0072b2", "#d55e00", "#009e73", "#9a5cf5", "#86301b", "#3e4b60")

# Compression, none, tension.
_DIVERGING = ("#07305f", "#1f78b4", "#8f969e", "#e8772e", "#8c2d04")


def build_tension_colormap() -> "LinearSegmentedColormap":
    """Return the colour map of member tensions, to be used symmetrically about zero."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("member_tension", _DIVERGING)


PICTURE_SUFFIXES = (".png", ".svg", ".pdf")

# Pixels an inch of a PNG picture.
PICTURE_DPI = 150
SCREEN_DPI = 100  # of pictures in notebooks


PROGRAM = "tensegrity_codegen"  # in the metadata of pictures


def check_suffix(path: Path, allowed: Iterable[str], where: str = "") -> str:
    """Return the suffix of `path` in lower case, dot included; raises InvalidValueError if not allowed.

    where: the option that the path is of.
    """
    suffix, allowed_suffixes = path.suffix.lower(), tuple(allowed)
    if suffix not in allowed_suffixes:
        raise InvalidValueError(
            f"unknown kind of file {suffix!r}" if suffix else "the file name has no suffix",
            where=where or str(path),
            given=str(path) if where else path.name,
            allowed="a name that ends in " + ", ".join(allowed_suffixes),
            hint=f"{path.stem}{allowed_suffixes[0]}" if path.stem else "",
        )
    return suffix


def new_figure(width: float, height: float, dpi: float = PICTURE_DPI, *, compress: bool = False) -> "Figure":
    """Return an empty white figure of width x height [in] on an Agg canvas, laid out by constraints.

    compress: what stands beside axes of equal scales keeps close to them.
    """
    import_extra("matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08, compress=compress)
    figure = _figure_class()(figsize=(width, height), dpi=dpi, facecolor=PAPER, layout=engine)
    FigureCanvasAgg(figure)
    return figure


@cache
def _figure_class() -> "type[Figure]":
    """Return the class of figures that show themselves in notebooks, without pyplot and its global state."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure with a PNG picture of itself for notebooks."""

        def _repr_png_(self) -> bytes:
            data = io.BytesIO()
            self.savefig(data, format="png", dpi=SCREEN_DPI)
            return data.getvalue()

    return NotebookFigure


def save_figure(figure: "Figure", path: Path, *, overwrite: bool) -> None:
    """Write the figure, whole or not at all, in the format of the path's suffix."""
    kind = path.suffix.lower().removeprefix(".")
    # Without the date, and with a fixed salt for the names in it, the same picture has the same bytes.
    known: dict[str, dict[str, str | None]] = {
        "png": {"Software": PROGRAM},
        "svg": {"Creator": PROGRAM, "Date": None},
        "pdf": {"Creator": PROGRAM, "CreationDate": None},
    }
    metadata = known.get(kind, {})
    from matplotlib import rc_context

    with replaced(path, overwrite=overwrite) as temporary, rc_context({"svg.hashsalt": PROGRAM}):
        figure.savefig(temporary, format=kind, dpi=figure.dpi, facecolor=PAPER, metadata=metadata)


# Inches: left margin, base lines below the upper edge, and the height of all.
LEFT, TITLE_LINE, FACTS_LINE, HEIGHT = 0.22, 0.32, 0.55, 0.66
TITLE_SIZE, FACTS_SIZE = 13.0, 9.0
# Characters of a bold title or of the facts that fit into an inch, on the safe side.
TITLE_LETTERS, FACTS_LETTERS = 7.5, 13.0


def add_heading(figure: "Figure", title: str, facts: str) -> None:
    """Write `title` and below it `facts`, cut to the width of the figure, and keep the panels below them."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    width, height = figure.get_size_inches()
    rows = (
        (title, TITLE_LINE, TITLE_SIZE, TITLE_LETTERS, "bold", INK),
        (facts, FACTS_LINE, FACTS_SIZE, FACTS_LETTERS, "normal", MUTED),
    )
    for text, line, size, letters, weight, color in rows:
        short = textwrap.shorten(text, width=int((width - 2 * LEFT) * letters), placeholder=" …")
        row = figure.text(
            LEFT / width, 1 - line / height, short, fontsize=size, fontweight=weight, color=color,
            va="baseline",
        )  # fmt: skip
        row.set_parse_math(False)
        row.set_in_layout(False)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, 0.0, 1.0, 1 - HEIGHT / height))


def add_clock(figure: "Figure") -> "Text":
    """Return an empty text at the right end of the title line."""
    width, height = figure.get_size_inches()
    clock = figure.text(
        1 - LEFT / width, 1 - TITLE_LINE / height, "", ha="right", va="baseline", fontsize=11, color=INK
    )
    clock.set_in_layout(False)
    return clock
