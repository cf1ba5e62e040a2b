"""The text of a target: `twist=165`, `tilt=10,0deg`, `rotation("t6_*")=20,0,0`, `member_length["c1"]=0.2`."""

import ast
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from tensegrity_codegen.runtime.simulate.condition_text import FUNCTIONS, POSITION
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.tables.quantities import QUANTITIES

REST_LENGTH = re.compile(r"\s*rest_length\s*[(\[]\s*([\"']?)(\w+)\1\s*[)\]]\s*")
VALUE = re.compile(r"\s*([-+0-9.eE,\s]+?)\s*(deg|rad|mm|cm|m|N)?\s*")
ANGLES = {"": 1.0, "deg": 1.0, "rad": 180 / math.pi}
LENGTHS = {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3}


@dataclass(frozen=True)
class ShapeKind:
    """One function of targets: its unit, the sets of nodes or the names that it takes, its components."""

    unit: str
    takes: str
    components: tuple[str, ...] = ("",)
    is_vector: bool = False


SHAPES: Mapping[str, ShapeKind] = {
    "height": ShapeKind("m", "rings"),
    "twist": ShapeKind("deg", "rings"),
    "tilt": ShapeKind("deg", "rings", ("towards", "sideways")),
    "rotation": ShapeKind("deg", "body", ("x", "y", "z"), True),
    "centre_of_mass": ShapeKind("m", "nothing", ("x", "y", "z"), True),
    "past_edge": ShapeKind("m", "edge"),
}


@dataclass(frozen=True)
class TargetText:
    """A target as it was written: the expression, its numbers and their unit ("" for none)."""

    text: str
    values: tuple[float, ...]
    unit: str

    @property
    def where(self) -> str:
        """The name of the target in errors."""
        return f"target {self.text}"


@dataclass(frozen=True)
class ShapeCall:
    """A call of a shape parameter: its name, lists of names, and the component asked for, or ""."""

    name: str
    arguments: tuple[tuple[str, ...], ...]
    component: str


def read_targets(
    targets: Mapping[str, float | Sequence[float]] | Sequence[str] | str,
) -> tuple[TargetText, ...]:
    """Return targets that are given as texts `TARGET=VALUE` or as a mapping of target to value."""
    if isinstance(targets, str):
        targets = [targets]
    if not isinstance(targets, Iterable) or getattr(targets, "ndim", 1) != 1:
        raise InvalidValueError(
            "no targets",
            where="targets",
            given=targets,
            allowed="a mapping of targets to values, or texts TARGET=VALUE",
            hint='for example {"twist": 165.0}',
        )
    if isinstance(targets, Mapping):
        read = [_from_pair(str(expression).strip(), value) for expression, value in targets.items()]
    else:
        read = [_from_text(expression) for expression in targets]
    if not read:
        raise InvalidValueError(
            "no target", where="targets", allowed="one target or more", hint='for example "twist=165"'
        )
    names = ["".join(target.text.split()) for target in read]
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(
                "a target is given twice", where="targets", given=name, allowed="each once"
            )
    return tuple(read)


def rewrite(text: str) -> str:
    """Return the expression that a target stands for: `rest_length("c1")` is length minus extension."""
    match = REST_LENGTH.fullmatch(text)
    return f'member_length["{match[2]}"] - member_extension["{match[2]}"]' if match else text


def parse_shape(text: str) -> ShapeCall | None:
    """Return the call of a shape parameter that a target consists of; None for any other expression."""
    try:
        node = ast.parse(rewrite(text).strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    component = ""
    if isinstance(node, ast.Attribute) and _shape_name(node.value):
        component, node = node.attr, node.value
    name = _shape_name(node)
    if not name:
        _check_rest(node, text)
        return None
    kind = SHAPES[name]
    if component and not (kind.is_vector and component in kind.components):
        raise UnknownNameError(
            f"{name} has no such component",
            where=f"target {text}",
            given=component,
            allowed=", ".join(kind.components) if kind.is_vector else "none",
        )
    arguments = [_names(argument, text) for argument in node.args] if isinstance(node, ast.Call) else []
    return ShapeCall(name, tuple(arguments), component)


def _shape_name(node: ast.AST) -> str:
    inner = node.func if isinstance(node, ast.Call) and not node.keywords else node
    return inner.id if isinstance(inner, ast.Name) and inner.id in SHAPES else ""


def _check_rest(body: ast.AST, text: str) -> None:
    """Raise for names that are neither shape parameters nor parts of expressions."""
    for node in ast.walk(body):
        if isinstance(node, ast.Name) and node.id in SHAPES:
            raise InvalidValueError(
                "a shape parameter is a target by itself and cannot be part of an expression",
                where=f"target {text}",
                given=node.id,
                allowed=f"{node.id}=VALUE, or an expression without it",
            )
    if isinstance(body, ast.Name) and body.id not in (*QUANTITIES, POSITION, "time"):
        raise UnknownNameError(
            "unknown target",
            where=f"target {text}",
            given=body.id[:80],
            allowed=f"{', '.join(SHAPES)}, or an expression of quantities and places such as node.x",
            hint=suggest(body.id, [*SHAPES, *QUANTITIES]),
        )
    if isinstance(body, ast.Call) and isinstance(body.func, ast.Name) and body.func.id not in FUNCTIONS:
        functions = [*SHAPES, *FUNCTIONS]
        raise UnknownNameError(
            "unknown function in a target",
            where=f"target {text}",
            given=body.func.id[:80],
            hint=suggest(body.func.id, functions),
        )


def _names(node: ast.AST, text: str) -> tuple[str, ...]:
    elements = node.elts if isinstance(node, ast.List | ast.Tuple) else [node]
    names = []
    for element in elements:
        if isinstance(element, ast.Name):
            names.append(element.id)
        elif isinstance(element, ast.Constant) and isinstance(element.value, str):
            names.append(element.value)
        else:
            raise InvalidValueError(
                "not a name",
                where=f"target {text}",
                given=ast.unparse(element)[:80],
                allowed='names, as in twist([t1, t2, t3], [b1, b2, b3]), or patterns in quotes: "t6_*"',
            )
    return tuple(names)


def _from_text(given: str) -> TargetText:
    expression, separator, value = str(given).rpartition("=")
    expression = expression.strip()
    match = VALUE.fullmatch(value) if separator and expression and expression[-1] not in "=<>!" else None
    numbers = [piece.strip() for piece in match[1].split(",")] if match else []
    try:
        values = tuple(float(number) for number in numbers)
    except ValueError:
        values = ()
    if not values or match is None:
        raise _build_value_error(given if not expression else f"{expression}={value}")
    return _check_finite(TargetText(expression, values, match[2] or ""))


def _from_pair(expression: str, value: float | Sequence[float]) -> TargetText:
    if isinstance(value, str):
        return _from_text(f"{expression}={value}")
    try:
        values = tuple(float(number) for number in (value if isinstance(value, Sequence) else [value]))
    except (OverflowError, TypeError, ValueError):
        values = ()
    if not values or not expression or isinstance(value, bool):
        raise _build_value_error(f"{expression}={value!r}")
    return _check_finite(TargetText(expression, values, ""))


def _check_finite(target: TargetText) -> TargetText:
    if not all(math.isfinite(value) for value in target.values):
        raise NonFiniteError(
            "the value of a target is not finite",
            where=target.where,
            given=target.values,
            allowed="finite numbers",
        )
    return target


def _build_value_error(given: object) -> InvalidValueError:
    return InvalidValueError(
        "not a target with a value",
        where="targets",
        given=given,
        allowed="TARGET=NUMBER; angles and lengths of shapes may have a unit: deg, rad, m, cm, mm",
        hint='for example twist=165deg, height=250mm, tilt=10,0, member_length["c1"]=0.2',
    )
