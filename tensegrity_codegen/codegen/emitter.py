"""The interface of emitters: models, their functions with only the arguments that matter, and C bodies."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import casadi as ca

from tensegrity_codegen.codegen.print.lane_printer import PrintedLanes
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.symbolic.model import Frame, ModelArgument, SymbolicModel, count_operations
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Pattern
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.quantities import find_quantity
from tensegrity_codegen.tables.quantities.quantity import Quantity
from tensegrity_codegen.tables.request import ModelRequest


class EmittedModel(Protocol):
    """The description of a model besides its functions, see SymbolicModel."""

    formulation: str
    subject: Any
    name: str
    frame: Frame
    arguments: dict[str, ModelArgument]
    words: dict[str, tuple[str, str]]

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities that can be asked for."""


class WantedFunction(Protocol):
    """One function: its quantity, the arguments that matter to it, its number of operations, its result.

    shape: rows and columns as CasADi has them, where the vectors of a table are columns; pattern: of results
    that are handed out as compressed columns.
    """

    @property
    def quantity(self) -> Quantity:
        """Row of the table of quantities."""

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of the arguments, in the order of C signatures."""

    @property
    def operations(self) -> int:
        """Floating-point operations in one evaluation."""

    @property
    def written_operations(self) -> int:
        """Floating-point operations in its text: those of a loop count once."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the result."""

    @property
    def pattern(self) -> Pattern | None:
        """Compressed columns of a sparse result."""


@dataclass(frozen=True)
class Bodies:
    """C text of functions: a preamble, and the statements of each, by quantity.

    checked: quantities whose statements end by returning whether all results are finite.
    """

    statements: Mapping[str, Sequence[str]]
    preamble: Sequence[str] = ()
    checked: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Emitter:
    """One way of writing C.

    build: the model of a subject, refused where this emitter cannot serve it; is_offered: whether that model
    has a quantity, and something enters it; prune: the functions of some quantities; write: their bodies;
    write_lanes: bodies in a number of lanes, of those functions that have one; check: raises FormulationError
    for functions whose bodies would be too long.
    """

    name: str
    build: Callable[[Subject, ModelRequest], Any]
    is_offered: Callable[[Any, str], bool]
    prune: Callable[[Any, tuple[str, ...]], tuple[Any, ...]]
    write: Callable[[Any, tuple[Any, ...], Precision], Bodies]
    write_lanes: Callable[[tuple[Any, ...], int, Precision], Mapping[str, PrintedLanes]] | None = None
    check: Callable[[Any, tuple[Any, ...]], None] = lambda model, functions: None


def result_size(function: WantedFunction) -> int:
    """Return how many values a function writes."""
    pattern = function.pattern
    return function.shape[0] * function.shape[1] if pattern is None else len(pattern.row)


@dataclass(frozen=True)
class PrunedFunction:
    """One wanted quantity: a CasADi function named `<scene>_<quantity>` and the arguments it kept.

    columns: of a quantity over columns how many it has; the function is that of one column, behind what does
    not depend on columns where the quantity has that.
    """

    quantity: Quantity
    function: ca.Function
    arguments: tuple[str, ...]
    columns: int = 0

    @cached_property
    def operations(self) -> int:
        """Number of floating-point operations in one evaluation."""
        return count_operations(self.function)

    @property
    def written_operations(self) -> int:
        """Floating-point operations in its text, which has no loops."""
        return self.operations

    @cached_property
    def coordinate_reach(self) -> int:
        """Number of coordinates, counted from the first, that the result depends on."""
        if "coordinate" not in self.arguments:
            return 0
        pattern = self.function.jac_sparsity(0, self.arguments.index("coordinate"))
        return 1 + max(pattern.get_triplet()[1], default=-1)

    @property
    def sparsity(self) -> ca.Sparsity:
        """Sparsity of the result."""
        return self.function.sparsity_out(0)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the result as CasADi has it: vectors of a table are columns."""
        rows, columns = self.sparsity.shape
        if self.quantity.follows_state:
            return (int(rows) // 2 * (1 + self.columns), 1)
        return (self.columns, int(rows)) if self.columns else (int(rows), int(columns))

    @property
    def pattern(self) -> Pattern | None:
        """Sparsity of a result that is handed out as compressed columns."""
        if not self.quantity.sparse:
            return None
        return Pattern(self.shape, self.sparsity.row(), self.sparsity.colind())


def prune(model: SymbolicModel, quantities: tuple[str, ...]) -> tuple[PrunedFunction, ...]:
    """Return the wanted functions, each with the arguments that its result depends on."""
    return tuple(_prune_one(model, find_quantity(name)) for name in quantities)


def is_offered(model: SymbolicModel, quantity: str) -> bool:
    """Return whether the model has this quantity, and something enters it."""
    try:
        return bool(model.expression(quantity).nnz())
    except FormulationError:
        return False


def refuse_empty(name: str, quantity: str) -> FormulationError:
    """Return the error of a quantity that nothing in the scene `name` enters."""
    return FormulationError(
        f"{quantity} would be empty: nothing in this scene contributes to it",
        where=f"{name}: model.quantities",
        given=quantity,
        hint="remove it from the quantities",
    )


def _prune_one(model: SymbolicModel, quantity: Quantity) -> PrunedFunction:
    expression = ca.cse(model.expression(quantity.name))
    if not quantity.sparse:
        expression = ca.densify(expression)
    if expression.nnz() == 0:
        raise refuse_empty(model.name, quantity.name)
    symbols = model.arguments_of(expression)
    function = ca.Function(
        quantity.name,  # no name of a scene: CasADi allows fewer than C does
        list(symbols.values()),
        [expression],
        list(symbols),
        [quantity.name],
    )
    columns = len(model.frame.column_name) if quantity.over_columns else 0
    return PrunedFunction(quantity, function, tuple(symbols), columns)
