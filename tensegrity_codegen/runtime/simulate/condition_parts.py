"""The parts of a condition, built from its syntax tree: functions of the values of its names.

A part computes one number or array from the values at one state; or of many states, where the values have
one more axis behind their own, which the result has too.
"""

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.simulate.condition_text import (
    FUNCTIONS,
    OPERATORS,
    POSITION,
    WHERE,
    shorten_part,
)
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, name_list
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import QUANTITIES

# The names that the entries of a quantity can be asked for by.
ENTRY_NAMES = {"n_members": "member_name", "n_coordinates": "coordinate_name", "n_bar_pairs": "bar_pair_name"}

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Part:
    """A part of a condition: its text, the shape of its value, how to compute it, the parts within it."""

    text: str
    shape: tuple[int, ...]
    evaluate: Callable[[Values], Any]
    parts: "tuple[Part, ...]" = ()
    takes_positions: bool = False

    @property
    def places(self) -> bool:
        """Whether it takes positions of nodes, itself or within."""
        return self.takes_positions or any(part.places for part in self.parts)

    def find_not_finite(self, values: Values) -> "Part":
        """Return the innermost part whose value is not finite; of this one it is known."""
        for part in self.parts:
            if not np.all(np.isfinite(part.evaluate(values))):
                return part.find_not_finite(values)
        return self


def build_part(tree: ast.expr, manifest: Manifest) -> Part:
    """Return a part from a checked syntax tree, for the quantities of a library that has all that it names.

    Raises InvalidValueError for shapes that do not fit, UnknownNameError for entries that are not there.
    """
    return _Translator(manifest).build(build_difference(tree))


def build_difference(node: ast.expr) -> ast.expr:
    """Return what a comparison stands for, positive where it holds; anything else as it is."""
    if not isinstance(node, ast.Compare):
        return node
    pair = (node.comparators[0], node.left)
    more, less = pair if isinstance(node.ops[0], ast.Lt | ast.LtE) else pair[::-1]
    return ast.BinOp(more, ast.Sub(), less)


class _Translator:
    """Turns a syntax tree of allowed parts into functions of the values of names."""

    def __init__(self, manifest: Manifest) -> None:
        self.manifest = manifest
        self.specs: dict[str, FunctionSpec] = {spec.quantity: spec for spec in manifest.functions}

    def build(self, node: ast.AST) -> Part:
        if isinstance(node, ast.Constant):
            number = float(str(node.value))
            return Part(shorten_part(node), (), lambda values: number)
        if isinstance(node, ast.Name):
            shape = () if node.id == "time" else self._shape(node.id)
            return Part(node.id, shape, lambda values: values[node.id], takes_positions=node.id == POSITION)
        if isinstance(node, ast.UnaryOp | ast.BinOp):
            return self._operation(node)
        if isinstance(node, ast.Call):
            return self._call(node)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            return self._entry(node, node.value.id)
        assert isinstance(node, ast.Attribute)
        assert isinstance(node.value, ast.Name)
        return self._place(node, ast.Constant(node.value.id), ast.Constant(node.attr))

    def _shape(self, quantity: str) -> tuple[int, ...]:
        if quantity == POSITION:
            return len(self.manifest.node_name), 3
        return tuple(self.specs[quantity].shape)

    def _operation(self, node: ast.UnaryOp | ast.BinOp) -> Part:
        operate, text = OPERATORS[type(node.op)], shorten_part(node)
        if isinstance(node, ast.UnaryOp):
            inner = self.build(node.operand)
            return Part(text, inner.shape, lambda values: operate(inner.evaluate(values)), (inner,))
        left, right = self.build(node.left), self.build(node.right)
        try:
            shape = np.broadcast_shapes(left.shape, right.shape)
        except ValueError:
            raise InvalidValueError(
                "the two sides have different shapes",
                where=WHERE,
                given=f"{left.text}: {left.shape}, {right.text}: {right.shape}",
                allowed="one shape, or a single number on one side",
            ) from None
        return Part(
            text,
            shape,
            lambda values: operate(np.float64(left.evaluate(values)), right.evaluate(values)),
            (left, right),
        )

    def _call(self, node: ast.Call) -> Part:
        assert isinstance(node.func, ast.Name)
        name, parts = node.func.id, tuple(self.build(part) for part in node.args)
        function, first = FUNCTIONS[name], parts[0]
        if name in ("abs", "sqrt"):
            return Part(
                shorten_part(node), first.shape, lambda values: function(first.evaluate(values)), parts
            )
        return Part(shorten_part(node), (), lambda values: function(_stack(parts, values), axis=0), parts)

    def _entry(self, node: ast.Subscript, quantity: str) -> Part:
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if quantity == POSITION and len(parts) == 2:
            return self._place(node, parts[0], parts[1])
        shape = self._shape(quantity)
        if not 0 < len(parts) <= len(shape):
            raise InvalidValueError(
                "has no such entry", where=WHERE, given=shorten_part(node), allowed=f"shape {shape}"
            )
        index = tuple(
            self._index(part, quantity, self._names(quantity, axis), shape[axis])
            for axis, part in enumerate(parts)
        )
        return Part(
            shorten_part(node),
            shape[len(parts) :],
            lambda values: values[quantity][index],
            takes_positions=quantity == POSITION,
        )

    def _place(self, whole: ast.AST, node: ast.AST, axis: ast.AST) -> Part:
        names = self.manifest.node_name
        row = self._index(node, POSITION, names, len(names))
        column = self._index(axis, POSITION, ("x", "y", "z"), 3)
        return Part(
            shorten_part(whole), (), lambda values: values[POSITION][row, column], takes_positions=True
        )

    def _index(self, node: ast.AST, quantity: str, names: tuple[str, ...], size: int) -> int:
        value = ast.literal_eval(node) if isinstance(node, ast.Constant | ast.UnaryOp) else None
        if isinstance(value, str) and value in names:
            return names.index(value)
        if type(value) is int and -size <= value < size:
            return value
        raise UnknownNameError(
            f"{quantity} has no such entry",
            where=WHERE,
            given=shorten_part(node),
            allowed=name_list(names, 20) or f"0 to {size - 1}",
        )

    def _names(self, quantity: str, axis: int) -> tuple[str, ...]:
        if quantity == POSITION:
            return self.manifest.node_name if axis == 0 else ("x", "y", "z")
        spec: FunctionSpec = self.specs[quantity]
        dimension = QUANTITIES[spec.quantity].shape[axis]
        if dimension == "n_nodes":
            return self.manifest.node_name
        if dimension == "n_axes":
            return tuple("xyz"[k] for k in self.manifest.axes)
        names: tuple[str, ...] = getattr(self.manifest, ENTRY_NAMES.get(dimension, ""), ())
        return names


def _stack(parts: tuple[Part, ...], values: Values) -> NDArray[np.float64]:
    """Return all numbers of all parts along one axis, (n_numbers, ...)."""
    flat = []
    for part in parts:
        value = np.asarray(part.evaluate(values))
        flat.append(value.reshape(-1, *value.shape[len(part.shape) :]))
    behind = np.broadcast_shapes(*(value.shape[1:] for value in flat))
    return np.concatenate([np.broadcast_to(value, (len(value), *behind)) for value in flat])
