"""Templates to text: dumb and strict, an unknown word in a template is an error."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jinja2

__all__ = ["render", "template_folder"]


def template_folder() -> Path:
    """Return the folder of the templates: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "templates"
    return installed if installed.is_dir() else package.parent / "templates"


def render(template: str, context: Mapping[str, Any]) -> str:
    """Return the text of `templates/<template>.j2` filled from `context`."""
    return _environment().get_template(f"{template}.j2").render(context)


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # the output is C, not HTML
        keep_trailing_newline=True,
    )
    environment.filters["wrapped"] = _wrapped
    return environment


def _wrapped(values: Iterable[Any]) -> str:
    """Return values as a comma-separated list in lines of a readable length."""
    text = ", ".join(str(value) for value in values)
    return "\n    ".join(textwrap.wrap(text, 104, break_long_words=False, break_on_hyphens=False))
