"""A condition on a motion, written as an expression over quantities: `member_length["c1"] - 0.5`.

What it may say is in condition_text.py. An event is where its sign changes. One comparison of two such
parts, `top.z < 0.1`, stands for a difference that is positive where it holds. `min`, `max` and `sum` of
several arguments take all numbers of all of them.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import FormulationError, InvalidValueError, NonFiniteError, UnknownNameError
from tensegrity_codegen.manifest import FunctionSpec
from tensegrity_codegen.quantities import QUANTITIES
from tensegrity_codegen.runtime.integrate.event_log import Condition
from tensegrity_codegen.runtime.integrate.motion import Schedule
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.simulate.condition_text import (
    FUNCTIONS,
    OPERATORS,
    POSITION,
    WHERE,
    name_part,
    parse_condition,
    shorten_part,
)

__all__ = ["Expression", "build_condition", "build_expression", "find_quantities", "is_comparison"]

# The names that the entries of a quantity can be asked for by.
NAMED = {"n_members": "member_name", "n_coordinates": "coordinate_name", "n_bar_pairs": "bar_pair_name"}

Values = Mapping[str, Any]


@dataclass(frozen=True)
class _Part:
    """A part of a condition: its text, the shape of its value, how to compute it, the parts within it."""

    text: str
    shape: tuple[int, ...]
    evaluate: Callable[[Values], Any]
    parts: tuple[_Part, ...] = ()

    def find_not_finite(self, values: Values) -> _Part:
        """Return the innermost part whose value is not finite; of this one it is known."""
        for part in self.parts:
            if not np.all(np.isfinite(part.evaluate(values))):
                return part.find_not_finite(values)
        return self


def find_quantities(text: str) -> tuple[str, ...]:
    """Return the quantities that an expression names; raises what parse_condition raises."""
    nodes = list(ast.walk(parse_condition(text)))
    own = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    names = {node.id: None for node in nodes if isinstance(node, ast.Name) and id(node) not in own}
    return tuple(name for name in names if name in QUANTITIES and name not in (*FUNCTIONS, POSITION))


def is_comparison(text: str) -> bool:
    """Return whether an expression is a comparison: of what it stands for only the change to true counts."""
    return isinstance(parse_condition(text), ast.Compare)


@dataclass(frozen=True)
class Expression:
    """An expression over the quantities of a model, a single number.

    Attributes
    ----------
    text : str
        As it was written.
    quantities : tuple of str
        Names of the quantities that it needs.
    """

    text: str
    quantities: tuple[str, ...]
    model: CompiledModel
    whole: _Part
    places: bool

    def evaluate(self, arguments: Mapping[str, Any], time: float = 0.0) -> float:
        """Return the value, which may be not finite.

        Parameters
        ----------
        arguments : mapping
            All run-time arguments that differ from the scene, "coordinate" among them.
        time : float
            The time [s].

        Returns
        -------
        float
            The value.
        """
        values = self._values(arguments, time)
        with np.errstate(all="ignore"):
            return float(self.whole.evaluate(values))

    def find_not_finite(self, arguments: Mapping[str, Any], time: float = 0.0) -> str:
        """Return the text of the innermost part whose value is not finite."""
        with np.errstate(all="ignore"):
            return self.whole.find_not_finite(self._values(arguments, time)).text

    def _values(self, arguments: Mapping[str, Any], time: float) -> dict[str, Any]:
        values = {name: self.model.compute(name, **arguments) for name in self.quantities}
        if self.places:
            rest = {
                name: value for name, value in arguments.items() if name not in ("coordinate", "velocity")
            }
            anchors = rest.get("anchor_position")
            values[POSITION] = place_nodes(self.model, arguments["coordinate"], anchors, arguments=rest)
        return {"time": time, **values}


def build_expression(text: str, model: CompiledModel) -> Expression:
    """Return an expression over the model's quantities; raises as `build_condition`."""
    wanted = find_quantities(text)
    for name in wanted:
        if not model.has(name) or model.function(name).spec.pattern is not None:
            raise FormulationError(
                "the model has no such function for a condition",
                where=WHERE,
                given=name,
                hint="build the model with this quantity; sparse matrices cannot be part of a condition",
            )
    translator = _Translator(model)
    whole = translator.build(_difference(parse_condition(text)))
    if whole.shape:
        raise InvalidValueError(
            "the condition is not a single number", where=WHERE, given=f"{text!r}, shape {whole.shape}",
            hint='name an entry, as in member_length["c1"] or member_length[0]',
        )  # fmt: skip
    return Expression(text, wanted, model, whole, translator.places)


def build_condition(
    text: str,
    model: CompiledModel,
    arguments: Mapping[str, Any] | None = None,
    schedule: Schedule | None = None,
) -> Condition:
    """Return (time, coordinate, velocity) -> the value of an expression over the model's quantities.

    schedule: arguments that change with time.
    Raises InvalidValueError for what is no such expression or is no single number, UnknownNameError for
    unknown names, FormulationError for quantities that the model lacks. The function returned raises
    NonFiniteError where its value is not finite although coordinates and velocities are.
    """
    expression, given = build_expression(text, model), dict(arguments or {})

    def condition(time: float, coordinate: NDArray[np.float64], velocity: NDArray[np.float64]) -> float:
        state = {"coordinate": coordinate, "velocity": velocity, **given}
        state |= schedule(time) if schedule else {}
        value = expression.evaluate(state, time)
        if not np.isfinite(value) and np.isfinite(coordinate).all() and np.isfinite(velocity).all():
            raise _not_finite(text, expression.find_not_finite(state, time), time)
        return value

    return condition


def _not_finite(text: str, part: str, time: float) -> NonFiniteError:
    return NonFiniteError(
        f"the condition is not a finite number at t = {time:.6g} s",
        where=WHERE,
        given=name_part(part, text),
        allowed="a condition that is a finite number along the whole motion",
        hint="avoid division by zero and roots of negative numbers",
    )


def _difference(node: ast.expr) -> ast.expr:
    """Return what a comparison stands for, anything else as it is."""
    if not isinstance(node, ast.Compare):
        return node
    pair = (node.comparators[0], node.left)
    more, less = pair if isinstance(node.ops[0], ast.Lt | ast.LtE) else pair[::-1]
    return ast.BinOp(more, ast.Sub(), less)


class _Translator:
    """Turns a syntax tree of allowed parts into functions of the values of names."""

    def __init__(self, model: CompiledModel) -> None:
        self.model = model
        self.places = False  # whether positions of nodes are asked for

    def build(self, node: ast.AST) -> _Part:
        if isinstance(node, ast.Constant):
            number = float(str(node.value))
            return _Part(shorten_part(node), (), lambda values: number)
        if isinstance(node, ast.Name):
            return self._name(node.id)
        if isinstance(node, ast.UnaryOp | ast.BinOp):
            return self._operation(node)
        if isinstance(node, ast.Call):
            return self._call(node)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            return self._entry(node, node.value.id)
        assert isinstance(node, ast.Attribute)
        assert isinstance(node.value, ast.Name)
        return self._place(node, ast.Constant(node.value.id), ast.Constant(node.attr))

    def _name(self, name: str) -> _Part:
        self.places = self.places or name == POSITION
        return _Part(name, () if name == "time" else self._shape(name), lambda values: values[name])

    def _shape(self, quantity: str) -> tuple[int, ...]:
        if quantity == POSITION:
            return len(self.model.manifest.node_name), 3
        return tuple(self.model.function(quantity).spec.shape)

    def _operation(self, node: ast.UnaryOp | ast.BinOp) -> _Part:
        operate, text = OPERATORS[type(node.op)], shorten_part(node)
        if isinstance(node, ast.UnaryOp):
            inner = self.build(node.operand)
            return _Part(text, inner.shape, lambda values: operate(inner.evaluate(values)), (inner,))
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
        return _Part(
            text,
            shape,
            lambda values: operate(np.float64(left.evaluate(values)), right.evaluate(values)),
            (left, right),
        )

    def _call(self, node: ast.Call) -> _Part:
        assert isinstance(node.func, ast.Name)
        name, parts = node.func.id, tuple(self.build(part) for part in node.args)
        function, (first, *others) = FUNCTIONS[name], parts
        if name in ("abs", "sqrt"):
            return _Part(
                shorten_part(node), first.shape, lambda values: function(first.evaluate(values)), parts
            )
        if not others:
            return _Part(shorten_part(node), (), lambda values: function(first.evaluate(values)), parts)
        return _Part(
            shorten_part(node),
            (),
            lambda values: function(np.concatenate([np.ravel(part.evaluate(values)) for part in parts])),
            parts,
        )

    def _entry(self, node: ast.Subscript, quantity: str) -> _Part:
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
        self.places = self.places or quantity == POSITION
        return _Part(shorten_part(node), shape[len(parts) :], lambda values: values[quantity][index])

    def _place(self, whole: ast.AST, node: ast.AST, axis: ast.AST) -> _Part:
        names = self.model.manifest.node_name
        row = self._index(node, POSITION, names, len(names))
        column = self._index(axis, POSITION, ("x", "y", "z"), 3)
        self.places = True
        return _Part(shorten_part(whole), (), lambda values: values[POSITION][row, column])

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
            allowed=", ".join(names[:20]) or f"0 to {size - 1}",
        )

    def _names(self, quantity: str, axis: int) -> tuple[str, ...]:
        if quantity == POSITION:
            return self.model.manifest.node_name if axis == 0 else ("x", "y", "z")
        spec: FunctionSpec = self.model.function(quantity).spec
        dimension = QUANTITIES[spec.quantity].shape[axis]
        if dimension == "n_nodes":
            return self.model.manifest.node_name
        if dimension == "n_axes":
            return tuple("xyz"[k] for k in self.model.manifest.axes)
        names: tuple[str, ...] = getattr(self.model.manifest, NAMED.get(dimension, ""), ())
        return names
