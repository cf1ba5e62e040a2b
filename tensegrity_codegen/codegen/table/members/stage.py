"""One piece of a table function: the arguments that it reads, how much work it is, its C statements."""

from collections.abc import Sequence
from typing import Protocol

from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.system.arrays import IntArray


class Stage(Protocol):
    """A step of a function. Arguments and operations are cheap to ask for, tables are made by `write`."""

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""

    @property
    def operations(self) -> int:
        """Floating-point operations in one evaluation."""

    @property
    def repeats(self) -> int:
        """How many times what it writes is done in one evaluation."""

    def write(self, writer: Writer) -> list[str]:
        """Return its statements."""


def loop(
    counter: str, count: int, statements: Sequence[str], before: Sequence[str] | None = None
) -> list[str]:
    """Return a loop over `count` values of a counter of its own.

    before: statements that deal with the first values and leave the counter behind them.
    """
    return [
        "{",
        f"  int {counter}{' = 0' if before else ''};",
        *(f"  {line}" for line in before or ()),
        f"  for ({'' if before else f'{counter} = 0'}; {counter} < {count}; ++{counter}) {{",
        *(f"    {line}" for line in statements),
        "  }",
        "}",
    ]


def only_where(entries: IntArray, text: str, statement: str) -> list[str]:
    """Return a statement for those passes of a loop whose entry, `text` in C, is not negative."""
    is_there = entries >= 0
    if is_there.all():
        return [statement]
    return [f"if ({text} >= 0) {{ {statement} }}"] if is_there.any() else []
