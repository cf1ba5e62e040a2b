"""Pictures as text that stands inside a page: SVG where it is small, a PNG in base64 else."""

import base64
import io
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tensegrity_codegen.report.number_text import lower_indices
from tensegrity_codegen.report.pages.theme import use_variables
from tensegrity_codegen.report.pictures.palette import PAPER
from tensegrity_codegen.system.extras import import_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Bytes of SVG above which a picture becomes a PNG.
MOST_SVG = 200_000
# Pixels a CSS inch, and pixels of a PNG for each of them, for screens of high resolution.
CSS_DPI, PNG_SCALE = 96, 2


@dataclass(frozen=True)
class Picture:
    """A picture without anything outside it: exactly one of svg and png (a data URL) is not empty.

    width, height: the size it was drawn for [px of CSS].
    """

    width: int
    height: int
    svg: str = ""
    png: str = ""


def draw_picture(figure: "Figure", name: str, *, most_svg: int = MOST_SVG) -> Picture:
    """Return a figure as a picture; `name` starts every id in it, so that two pictures share a page.

    SVG text stays text and colours of the palette become CSS variables; above most_svg bytes it is a PNG.
    """
    inches = figure.get_size_inches()
    width, height = (round(float(size) * CSS_DPI) for size in inches)
    svg = _inline_svg(_save(figure, "svg"), name)
    if len(svg) <= most_svg:
        return Picture(width, height, svg=svg)
    figure.set_facecolor(PAPER)
    png = base64.b64encode(_save(figure, "png")).decode("ascii")
    return Picture(width, height, png=f"data:image/png;base64,{png}")


def _save(figure: "Figure", kind: str) -> bytes:
    """Return the file of the figure; the same figure gives the same bytes."""
    matplotlib = import_extra("matplotlib")
    buffer = io.BytesIO()
    vector = kind == "svg"
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "page"}):
        figure.savefig(
            buffer,
            format=kind,
            dpi=CSS_DPI * PNG_SCALE,
            facecolor="none" if vector else PAPER,
            metadata={"Date": None, "Creator": None} if vector else None,
        )
    return buffer.getvalue()


def _inline_svg(content: bytes, name: str) -> str:
    """Return the <svg> element alone: no prologue, no fixed size, own ids, theme colours, page fonts."""
    svg = content.decode("utf-8")
    svg = svg[svg.index("<svg") :].strip()
    svg = re.sub(r"\s*<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    head, end, body = svg.partition(">")
    head = re.sub(r'\s(?:width|height|version)="[^"]*"', "", head)
    svg = f'{head} aria-hidden="true"{end}{body}'
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", svg)
    svg = re.sub(r"font: ([\d.]+px) [^;\"]+", r"font: \1 var(--font)", svg)
    svg = re.sub(r"(?<=>)[^<>]+_[^<>]+(?=</text>)", _lower, svg)
    return use_variables(svg)


def _lower(found: re.Match[str]) -> str:
    return lower_indices(found[0], '<tspan baseline-shift="sub" font-size="75%">', "</tspan>")
