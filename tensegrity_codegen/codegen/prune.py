"""Only what is wanted: each wanted quantity as a function of just the arguments that matter to it."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.symbolic.operations import count_operations
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Pattern
from tensegrity_codegen.tables.quantities import find_quantity
from tensegrity_codegen.tables.quantities.quantity import Quantity


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
    """Return the wanted functions, each with the arguments that its result depends on.

    Raises FormulationError for a quantity that has no entry at all in this scene.
    """
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
    kept = {
        name: argument.symbol
        for name, argument in model.arguments.items()
        if argument.symbol.numel() and ca.depends_on(expression, argument.symbol)
    }
    function = ca.Function(
        quantity.name,  # no name of a scene: CasADi allows fewer than C does
        list(kept.values()),
        [expression],
        list(kept),
        [quantity.name],
    )
    columns = len(model.frame.column_name) if quantity.over_columns else 0
    return PrunedFunction(quantity, function, tuple(kept), columns)
