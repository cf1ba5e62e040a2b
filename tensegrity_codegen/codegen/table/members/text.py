"""The stage of a table function that is a fixed list of C statements, without a table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer


@dataclass(frozen=True)
class Statements:
    """C statements that need no table, in text with placeholders, see `in_precision`.

    list_lines: returns them, called when the function is written; arguments, operations, repeats: see
    `Stage`.
    """

    list_lines: Callable[[], Sequence[str]]
    arguments: frozenset[str] = frozenset()
    operations: int = 0
    repeats: int = 1

    @classmethod
    def loop(
        cls, counter: str, count: int, lines: Sequence[str], arguments: tuple[str, ...] = ()
    ) -> "Statements":
        """Return a loop over `count` values of a counter."""
        return cls(lambda: loop(counter, count, lines), frozenset(arguments))

    def write(self, writer: Writer) -> list[str]:
        """Return the statements."""
        return [in_precision(line, writer) for line in self.list_lines()]


def in_precision(line: str, writer: Writer) -> str:
    """Return a statement with its placeholders replaced.

    @REAL@: the type in C; @ZERO@, @ONE@: these numbers; @SAFE@: a bound of sums, far from overflow.
    """
    replacements = {"@REAL@": writer.real, "@ZERO@": writer.number(0.0), "@ONE@": writer.number(1.0)}
    replacements["@SAFE@"] = writer.number(1e-8 * writer.precision.largest)
    for placeholder, text in replacements.items():
        line = line.replace(placeholder, text)
    return line
