"""The option --labels, whose value may be omitted."""

from pathlib import Path
from typing import Any

from tensegrity_codegen.cli.option_names import VerbCommand

OPTION = "--labels"
ALL_LABELS = "nodes,members"
WORDS = ("nodes", "members", "none")


class LabelsCommand(VerbCommand):
    """A command whose --labels without a value means all names, as when it was a flag.

    What follows is the option's value if it is one of its words, or neither an option nor a file.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words after the verb."""
        return super().parse_args(ctx, _complete(args))


def _complete(args: list[str]) -> list[str]:
    """Return the words with the value of --labels written out."""
    words: list[str] = []
    is_option = True
    for k, word in enumerate(args):
        is_option = is_option and word != "--"
        words.append(word)
        if is_option and word == OPTION and not _is_value(args[k + 1 : k + 2]):
            words[-1] = f"{OPTION}={ALL_LABELS}"
    return words


def _is_value(following: list[str]) -> bool:
    """Return whether the next word, if there is one, is meant as the value."""
    if not following or following[0].startswith("-"):
        return False
    word = following[0]
    if {part.strip().lower() for part in word.split(",")} <= {*WORDS, ""}:
        return True
    return not (Path(word).suffix or "/" in word or Path(word).exists())
