"""Only what is wanted: each wanted quantity as a function of just the arguments that matter to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.quantities import Quantity, find_quantity
from tensegrity_codegen.symbolic.model import SymbolicModel

__all__ = ["PrunedFunction", "prune"]


@dataclass(frozen=True)
class PrunedFunction:
    """One wanted quantity: a CasADi function named `<scene>_<quantity>` and the arguments it kept."""

    quantity: Quantity
    function: ca.Function
    arguments: tuple[str, ...]

    @cached_property
    def operations(self) -> int:
        """Number of floating-point operations in one evaluation."""
        codes = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
        return sum(
            self.function.instruction_id(k) not in codes for k in range(self.function.n_instructions())
        )

    @property
    def sparsity(self) -> ca.Sparsity:
        """Sparsity of the result."""
        return self.function.sparsity_out(0)


def prune(model: SymbolicModel, quantities: tuple[str, ...]) -> tuple[PrunedFunction, ...]:
    """Return the wanted functions, each with the arguments that its result depends on.

    Raises FormulationError for a quantity that has no entry at all in this scene.
    """
    return tuple(_prune_one(model, find_quantity(name)) for name in quantities)


def _prune_one(model: SymbolicModel, quantity: Quantity) -> PrunedFunction:
    expression = ca.cse(model.expression(quantity.name))
    if not quantity.sparse:
        expression = ca.densify(expression)
    if expression.nnz() == 0:
        raise FormulationError(
            f"{quantity.name} is empty: nothing in this scene enters it",
            where=f"{model.name}: model.quantities",
            given=quantity.name,
            hint="take it off the list of wanted quantities",
        )
    kept = {
        name: argument.symbol
        for name, argument in model.arguments.items()
        if argument.symbol.numel() and ca.depends_on(expression, argument.symbol)
    }
    function = ca.Function(
        f"{model.name}_{quantity.name}",
        list(kept.values()),
        [expression],
        list(kept),
        [quantity.name],
    )
    return PrunedFunction(quantity, function, tuple(kept))
