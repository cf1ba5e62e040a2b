"""All verbs as one command; each is imported and built when it is needed."""

import functools
import inspect
import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from tensegrity_codegen.cli.verb import Verb, find_verb, find_verbs


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


@functools.cache
def build_command(verb: Verb) -> Any:
    """Return the command of a verb, with its options."""
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    alone.command(verb.word, cls=verb.command)(verb.run)
    return typer.main.get_command(alone)


def _first_sentence(verb: Verb, limit: int) -> str:
    help_text = inspect.getdoc(verb.run)
    return TyperCommand(verb.word, help=help_text, rich_markup_mode=None).get_short_help_str(limit)
