"""A condition on a motion, written as an expression over quantities: `member_length["c1"] - 0.5`.

Numbers, `time`, the quantities of a model (with an index or a name in brackets), `node.x` for a place of a
node, + - * / **, and abs, sqrt, min, max, sum; nothing else. An event is where its sign changes. One
comparison of two such parts, `top.z < 0.1`, stands for a difference that is positive where it holds.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import FormulationError, InvalidValueError, UnknownNameError, suggest
from tensegrity_codegen.manifest import FunctionSpec
from tensegrity_codegen.quantities import QUANTITIES
from tensegrity_codegen.runtime.event_log import Condition
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.placement import place_nodes

__all__ = ["build_condition", "find_quantities", "is_comparison"]

WHERE = "condition"
LONGEST = 500  # characters
OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
POSITION = "node_position"  # of all nodes, whether or not the model computes it
GIVEN = ("time", POSITION)
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "min": np.min,
    "max": np.max,
    "sum": np.sum,
}
# The names that the entries of a quantity can be asked for by.
NAMED = {"n_members": "member_name", "n_coordinates": "coordinate_name", "n_bar_pairs": "bar_pair_name"}

Evaluate = Callable[[Mapping[str, Any]], Any]


def find_quantities(text: str) -> tuple[str, ...]:
    """Return the quantities that an expression names; raises InvalidValueError or UnknownNameError."""
    nodes = list(ast.walk(_parse(text)))
    own = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    names = {node.id: None for node in nodes if isinstance(node, ast.Name) and id(node) not in own}
    wanted = tuple(name for name in names if name not in (*FUNCTIONS, *GIVEN))
    for name in wanted:
        if name not in QUANTITIES:
            raise UnknownNameError(
                "unknown quantity", where=WHERE, given=name, hint=suggest(name, [*QUANTITIES, *FUNCTIONS])
            )
    return wanted


def is_comparison(text: str) -> bool:
    """Return whether an expression is a comparison: of what it stands for only the change to true counts."""
    return isinstance(_parse(text).body, ast.Compare)


def build_condition(text: str, model: CompiledModel, arguments: Mapping[str, Any] | None = None) -> Condition:
    """Return (time, coordinate, velocity) -> the value of an expression over the model's quantities.

    Raises InvalidValueError for what is no such expression or is no single number, UnknownNameError for
    unknown names, FormulationError for quantities that the model lacks.
    """
    wanted = find_quantities(text)
    for name in wanted:
        if not model.has(name) or model.function(name).spec.pattern is not None:
            raise FormulationError(
                "the model has no such function for a condition",
                where=WHERE,
                given=name,
                hint="build the model with this quantity; sparse matrices cannot be part of a condition",
            )
    translator, given = _Translator(model), dict(arguments or {})
    evaluate = translator.build(_difference(_parse(text).body))

    def condition(time: float, coordinate: NDArray[np.float64], velocity: NDArray[np.float64]) -> float:
        state = {"coordinate": coordinate, "velocity": velocity, **given}
        values = {name: model.compute(name, **state) for name in wanted}
        if translator.places:
            values[POSITION] = place_nodes(model, coordinate, given.get("anchor_position"), arguments=given)
        with np.errstate(all="ignore"):  # what is not finite ends the run with that status
            return float(evaluate({"time": time, **values}))

    start = {"time": 0.0, **{name: model.compute(name, **given) for name in wanted}}
    if translator.places:
        start[POSITION] = place_nodes(model, model.nominal("coordinate"), arguments=given)
    first = evaluate(start)
    if np.ndim(first) != 0:
        raise InvalidValueError(
            "not a single number", where=WHERE, given=f"{text!r}, shape {np.shape(first)}",
            hint='name an entry, as in member_length["c1"] or member_length[0]',
        )  # fmt: skip
    return condition


def _parse(text: str) -> ast.Expression:
    if len(text) > LONGEST:
        raise InvalidValueError(
            "too long", where=WHERE, given=f"{len(text)} characters", allowed=f"up to {LONGEST}"
        )
    try:
        return ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InvalidValueError("not an expression", where=WHERE, given=text[:200]) from error


def _difference(node: ast.expr) -> ast.expr:
    """Return what a comparison stands for, anything else as it is."""
    if not isinstance(node, ast.Compare) or len(node.ops) != 1 or not isinstance(node.ops[0], COMPARISONS):
        return node
    pair = (node.comparators[0], node.left)
    more, less = pair if isinstance(node.ops[0], ast.Lt | ast.LtE) else pair[::-1]
    return ast.BinOp(more, ast.Sub(), less)


class _Translator:
    """Turns a syntax tree of allowed parts into a function of the values of names."""

    def __init__(self, model: CompiledModel) -> None:
        self.model = model
        self.places = False  # whether positions of nodes are asked for

    def build(self, node: ast.AST) -> Evaluate:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            value = float(node.value)
            return lambda values: value
        if isinstance(node, ast.Name):
            name = node.id
            self.places = self.places or name == POSITION
            return lambda values: values[name]
        if isinstance(node, ast.UnaryOp | ast.BinOp) and type(node.op) in OPERATORS:
            return self._operation(node)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return self._call(node)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            return self._entry(node, node.value.id)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            return self._place(ast.Constant(node.value.id), ast.Constant(node.attr))
        raise InvalidValueError(
            "not allowed in a condition",
            where=WHERE,
            given=ast.unparse(node)[:200],
            allowed=f"numbers, time, quantities, node.x, + - * / **, {', '.join(FUNCTIONS)}, one comparison",
        )

    def _operation(self, node: ast.UnaryOp | ast.BinOp) -> Evaluate:
        operate = OPERATORS[type(node.op)]
        if isinstance(node, ast.UnaryOp):
            inner = self.build(node.operand)
            return lambda values: operate(inner(values))
        left, right = self.build(node.left), self.build(node.right)
        return lambda values: operate(np.float64(left(values)), right(values))

    def _call(self, node: ast.Call) -> Evaluate:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in FUNCTIONS or not node.args:
            raise UnknownNameError(
                "unknown function in a condition", where=WHERE, given=name, hint=suggest(name, FUNCTIONS)
            )
        function, parts = FUNCTIONS[name], [self.build(part) for part in node.args]
        if len(parts) == 1:
            return lambda values: function(parts[0](values))
        return lambda values: function([part(values) for part in parts])

    def _entry(self, node: ast.Subscript, quantity: str) -> Evaluate:
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if quantity == POSITION and len(parts) == 2:
            return self._place(parts[0], parts[1])
        spec = self.model.function(quantity).spec if self.model.has(quantity) else None
        if spec is None or len(parts) > len(spec.shape):
            raise InvalidValueError(
                "has no such entry", where=WHERE, given=ast.unparse(node)[:200],
                allowed="unknown" if spec is None else f"shape {spec.shape}",
            )  # fmt: skip
        index = tuple(
            self._index(part, quantity, self._names(spec, axis), spec.shape[axis])
            for axis, part in enumerate(parts)
        )
        return lambda values: values[quantity][index]

    def _place(self, node: ast.AST, axis: ast.AST) -> Evaluate:
        names = self.model.manifest.node_name
        row = self._index(node, POSITION, names, len(names))
        column = self._index(axis, POSITION, ("x", "y", "z"), 3)
        self.places = True
        return lambda values: values[POSITION][row, column]

    def _index(self, node: ast.AST, quantity: str, names: tuple[str, ...], size: int) -> int:
        value = ast.literal_eval(node) if isinstance(node, ast.Constant | ast.UnaryOp) else None
        if isinstance(value, str) and value in names:
            return names.index(value)
        if type(value) is int and -size <= value < size:
            return value
        raise UnknownNameError(
            f"{quantity} has no such entry",
            where=WHERE,
            given=ast.unparse(node)[:80],
            allowed=", ".join(names[:20]) or f"0 to {size - 1}",
        )

    def _names(self, spec: FunctionSpec, axis: int) -> tuple[str, ...]:
        dimension = QUANTITIES[spec.quantity].shape[axis]
        if dimension == "n_nodes":
            return self.model.manifest.node_name
        if dimension == "n_axes":
            return tuple("xyz"[k] for k in self.model.manifest.axes)
        names: tuple[str, ...] = getattr(self.model.manifest, NAMED.get(dimension, ""), ())
        return names
