"""The colours of every picture, told apart with any kind of colour vision.

The hues are those of M. Okabe and K. Ito, "Color Universal Design" (2008); tension runs from blue
(compression) over grey (none) to vermilion (tension), so that an unloaded member stays visible on white.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.colors import LinearSegmentedColormap


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
_DIVERGING = ("#07305f", "#1f78b4", "#b4b9be", "#e8772e", "#8c2d04")


def build_tension_colormap() -> "LinearSegmentedColormap":
    """Return the colour map of member tensions, to be used symmetrically about zero."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("member_tension", _DIVERGING)
