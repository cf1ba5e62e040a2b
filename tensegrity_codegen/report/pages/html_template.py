"""Templates of HTML pages: strict, and every word escaped."""

import functools
from collections.abc import Callable

import jinja2

from tensegrity_codegen.codegen.print.render import template_folder


@functools.cache
def html_template(folder: str, name: str, **filters: Callable[[str], object]) -> jinja2.Template:
    """Return the template `name` in `folder`, a folder of templates/, which may use the given filters.

    A name that it uses and nobody gave is an error; values are escaped unless they are Markup.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder() / folder),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(filters)
    return environment.get_template(name)
