"""A stage of plain statements."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer


@dataclass(frozen=True)
class Statements:
    """Statements that need no table; @REAL@, @ZERO@, @ONE@, @SAFE@ stand for what the precision calls so."""

    find: Callable[[], Sequence[str]]
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
        return [in_precision(line, writer) for line in self.find()]


def in_precision(line: str, writer: Writer) -> str:
    """Return a statement with the type and the numbers of the precision."""
    words = {"@REAL@": writer.real, "@ZERO@": writer.number(0.0), "@ONE@": writer.number(1.0)}
    words["@SAFE@"] = writer.number(1e-8 * writer.precision.largest)
    for word, text in words.items():
        line = line.replace(word, text)
    return line
