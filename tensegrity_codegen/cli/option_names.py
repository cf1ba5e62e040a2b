"""Names of the library's Python arguments, as the options that the running verb has for them.

Below the command line, messages name arguments as Python has them: `rtol`, `overwrite=True`. Here these
become --rtol, --overwrite.
"""

import re
import shlex
from collections.abc import Mapping
from typing import Any

from typer.core import TyperCommand

from tensegrity_codegen.system.errors import TensegrityError

_ARGUMENT = re.compile(r"`([a-z_]+)(?:=([^`]*))?`")
_options: dict[str, str] = {}  # of the running verb: argument -> option
_words: list[str] = []  # of the running verb: the whole command


class VerbCommand(TyperCommand):
    """A command that makes its options and its own words known while it runs."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words after the verb."""
        _words[:] = [*str(ctx.command_path).split(), *args]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the verb."""
        _options.clear()
        for item in self.params:
            long_names = [word for word in item.opts if word.startswith("--")]
            if item.name and long_names:
                _options[item.name] = long_names[0]
        return super().invoke(ctx)


def quote_command() -> str:
    """Return the command that runs, quoted for a shell."""
    return shlex.join(_words)


def name_options(value: Any) -> Any:
    """Return a text, or the texts of nested dicts and lists, with options in place of arguments.

    Arguments that the running verb has no option for stay as they are.
    """
    if isinstance(value, str):
        return _ARGUMENT.sub(_name_option, value) if "`" in value else value
    if isinstance(value, Mapping):
        return {key: name_options(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(name_options(item) for item in value) if type(value) in (list, tuple) else value
    return value


def name_options_in_error(error: TensegrityError) -> None:
    """Replace arguments by options in an error's texts; its place may be one, or one and its 'value'."""
    name, quote, rest = error.where.partition(" '")
    error.where = _options.get(name, name) + quote + rest
    error.problem = name_options(error.problem)
    error.allowed = name_options(error.allowed)
    error.hint = name_options(error.hint)


def _name_option(found: re.Match[str]) -> str:
    name, value = found[1], found[2]
    if name not in _options:
        return found[0]
    text = "" if value in (None, "True") else f" {value.strip(chr(34))}"
    return _options[name] + text
