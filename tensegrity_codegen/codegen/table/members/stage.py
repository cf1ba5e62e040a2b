"""Quantities as sequences of stages: the arguments that each reads, how much work it is, its C statements."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import Pattern
from tensegrity_codegen.tables.quantities import ARGUMENTS
from tensegrity_codegen.tables.quantities.quantity import Quantity


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
        """How many times its statements run in one evaluation."""

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


@dataclass(frozen=True)
class Recipe:
    """How a quantity is made: shape as in CasADi, stages, statements before and after, pattern if sparse.

    is_empty: nothing in the structure enters it; is_checked: the stages end by returning whether all results
    are finite.
    """

    shape: tuple[int, int]
    stages: tuple[Stage, ...]
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    find_pattern: Callable[[], Pattern] | None = None
    is_empty: bool = False
    is_checked: bool = False


@dataclass(frozen=True)
class TableFunction:
    """One wanted function, see codegen.emitter.WantedFunction."""

    quantity: Quantity
    recipe: Recipe

    @cached_property
    def arguments(self) -> tuple[str, ...]:
        """Names of the arguments, in the order of C signatures."""
        used = frozenset[str]().union(*(stage.arguments for stage in self.recipe.stages))
        return tuple(name for name in ARGUMENTS if name in used)

    @cached_property
    def operations(self) -> int:
        """Floating-point operations in one evaluation."""
        return sum(stage.operations for stage in self.recipe.stages)

    @cached_property
    def written_operations(self) -> int:
        """Floating-point operations in its text: those of a loop count once."""
        return sum(-(-stage.operations // max(stage.repeats, 1)) for stage in self.recipe.stages)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the result."""
        return self.recipe.shape

    @cached_property
    def pattern(self) -> Pattern | None:
        """Compressed columns of a sparse result."""
        return None if self.recipe.find_pattern is None else self.recipe.find_pattern()

    def write(self, writer: Writer) -> list[str]:
        """Return the statements of the C body."""
        recipe = self.recipe
        before = [in_precision(line, writer) for line in recipe.before]
        lines = [line for stage in recipe.stages for line in stage.write(writer)]
        return [*before, *lines, *recipe.after]
