"""A condition on a motion, written as an expression over quantities: `member_length["c1"] - 0.5`.

What it may say is in condition_text.py. An event is where its sign changes. One comparison of two such
parts, `top.z < 0.1`, stands for a difference that is positive where it holds. `min`, `max` and `sum` of
several arguments take all numbers of all of them.

Its parts are functions of the values of its names: each computes one number or array from the values at one
state; or of many states, where the values have one more axis behind their own, which the result has too.
"""

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
    name_list,
    suggest,
)
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
    """Return a part from a checked syntax tree, for the quantities of a library that has all of them."""
    return _Translator(manifest).build(build_difference(tree))


def build_difference(node: ast.expr) -> ast.expr:
    """Return the difference of a comparison, positive where it holds; anything else as it is."""
    if not isinstance(node, ast.Compare):
        return node
    pair = (node.comparators[0], node.left)
    larger, smaller = pair if isinstance(node.ops[0], ast.Lt | ast.LtE) else pair[::-1]
    return ast.BinOp(larger, ast.Sub(), smaller)


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
        operate, label = OPERATORS[type(node.op)], shorten_part(node)
        if isinstance(node, ast.UnaryOp):
            inner = self.build(node.operand)
            return Part(label, inner.shape, lambda values: operate(inner.evaluate(values)), (inner,))
        left_side, right_side = self.build(node.left), self.build(node.right)
        try:
            shape = np.broadcast_shapes(left_side.shape, right_side.shape)
        except ValueError:
            raise InvalidValueError(
                "the two sides have different shapes",
                where=WHERE,
                given=f"{left_side.text}: {left_side.shape}, {right_side.text}: {right_side.shape}",
                allowed="one shape, or a single number on one side",
            ) from None
        return Part(
            label,
            shape,
            lambda values: operate(np.float64(left_side.evaluate(values)), right_side.evaluate(values)),
            (left_side, right_side),
        )

    def _call(self, node: ast.Call) -> Part:
        assert isinstance(node.func, ast.Name)
        name, arguments = node.func.id, tuple(self.build(argument) for argument in node.args)
        function, argument_1 = FUNCTIONS[name], arguments[0]
        if name in ("abs", "sqrt"):
            return Part(
                shorten_part(node),
                argument_1.shape,
                lambda values: function(argument_1.evaluate(values)),
                arguments,
            )
        return Part(
            shorten_part(node), (), lambda values: function(_stack(arguments, values), axis=0), arguments
        )

    def _entry(self, node: ast.Subscript, quantity: str) -> Part:
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if quantity == POSITION and len(indices) == 2:
            return self._place(node, indices[0], indices[1])
        shape = self._shape(quantity)
        if not 0 < len(indices) <= len(shape):
            raise InvalidValueError(
                "has no such entry", where=WHERE, given=shorten_part(node), allowed=f"shape {shape}"
            )
        index = tuple(
            self._index(index_node, quantity, self._names(quantity, axis), shape[axis])
            for axis, index_node in enumerate(indices)
        )
        return Part(
            shorten_part(node),
            shape[len(indices) :],
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
            hint=suggest(value, names) if isinstance(value, str) and names else "",
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


def _stack(arguments: tuple[Part, ...], values: Values) -> NDArray[np.float64]:
    """Return all numbers of all parts along one axis, (n_numbers, ...)."""
    flat = []
    for argument in arguments:
        value = np.asarray(argument.evaluate(values))
        flat.append(value.reshape(-1, *value.shape[len(argument.shape) :]))
    extra_shape = np.broadcast_shapes(*(value.shape[1:] for value in flat))
    return np.concatenate([np.broadcast_to(value, (len(value), *extra_shape)) for value in flat])


def find_quantities(text: str) -> tuple[str, ...]:
    """Return the quantities that an expression names; raises what parse_condition raises."""
    nodes = list(ast.walk(parse_condition(text)))
    bases = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    names = {node.id: None for node in nodes if isinstance(node, ast.Name) and id(node) not in bases}
    return tuple(name for name in names if name in QUANTITIES and name not in (*FUNCTIONS, POSITION))


def is_comparison(text: str) -> bool:
    """Return whether an expression is a comparison: of what it stands for only the change to true counts."""
    return isinstance(parse_condition(text), ast.Compare)


@dataclass(frozen=True)
class Expression:
    """An expression over the quantities of a model, a single number."""

    text: str  # as it was written
    quantities: tuple[str, ...]  # that it needs
    model: CompiledModel
    whole: Part

    def evaluate(self, arguments: Mapping[str, Any], time: float = 0.0) -> float:
        """Return the value, maybe not finite, with arguments ("coordinate" among them) at a time [s]."""
        values = self._values(arguments, time)
        with np.errstate(all="ignore"):
            return float(self.whole.evaluate(values))

    def find_not_finite(self, arguments: Mapping[str, Any], time: float = 0.0) -> str:
        """Return the text of the innermost part whose value is not finite."""
        with np.errstate(all="ignore"):
            return self.whole.find_not_finite(self._values(arguments, time)).text

    def _values(self, arguments: Mapping[str, Any], time: float) -> dict[str, Any]:
        values = {name: self.model.compute(name, **arguments) for name in self.quantities}
        if self.whole.places:
            other_arguments = {
                name: value for name, value in arguments.items() if name not in ("coordinate", "velocity")
            }
            anchors = other_arguments.get("anchor_position")
            values[POSITION] = place_nodes(
                self.model, arguments["coordinate"], anchors, arguments=other_arguments
            )
        return {"time": time, **values}


def build_expression(text: str, model: CompiledModel) -> Expression:
    """Return an expression over the model's quantities; raises as `build_condition`."""
    names = find_quantities(text)
    for name in names:
        if not model.has(name) or model.function(name).spec.pattern is not None:
            raise FormulationError(
                "the model has no such function for a condition",
                where=WHERE,
                given=name,
                hint="build the model with this quantity; sparse matrices cannot be part of a condition",
            )
        if "internal" in model.function(name).spec.arguments:
            raise refuse_ground(
                model.manifest.name, f"{name} in a condition", "use a quantity without friction"
            )
    built = build_part(parse_condition(text), model.manifest)
    if built.shape:
        raise InvalidValueError(
            "the condition is not a single number", where=WHERE, given=f"{text!r}, shape {built.shape}",
            hint='name an entry, as in member_length["c1"] or member_length[0]',
        )  # fmt: skip
    return Expression(text, names, model, built)


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
    NonFiniteError if its value is not finite although coordinates and velocities are.
    """
    expression, constants = build_expression(text, model), dict(arguments or {})

    def condition(time: float, coordinate: NDArray[np.float64], velocity: NDArray[np.float64]) -> float:
        state = {"coordinate": coordinate, "velocity": velocity, **constants}
        state |= schedule(time) if schedule else {}
        value = expression.evaluate(state, time)
        if not np.isfinite(value) and np.isfinite(coordinate).all() and np.isfinite(velocity).all():
            raise NonFiniteError(
                f"the condition is not a finite number at t = {time:.6g} s",
                where=WHERE,
                given=name_part(expression.find_not_finite(state, time), text),
                allowed="a condition that is a finite number along the whole motion",
                hint="avoid division by zero and roots of negative numbers",
            )
        return value

    return condition
