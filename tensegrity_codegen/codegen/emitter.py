"""The interface of emitters: models, their functions with only what matters, and C bodies for these."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from tensegrity_codegen.codegen.print.lane_printer import PrintedLanes
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.symbolic.model import Frame, ModelArgument
from tensegrity_codegen.tables.manifest import Pattern
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.quantities.quantity import Quantity
from tensegrity_codegen.tables.request import ModelRequest


class EmittedModel(Protocol):
    """What is said of a model besides its functions, see SymbolicModel."""

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
    """One function: its quantity, the arguments that matter to it, how much work it is, what it returns.

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
    """C text of functions: what stands before them all, and the statements of each, by quantity.

    checked: quantities whose statements end by returning whether all results are finite; checked_by_sums:
    those that return non-zero only where all arguments and results are finite, and may return zero then too.
    """

    statements: Mapping[str, Sequence[str]]
    preamble: Sequence[str] = ()
    checked: frozenset[str] = frozenset()
    checked_by_sums: frozenset[str] = frozenset()


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
