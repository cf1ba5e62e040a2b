"""A page as one HTML file that needs nothing else: styles and pictures inside, no script, no address."""

import re

from markupsafe import Markup, escape

from tensegrity_codegen.report.number_text import lower_indices
from tensegrity_codegen.report.pages.html_template import html_template
from tensegrity_codegen.report.pages.page import Page
from tensegrity_codegen.report.pages.table_width import HINT_WIDTHS
from tensegrity_codegen.report.pages.theme import THEME

# A digit and a space that stand before a unit.
UNIT = re.compile(r"([\d⁰¹²³⁴⁵⁶⁷⁸⁹]) (?=(?:%|N|mm|m|s|kg|deg|µs|ms|Hz|J|MPa)(?:\W|$))")

# A power of ten as in 1e-6 m, which a browser would break at its sign.
SHORT = re.compile("[\\d.]+e[-+]\\d+(?:\N{NO-BREAK SPACE}\\w+)?")


def render_page(page: Page) -> str:
    """Return the page as HTML; all its words are escaped, only SVG pictures are taken as they are."""
    words = {"theme": THEME, "hint_widths": HINT_WIDTHS}
    return html_template("pages", "page.html.j2", rich=_enrich).render(page=page, **words)


def _enrich(text: str) -> Markup:
    """Return escaped text with lowered indices, and with numbers and units on one line."""
    tied = UNIT.sub("\\1\N{NO-BREAK SPACE}", str(escape(text)))
    tied = SHORT.sub('<span class="whole">\\g<0></span>', tied)
    tied = tied.replace(" × 10", "\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10")
    return Markup(lower_indices(tied, "<sub>", "</sub>"))
