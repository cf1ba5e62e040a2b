"""All verbs of the command line by their words; modules are imported when they are asked for."""

import inspect
import itertools
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Any

from typer.core import TyperCommand, TyperGroup

from tensegrity_codegen.cli import analysis_verb
from tensegrity_codegen.cli.verb import Verb, build_command

PACKAGE = "tensegrity_codegen.cli.verbs"


def find_verbs() -> list[Verb]:
    """Return the verbs of all modules of `cli/verbs/` and `analyses/`, in their order."""
    verbs = [verb for module in _list_modules() if (verb := _read_verb(module)) is not None]
    return sorted(verbs, key=lambda verb: verb.order)


def find_verb(word: str) -> Verb | None:
    """Return the verb of that word, None if there is none.

    Only its own module is imported where the module has the verb's name.
    """
    module = word.replace("-", "_")
    if module in _list_modules() and (verb := _read_verb(module)) is not None and verb.word == word:
        return verb
    return next((verb for verb in find_verbs() if verb.word == word), None)


def _list_modules() -> list[str]:
    """Return the names of modules with verbs of their own, and of those of analyses."""
    own = [item.name for item in iter_modules(import_module(PACKAGE).__path__)]
    return [*own, *(name for name in analysis_verb.list_modules() if name not in own)]


def _read_verb(module: str) -> Verb | None:
    """Return the verb of a module, None for an analysis without one."""
    if module in analysis_verb.list_modules() and not find_spec(f"{PACKAGE}.{module}"):
        return analysis_verb.read_verb(module)
    verb = import_module(f"{PACKAGE}.{module}").VERB
    assert isinstance(verb, Verb)
    return verb


class Commands(Mapping[str, Any]):
    """The commands of all verbs by name; one is built when it is asked for."""

    def __getitem__(self, word: str) -> Any:
        verb = find_verb(word)
        if verb is None:
            raise KeyError(word)
        return build_command(verb)

    def __iter__(self) -> Iterator[str]:
        return (verb.word for verb in find_verbs())

    def __len__(self) -> int:
        return len(find_verbs())


class VerbGroup(TyperGroup):
    """The command `tensegrity-codegen`, whose commands are the verbs."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = Commands()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the words of all verbs."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the verbs with the first sentence of their help; options would take most of the time."""
        verbs = find_verbs()
        widest = max(len(verb.word) for verb in verbs)
        limit = formatter.width - 6 - widest
        for group, members in itertools.groupby(verbs, key=lambda verb: verb.group):
            with formatter.section(group):
                formatter.write_dl(
                    [(verb.word.ljust(widest), _first_sentence(verb, limit)) for verb in members]
                )


def _first_sentence(verb: Verb, limit: int) -> str:
    help_text = inspect.getdoc(verb.run)
    return TyperCommand(verb.word, help=help_text, rich_markup_mode=None).get_short_help_str(limit)
