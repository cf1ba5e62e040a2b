"""One quantity as a sequence of stages, with the arguments that these read."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from tensegrity_codegen.codegen.table.members.stage import Stage, in_precision
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.tables.manifest import Pattern
from tensegrity_codegen.tables.quantities import ARGUMENTS
from tensegrity_codegen.tables.quantities.quantity import Quantity


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
