"""Public names of Python, as directives of Sphinx's autodoc."""

import inspect
from collections.abc import Sequence

import tensegrity_codegen


def write_names(names: Sequence[str]) -> str:
    """Return Markdown that documents public names of the package from their docstrings."""
    unknown = [name for name in names if name not in tensegrity_codegen.__all__]
    if unknown:
        raise ValueError(f"no public names of tensegrity_codegen: {', '.join(unknown)}")
    return "\n\n".join(_write_name(name) for name in names)


def _write_name(name: str) -> str:
    found = getattr(tensegrity_codegen, name)
    directive = "autofunction"
    if inspect.isclass(found):
        directive = "autoexception" if issubclass(found, Exception) else "autoclass"
    return f"```{{eval-rst}}\n.. {directive}:: tensegrity_codegen.{name}\n```"
