"""The text of a condition: read, and checked as far as that goes without a model.

Numbers, `time`, the quantities of a model (with an index or a name in brackets, with or without quotes),
`node.x` for a place of a node, + - * / **, and abs, sqrt, min, max, sum; nothing else. One comparison of two
such parts is allowed.
"""

import ast
import math
import operator
import warnings
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.tables.quantities import QUANTITIES

WHERE = "condition"
MAX_LENGTH = 500  # characters
MAX_DEPTH = 50  # levels of parts within parts
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
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "min": np.min,
    "max": np.max,
    "sum": np.sum,
}
UNARY_FUNCTIONS = ("abs", "sqrt")
ALLOWED = f"numbers, time, quantities, node.x, + - * / **, {', '.join(FUNCTIONS)}, one comparison"


def parse_condition(text: str) -> ast.expr:
    """Return the syntax tree of a condition: a comparison, or an expression without one, checked."""
    if len(text) > MAX_LENGTH:
        raise InvalidValueError(
            "too long", where=WHERE, given=f"{len(text)} characters", allowed=f"up to {MAX_LENGTH}"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's advice on spelling
            body = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InvalidValueError(
            "not a valid expression", where=WHERE, given=text[:200], allowed=ALLOWED
        ) from error
    _check_depth(body)
    body = cast(ast.expr, _QuoteNames().visit(body))
    try:
        for side in _list_compared_parts(body):
            _check_part(side)
    except NonFiniteError as error:
        error.given = name_part(str(error.given), text.strip())
        raise
    return body


def shorten_part(node: ast.AST) -> str:
    """Return the text of a part of a condition, cut to a readable length."""
    return ast.unparse(node)[:80]


def name_part(part: str, text: str) -> str:
    """Return the text of an error: a part of a condition and the whole of it."""
    return text if part == text else f"{part}, in {text}"


class _QuoteNames(ast.NodeTransformer):
    """Names in brackets become texts: member_length[c1] is member_length["c1"]."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.Subscript:
        """Return an entry of a quantity with quoted names."""
        entries = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        quoted = [ast.Constant(entry.id) if isinstance(entry, ast.Name) else entry for entry in entries]
        index: ast.expr = ast.Tuple(quoted, ast.Load()) if isinstance(node.slice, ast.Tuple) else quoted[0]
        return ast.Subscript(node.value, index, node.ctx)


def _list_compared_parts(body: ast.expr) -> tuple[ast.expr, ...]:
    """Return the two sides of a comparison, else the whole expression."""
    if isinstance(body, ast.Compare) and len(body.ops) == 1 and isinstance(body.ops[0], COMPARISONS):
        return body.left, body.comparators[0]
    return (body,)


def _check_depth(body: ast.expr) -> None:
    level: list[ast.AST] = [body]
    for _ in range(MAX_DEPTH):
        level = [child for node in level for child in ast.iter_child_nodes(node)]
        if not level:
            return
    raise InvalidValueError(
        "the condition is nested too deeply",
        where=WHERE,
        allowed=f"up to {MAX_DEPTH} levels",
        hint="simplify it",
    )


def _check_part(node: ast.expr) -> np.float64 | None:
    """Check one part and all within it; return its value if it is constant."""
    value: np.float64 | None = None
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = _to_number(node.value)
    elif isinstance(node, ast.Name):
        _check_name(node.id)
    elif isinstance(node, ast.UnaryOp | ast.BinOp) and type(node.op) in OPERATORS:
        operate = OPERATORS[type(node.op)]
        operands = [node.operand] if isinstance(node, ast.UnaryOp) else [node.left, node.right]
        values = [_check_part(operand) for operand in operands]
        if isinstance(node.op, ast.Div) and values[1] == 0:
            raise NonFiniteError("division by zero", where=WHERE, given=shorten_part(node))
        value = _apply_to_constants(operate, values)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        value = _check_call(node, node.func.id)
    elif isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        _check_quantity_entry(node, node.value.id)
    elif not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)):
        raise _build_error("not allowed in a condition", node, ALLOWED)
    if value is not None and not math.isfinite(value):
        raise NonFiniteError(
            "this part of the condition is not a finite number", where=WHERE, given=shorten_part(node),
            allowed="finite numbers; no division by zero, no root of a negative number",
        )  # fmt: skip
    return value


def _to_number(number: Any) -> np.float64:
    try:
        return np.float64(float(number))
    except OverflowError:  # an integer of hundreds of digits
        return np.float64(math.inf)


def _check_name(name: str) -> None:
    if name in FUNCTIONS:
        raise InvalidValueError(
            f"{name} is a function and needs an argument in parentheses",
            where=WHERE,
            given=name,
            allowed=f"{name}(...), for example {name}(member_length[0])",
        )
    if name not in QUANTITIES and name not in ("time", POSITION):
        valid_names = [*QUANTITIES, *FUNCTIONS, "time"]
        raise UnknownNameError(
            "unknown quantity", where=WHERE, given=name[:80], hint=suggest(name, valid_names)
        )


def _check_call(node: ast.Call, name: str) -> np.float64 | None:
    if name not in FUNCTIONS:
        raise UnknownNameError(
            "unknown function in a condition", where=WHERE, given=name[:80], hint=suggest(name, FUNCTIONS)
        )
    if not node.args or (name in UNARY_FUNCTIONS and len(node.args) > 1):
        count = "one argument" if name in UNARY_FUNCTIONS else "one argument or more"
        raise _build_error(f"{name} takes {count}, not {len(node.args)}", node, f"{name}(...) of {count}")
    function, values = FUNCTIONS[name], [_check_part(argument) for argument in node.args]
    return _apply_to_constants(lambda *numbers: function(numbers if len(numbers) > 1 else numbers[0]), values)


def _apply_to_constants(function: Callable[..., Any], values: list[np.float64 | None]) -> np.float64 | None:
    """Return the value of a part whose parts are constant, else None."""
    if any(value is None for value in values):
        return None
    with np.errstate(all="ignore"):
        return np.float64(function(*values))


def _check_quantity_entry(node: ast.Subscript, quantity: str) -> None:
    if quantity in FUNCTIONS or quantity == "time":
        kind = "a function" if quantity in FUNCTIONS else "a single number"
        raise _build_error(f"{quantity} is {kind} and has no entries", node, "an entry of a quantity")
    _check_name(quantity)
    for entry in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
        inner = entry.operand if isinstance(entry, ast.UnaryOp) and isinstance(entry.op, ast.USub) else entry
        types = (int,) if inner is not entry else (int, str)
        if not isinstance(inner, ast.Constant) or type(inner.value) not in types:
            raise _build_error("not a valid index", entry, 'a name in quotes or a number, as ["c1"] or [0]')


def _build_error(problem: str, node: ast.AST, allowed: str) -> InvalidValueError:
    return InvalidValueError(problem, where=WHERE, given=shorten_part(node), allowed=allowed)
