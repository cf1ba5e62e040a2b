"""Templates to text: dumb and strict, an unknown word in a template is an error."""

import functools
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.codegen.print.paste import paste, plain_c_folder
from tensegrity_codegen.system.cache_root import check_entry, make_cache_folder
from tensegrity_codegen.system.errors import UnsafeCacheError

if TYPE_CHECKING:
    import jinja2


LINE_LENGTH = 104  # of a list of numbers


def template_folder() -> Path:
    """Return the folder of the templates: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[2]
    installed = package / "templates"
    return installed if installed.is_dir() else package.parent / "templates"


def render(template: str, context: Mapping[str, Any]) -> str:
    """Return the text of `templates/<template>.j2` filled from `context`."""
    return _environment().get_template(f"{template}.j2").render(context)


@functools.cache
def _environment() -> "jinja2.Environment":
    import jinja2  # a library from the cache needs no templates

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # the output is C, not HTML
        keep_trailing_newline=True,
        bytecode_cache=_find_compiled_templates(),
    )
    environment.filters["wrapped"] = wrap_values
    environment.filters["enumerated"] = _enumerate
    environment.filters["quoted"] = _quote
    environment.globals["paste"] = jinja2.pass_context(paste)
    environment.globals["plain_c"] = plain_c_folder(template_folder())
    return environment


def _find_compiled_templates() -> "jinja2.BytecodeCache | None":
    """Return where templates are kept as Python's bytecode: reading them takes longer than filling them."""
    import jinja2

    class CompiledTemplates(jinja2.FileSystemBytecodeCache):
        """Files that are written where they can be: a full disk is no reason to stop."""

        def dump_bytecode(self, bucket: "jinja2.bccache.Bucket") -> None:
            with suppress(OSError):
                super().dump_bytecode(bucket)

    folder = make_cache_folder("templates")
    if folder is None:
        return None
    try:
        check_entry(folder, folder.parent)
    except (OSError, UnsafeCacheError):
        return None
    return CompiledTemplates(str(folder), f"{version('jinja2')}_%s.bytecode")


def wrap_values(values: Iterable[Any]) -> str:
    """Return values as a comma-separated list in lines of a readable length, equally many in each line."""
    texts = list(map(str, values.tolist() if isinstance(values, np.ndarray) else values))
    width = max(map(len, texts), default=0) + len(", ")
    count = max(LINE_LENGTH // width, 1)
    return ",\n    ".join(", ".join(texts[k : k + count]) for k in range(0, len(texts), count))


def _quote(names: Iterable[str]) -> list[str]:
    """Return names, which are identifiers, as C strings."""
    return [f'"{name}"' for name in names]


def _enumerate(names: Iterable[str], prefix: str) -> str:
    """Return the entries of an enumeration that gives each name, after the prefix, its number."""
    return ",\n".join(f"  {prefix}_{name} = {number}" for number, name in enumerate(names))
