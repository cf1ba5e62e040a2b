"""Settings of the documentation site; `make docs` builds it into output/site.

The pages are the Markdown files of this folder. What they take from elsewhere (README, CONTRIBUTING, the
command line, the keys of scene files, the public names) `site_pages` puts in when Sphinx reads them.
"""

import re
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from site_pages.expand import MARK, expand_page  # noqa: E402

from tensegrity_codegen.system.version import VERSION  # noqa: E402

project = "tensegrity_codegen"
release = version = VERSION
language = "en"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "site_pages.mathml"]
html_math_renderer = "mathml"
exclude_patterns = ["site_pages", "notebooks", "pictures", "**/README.txt"]
source_suffix = {".md": "markdown"}
root_doc = "index"
default_role = "literal"
smartquotes = False  # options of commands begin with two hyphens
nitpicky = False  # types of parameters are sentences here, not references

myst_enable_extensions = ["deflist", "dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_typehints = "none"  # numpydoc's Parameters give types with shapes and units
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

html_theme = "furo"
html_title = "tensegrity_codegen"
html_static_path = ["site_pages/static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
highlight_language = "text"
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"


def put_in_what_is_elsewhere(app: Any, page: str, source: list[str]) -> None:
    """Expand the marks of a page, and point its links at pages of the site."""
    source[0] = expand_page(source[0], f"docs/{page}.md")


def read_again(app: Any, environment: Any, added: Any, changed: Any, removed: Any) -> list[str]:
    """Return the pages with marks: what they take from elsewhere may have changed."""
    return [page for page in environment.found_docs if MARK.search((HERE / f"{page}.md").read_text("utf-8"))]


NUMBER = re.compile(r"(?<![\w#/.-])\d[\d.]*e[-+]\d+(?![^<]*>)")  # with a power of ten, outside of tags


def keep_numbers_whole(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Keep a browser from breaking powers of ten at their sign."""
    if "body" in context:
        context["body"] = NUMBER.sub('<span class="whole">\\g<0></span>', context["body"])


def setup(app: Any) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("source-read", put_in_what_is_elsewhere)
    app.connect("env-get-outdated", read_again)
    app.connect("html-page-context", keep_numbers_whole)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
