"""Kept results of each case, bound to a library: their arrays, and their values at many states."""

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.keep_text import AXES, KeptText, describe_quantity, real_dtype
from tensegrity_codegen.analyses.cases.record import Output
from tensegrity_codegen.runtime.simulate.condition import Part, build_difference, build_part, find_quantities
from tensegrity_codegen.runtime.simulate.condition_text import POSITION
from tensegrity_codegen.system.errors import FormulationError, TensegrityError
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import QUANTITIES
from tensegrity_codegen.tables.request import ModelRequest

RealArray = NDArray[Any]
Labels = dict[str, tuple[Any, ...]]


@dataclass(frozen=True)
class Kept:
    """One thing that is kept, of one library.

    text: what was asked for; output: its array at one state, without time; names: quantities whose values it
    takes, "node_position" among them; part: how its value follows from them, None where it is one quantity.
    """

    text: KeptText
    output: Output
    names: tuple[str, ...]
    part: Part | None

    def evaluate(self, values: Mapping[str, RealArray], shape: tuple[int, ...]) -> RealArray:
        """Return the value at many states, (*shape, ...), from the values of names, each (*shape, ...).

        shape: of the states, for example (count, n_t). What is not finite is NAN or infinite.
        """
        if self.part is None:
            return values[self.names[0]]
        count = int(np.prod(shape))
        behind = {
            name: np.moveaxis(value.reshape(count, *value.shape[len(shape) :]), 0, -1)
            for name, value in values.items()
        }
        with np.errstate(all="ignore"):
            found = np.broadcast_to(self.part.evaluate(behind), (*self.output.shape, count))
        return np.moveaxis(found, -1, 0).reshape(*shape, *self.output.shape)


def find_kept_quantities(kept: tuple[KeptText, ...], request: ModelRequest) -> tuple[str, ...]:
    """Return the quantities that a library has to compute for what is kept."""
    names: dict[str, None] = {}
    for item in kept:
        names |= dict.fromkeys(find_quantities(item.expression))
        needs_places = POSITION in item.expression or "." in item.expression
        # Where coordinates are no node coordinates, a quantity places nodes.
        if needs_places and not find_formulation(request.formulation).in_nodes:
            names[POSITION] = None
    return tuple(names)


def bind_kept(kept: tuple[KeptText, ...], manifest: Manifest) -> tuple[Kept, ...]:
    """Return what is kept for one library; raises FormulationError where the library lacks a quantity.

    Raises InvalidValueError and UnknownNameError for entries that the structure does not have.
    """
    return tuple(_bind(item, manifest) for item in kept)


def _bind(item: KeptText, manifest: Manifest) -> Kept:
    specs = {spec.quantity: spec for spec in manifest.functions}
    wanted = find_quantities(item.expression)
    for name in wanted:
        is_part = item.expression != name
        if name not in specs or (specs[name].pattern is not None and is_part):
            raise FormulationError(
                "the library has no such function",
                where=f"keep {item.text!r}",
                given=name,
                hint="a sparse matrix can only be kept whole"
                if name in specs
                else "build it with this quantity",
            )
    if item.expression in specs and item.expression != POSITION:
        output = describe_quantity(manifest, specs[item.expression])
        output = replace(output, name=item.name, expression=item.text_beside_name)
        return Kept(item, output, (item.expression,), None)
    try:
        part = build_part(item.tree, manifest)
    except TensegrityError as error:
        error.where = f"keep {item.text!r}"
        raise
    axes = find_axes(item.tree, manifest)
    names = (*wanted, *((POSITION,) if part.places else ()))
    output = Output(
        name=item.name,
        dims=axes.dims,
        shape=part.shape,
        dtype=real_dtype(manifest),
        unit=axes.unit,
        sentence=QUANTITIES[POSITION].sentence if item.expression == POSITION else f"Value of {item.text}.",
        coordinates={dim: labels for dim, labels in axes.labels.items() if dim in axes.dims},
        expression=item.text_beside_name,
    )
    return Kept(item, output, names, None if item.expression == POSITION else part)


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
