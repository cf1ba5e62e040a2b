"""Scalars of a structure as C text: numbers, entries of arguments, or what is worked out before."""

from collections.abc import Sequence
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.print.printer import print_body, print_number
from tensegrity_codegen.symbolic.arguments import SymbolicArguments

Scalar = Any


class GivenValues:
    """Text of values of `arguments`; the C array `given` takes those that have to be worked out.

    kept: the arguments that the function takes. Its result does not depend on the others; where they stand
    beside what it needs, in another component of a node, they are one.
    """

    def __init__(self, arguments: SymbolicArguments, kept: Sequence[str]) -> None:
        self.symbols = {name: arguments.symbols[name] for name in kept}
        self._others = [symbol for name, symbol in arguments.symbols.items() if name not in kept]
        self._place = {
            symbol[k].element_hash(): (name, k)
            for name, symbol in self.symbols.items()
            for k in range(symbol.numel())
        }
        self._given: list[Scalar] = []
        self._index: dict[int, int] = {}

    def place(self, value: Scalar) -> tuple[str, int] | None:
        """Return argument and index of a value that is an entry of an argument."""
        return self._place.get(value.element_hash()) if value.is_symbolic() else None

    def text(self, value: Scalar) -> str:
        """Return the C text of a scalar."""
        found = self.place(value)
        if found is not None:
            return f"{found[0]}[{found[1]}]"
        ones = [ca.SX.ones(other.shape) for other in self._others]
        (value,) = ca.substitute([value], self._others, ones) if self._others else (value,)
        if value.is_constant():
            return print_number(float(value))
        key = value.element_hash()
        if key not in self._index:
            self._index[key] = len(self._given)
            self._given.append(value)
        return f"given[{self._index[key]}]"

    def four(self, values: Sequence[Scalar]) -> str:
        """Return the C text of one value of each of four members, loaded at once where they lie in a row."""
        places = [self.place(value) for value in values]
        first = places[0]
        if first is not None and places == [(first[0], first[1] + k) for k in range(4)]:
            return f"four_load({first[0]} + {first[1]})"
        return f"four_of({', '.join(self.text(value) for value in values)})"

    def lines(self) -> list[str]:
        """Return the statements that work out `given`; to be called when all texts are made."""
        if not self._given:
            return []
        names = list(self.symbols)
        function = ca.Function("given", [self.symbols[name] for name in names], [ca.vertcat(*self._given)])
        body = print_body(function, names, ["given"]).lines
        return [f"double given[{len(self._given)}];", "{", *[f"  {line}" for line in body], "}"]
