"""Formulas of pages as MathML, which browsers show by themselves: no script, no font, no request."""

from typing import Any

from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

logger = logging.getLogger(__name__)


def setup(app: Any) -> dict[str, bool]:
    """Add the renderer `mathml` to Sphinx."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def visit_inline(translator: Any, node: Any) -> None:
    """Write a formula within a line."""
    _write(translator, node, is_block=False)


def visit_block(translator: Any, node: Any) -> None:
    """Write a formula on lines of its own, which scroll within themselves where they are wide."""
    translator.body.append('<div class="formula">')
    _write(translator, node, is_block=True, end="</div>\n")


def _write(translator: Any, node: Any, *, is_block: bool, end: str = "") -> None:
    from docutils.nodes import SkipNode

    try:
        text = tex2mathml(node.astext(), as_block=is_block)
    except MathError as error:
        logger.warning("formula cannot be shown: %s: %s", error, node.astext(), location=node)
        text = ""
    translator.body.append(text + end)
    raise SkipNode
