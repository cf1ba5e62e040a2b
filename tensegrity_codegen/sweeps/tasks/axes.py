"""Axes, labels and units of expressions over quantities: those of the quantities in them, where they stay."""

import ast
from dataclasses import dataclass, field
from typing import Any

from tensegrity_codegen.runtime.simulate.condition_parts import build_difference
from tensegrity_codegen.runtime.simulate.condition_text import POSITION
from tensegrity_codegen.sweeps.tasks.dimensions import AXES, describe_quantity
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest

Labels = dict[str, tuple[Any, ...]]


@dataclass(frozen=True)
class Shaped:
    """Names of the axes of an expression, their labels, and its unit, "" where it is not known."""

    dims: tuple[str, ...] = ()
    unit: str = ""
    labels: Labels = field(default_factory=dict)


def find_axes(tree: ast.expr, manifest: Manifest) -> Shaped:
    """Return axes, labels and unit of a checked expression, for a library that has all that it names."""
    specs = {spec.quantity: spec for spec in manifest.functions}
    return _find(build_difference(tree), manifest, specs)


def _find(node: ast.expr, manifest: Manifest, specs: dict[str, FunctionSpec]) -> Shaped:
    if isinstance(node, ast.Name):
        return _of_name(node.id, manifest, specs)
    if isinstance(node, ast.Subscript):
        assert isinstance(node.value, ast.Name)
        whole = _of_name(node.value.id, manifest, specs)
        count = len(node.slice.elts) if isinstance(node.slice, ast.Tuple) else 1
        return Shaped(whole.dims[count:], whole.unit, whole.labels)
    if isinstance(node, ast.Attribute):
        return Shaped(unit="m")
    if isinstance(node, ast.UnaryOp):
        return _find(node.operand, manifest, specs)
    if isinstance(node, ast.BinOp):
        return _of_two(node, _find(node.left, manifest, specs), _find(node.right, manifest, specs))
    if isinstance(node, ast.Call):
        return _of_call(node, [_find(part, manifest, specs) for part in node.args])
    return Shaped()


def _of_name(name: str, manifest: Manifest, specs: dict[str, FunctionSpec]) -> Shaped:
    if name == "time":
        return Shaped(unit="s")
    if name == POSITION:
        return Shaped(("node", "axis"), "m", {"node": manifest.node_name, "axis": AXES})
    output = describe_quantity(manifest, specs[name])
    return Shaped(output.dims, output.unit, dict(output.coordinates))


def _of_two(node: ast.BinOp, left: Shaped, right: Shaped) -> Shaped:
    longer = left if len(left.dims) >= len(right.dims) else right
    adds = isinstance(node.op, ast.Add | ast.Sub)
    units = {
        item.unit
        for item, side in ((left, node.left), (right, node.right))
        if not (adds and isinstance(side, ast.Constant))
    }
    unit = units.pop() if adds and len(units) == 1 else ""
    return Shaped(longer.dims, unit, {**right.labels, **left.labels})


def _of_call(node: ast.Call, parts: list[Shaped]) -> Shaped:
    assert isinstance(node.func, ast.Name)
    units = {
        part.unit for part, side in zip(parts, node.args, strict=True) if not isinstance(side, ast.Constant)
    }
    unit = units.pop() if len(units) == 1 else ""
    if node.func.id == "sqrt":
        return Shaped(parts[0].dims, "", parts[0].labels)
    return Shaped(parts[0].dims, unit, parts[0].labels) if node.func.id == "abs" else Shaped((), unit)
