"""What the command line knows of a verb."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from tensegrity_codegen.cli.option_names import VerbCommand

PACKAGE = "tensegrity_codegen.cli.verbs"
# Groups of verbs in `--help`, and the least `order` of each.
GROUPS = {
    "Scenes": 0,
    "Structures at rest": 100,
    "Motions and pictures": 200,
    "Plans and control": 300,
    "Many cases": 400,
    "Libraries in C, other programs": 500,
    "Installation": 600,
    "Comparisons and papers": 700,
}


@dataclass(frozen=True)
class Verb:
    """One verb of the command line; a module of `cli/verbs/` defines one as its `VERB`.

    Attributes
    ----------
    run : Callable
        Does the work. Typer makes the arguments and options from its signature, the help from its docstring.
    order : int
        Place in the list of `--help`; decides the group, see GROUPS.
    name : str
        The word on the command line; empty: the name of `run` with `-` for `_`.
    command : type
        Class of the command, for a verb whose help is computed.
    """

    run: Callable[..., Any]
    order: int
    name: str = ""
    command: type[VerbCommand] = VerbCommand

    @property
    def word(self) -> str:
        """The word on the command line."""
        return self.name or self.run.__name__.replace("_", "-")

    @property
    def group(self) -> str:
        """The heading in `--help` under which the verb stands."""
        return [name for name, least in GROUPS.items() if least <= self.order][-1]


def find_verbs() -> list[Verb]:
    """Return the verbs of all modules of `cli/verbs/`, in their order."""
    return sorted(map(_read_verb, _list_modules()), key=lambda verb: verb.order)


def find_verb(word: str) -> Verb | None:
    """Return the verb of that word, None if there is none.

    Only its own module is imported where the module has the verb's name.
    """
    module = word.replace("-", "_")
    if module in _list_modules() and (verb := _read_verb(module)).word == word:
        return verb
    return next((verb for verb in find_verbs() if verb.word == word), None)


def _list_modules() -> list[str]:
    return [item.name for item in iter_modules(import_module(PACKAGE).__path__)]


def _read_verb(module: str) -> Verb:
    found = import_module(f"{PACKAGE}.{module}").VERB
    assert isinstance(found, Verb)
    return found
