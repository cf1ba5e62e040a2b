"""A condition on a motion, written as an expression over quantities: `member_length["c1"] - 0.5`.

Numbers, `time`, the quantities of a model (with an index or a name in brackets), + - * / **, and abs, sqrt,
min, max, sum; nothing else. An event is where its sign changes.
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

__all__ = ["build_condition", "find_quantities"]

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
    names = {node.id: None for node in ast.walk(_parse(text)) if isinstance(node, ast.Name)}
    wanted = tuple(name for name in names if name not in FUNCTIONS and name != "time")
    for name in wanted:
        if name not in QUANTITIES:
            raise UnknownNameError(
                "unknown quantity", where=WHERE, given=name, hint=suggest(name, [*QUANTITIES, *FUNCTIONS])
            )
    return wanted


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
    evaluate, given = _Translator(model).build(_parse(text).body), dict(arguments or {})

    def condition(time: float, coordinate: NDArray[np.float64], velocity: NDArray[np.float64]) -> float:
        state = {"coordinate": coordinate, "velocity": velocity, **given}
        values = {name: model.compute(name, **state) for name in wanted}
        with np.errstate(all="ignore"):  # what is not finite ends the run with that status
            return float(evaluate({"time": time, **values}))

    first = evaluate({"time": 0.0, **{name: model.compute(name, **given) for name in wanted}})
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


class _Translator:
    """Turns a syntax tree of allowed parts into a function of the values of names."""

    def __init__(self, model: CompiledModel) -> None:
        self.model = model

    def build(self, node: ast.AST) -> Evaluate:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            value = float(node.value)
            return lambda values: value
        if isinstance(node, ast.Name):
            name = node.id
            return lambda values: values[name]
        if isinstance(node, ast.UnaryOp | ast.BinOp) and type(node.op) in OPERATORS:
            return self._operation(node)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return self._call(node)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            return self._entry(node, node.value.id)
        raise InvalidValueError(
            "not allowed in a condition",
            where=WHERE,
            given=ast.unparse(node)[:200],
            allowed=f"numbers, time, quantities, + - * / **, {', '.join(FUNCTIONS)}",
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
        spec = self.model.function(quantity).spec if self.model.has(quantity) else None
        if spec is None or len(parts) > len(spec.shape):
            raise InvalidValueError(
                "has no such entry", where=WHERE, given=ast.unparse(node)[:200],
                allowed="unknown" if spec is None else f"shape {spec.shape}",
            )  # fmt: skip
        index = tuple(self._index(part, spec, axis) for axis, part in enumerate(parts))
        return lambda values: values[quantity][index]

    def _index(self, node: ast.AST, spec: FunctionSpec, axis: int) -> int:
        value = ast.literal_eval(node) if isinstance(node, ast.Constant | ast.UnaryOp) else None
        names = self._names(spec, axis)
        if isinstance(value, str) and value in names:
            return names.index(value)
        if type(value) is int and -spec.shape[axis] <= value < spec.shape[axis]:
            return value
        raise UnknownNameError(
            f"{spec.quantity} has no such entry",
            where=WHERE,
            given=ast.unparse(node)[:80],
            allowed=", ".join(names[:20]) or f"0 to {spec.shape[axis] - 1}",
        )

    def _names(self, spec: FunctionSpec, axis: int) -> tuple[str, ...]:
        dimension = QUANTITIES[spec.quantity].shape[axis]
        if dimension == "n_nodes":
            return self.model.manifest.node_name
        if dimension == "n_axes":
            return tuple("xyz"[k] for k in self.model.manifest.axes)
        names: tuple[str, ...] = getattr(self.model.manifest, NAMED.get(dimension, ""), ())
        return names
