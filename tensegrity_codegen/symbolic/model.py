"""A formulation's expressions of one structure, each built when first asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from tensegrity_codegen.errors import FormulationError, suggest
from tensegrity_codegen.quantities import find_quantity
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments

__all__ = ["SymbolicModel"]


class SymbolicModel:
    """Named expressions over shared run-time symbols.

    builders: quantity name -> function without arguments that returns its SX, in the quantity's shape
    transposed where it is a table of vectors, so that CasADi's columns are the rows of a C array.
    """

    def __init__(
        self,
        formulation: str,
        structure: Structure,
        arguments: SymbolicArguments,
        builders: Mapping[str, Callable[[], Any]],
    ) -> None:
        self.formulation = formulation
        self.structure = structure
        self.arguments = arguments
        self._builders = builders
        self._built: dict[str, ca.SX] = {}

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities that the formulation offers."""
        return tuple(self._builders)

    def expression(self, quantity: str) -> ca.SX:
        """Return the expression of `quantity`.

        Raises UnknownNameError for a word that is no quantity, FormulationError for one that this
        formulation does not have.
        """
        find_quantity(quantity)
        if quantity not in self._builders:
            raise FormulationError(
                f"formulation {self.formulation!r} has no quantity of that name",
                where="model.quantities",
                given=quantity,
                hint=suggest(quantity, self._builders),
            )
        if quantity not in self._built:
            self._built[quantity] = ca.SX(self._builders[quantity]())
        return self._built[quantity]
