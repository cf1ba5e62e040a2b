"""Results that `keep` requests, bound to a library: their arrays, and their values at many states."""

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
    """One result that `keep` requests, bound to a library.

    kept_text: the parsed text; output: the array at one state, without time; names: quantities in the text,
    "node_position" among them; formula: the value as a function of them, None for a single quantity.
    """

    kept_text: KeptText
    output: Output
    names: tuple[str, ...]
    formula: Part | None

    def evaluate(self, values: Mapping[str, RealArray], shape: tuple[int, ...]) -> RealArray:
        """Return the value at many states, (*shape, ...), from the values of names, each (*shape, ...).

        shape: of the states, for example (count, n_t). Undefined values are NAN or infinite.
        """
        if self.formula is None:
            return values[self.names[0]]
        count = int(np.prod(shape))
        by_entry = {
            name: np.moveaxis(value.reshape(count, *value.shape[len(shape) :]), 0, -1)
            for name, value in values.items()
        }
        with np.errstate(all="ignore"):
            result = np.broadcast_to(self.formula.evaluate(by_entry), (*self.output.shape, count))
        return np.moveaxis(result, -1, 0).reshape(*shape, *self.output.shape)


def find_kept_quantities(kept_texts: tuple[KeptText, ...], request: ModelRequest) -> tuple[str, ...]:
    """Return the quantities that a library has to compute for parsed texts."""
    names: dict[str, None] = {}
    for kept_text in kept_texts:
        names |= dict.fromkeys(find_quantities(kept_text.expression))
        needs_places = POSITION in kept_text.expression or "." in kept_text.expression
        # If coordinates are no node coordinates, a quantity computes the positions.
        if needs_places and not find_formulation(request.formulation).in_nodes:
            names[POSITION] = None
    return tuple(names)


def bind_kept(kept_texts: tuple[KeptText, ...], manifest: Manifest) -> tuple[Kept, ...]:
    """Return the results of one library; raises FormulationError if the library lacks a quantity.

    Raises InvalidValueError and UnknownNameError for entries that the structure does not have.
    """
    return tuple(_bind(kept_text, manifest) for kept_text in kept_texts)


def _bind(kept_text: KeptText, manifest: Manifest) -> Kept:
    specs = {spec.quantity: spec for spec in manifest.functions}
    quantities = find_quantities(kept_text.expression)
    for name in quantities:
        is_part = kept_text.expression != name
        if name not in specs or (specs[name].pattern is not None and is_part):
            raise FormulationError(
                "the library has no such function",
                where=f"keep {kept_text.text!r}",
                given=name,
                hint="a sparse matrix can only be kept whole"
                if name in specs
                else "build it with this quantity",
            )
    if kept_text.expression in specs and kept_text.expression != POSITION:
        output = describe_quantity(manifest, specs[kept_text.expression])
        output = replace(output, name=kept_text.name, expression=kept_text.text_beside_name)
        return Kept(kept_text, output, (kept_text.expression,), None)
    try:
        formula = build_part(kept_text.tree, manifest)
    except TensegrityError as error:
        error.where = f"keep {kept_text.text!r}"
        raise
    axes = find_axes(kept_text.tree, manifest)
    names = (*quantities, *((POSITION,) if formula.places else ()))
    output = Output(
        name=kept_text.name,
        dims=axes.dims,
        shape=formula.shape,
        dtype=real_dtype(manifest),
        unit=axes.unit,
        sentence=QUANTITIES[POSITION].sentence
        if kept_text.expression == POSITION
        else f"Value of {kept_text.text}.",
        coordinates={dim: labels for dim, labels in axes.labels.items() if dim in axes.dims},
        expression=kept_text.text_beside_name,
    )
    return Kept(kept_text, output, names, None if kept_text.expression == POSITION else formula)


@dataclass(frozen=True)
class Shaped:
    """Names of the axes of an expression, their labels, and its unit, "" if it is unknown."""

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
        shaped = _of_name(node.value.id, manifest, specs)
        count = len(node.slice.elts) if isinstance(node.slice, ast.Tuple) else 1
        return Shaped(shaped.dims[count:], shaped.unit, shaped.labels)
    if isinstance(node, ast.Attribute):
        return Shaped(unit="m")
    if isinstance(node, ast.UnaryOp):
        return _find(node.operand, manifest, specs)
    if isinstance(node, ast.BinOp):
        return _of_two(node, _find(node.left, manifest, specs), _find(node.right, manifest, specs))
    if isinstance(node, ast.Call):
        return _of_call(node, [_find(argument, manifest, specs) for argument in node.args])
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
        shaped.unit
        for shaped, side in ((left, node.left), (right, node.right))
        if not (adds and isinstance(side, ast.Constant))
    }
    unit = units.pop() if adds and len(units) == 1 else ""
    return Shaped(longer.dims, unit, {**right.labels, **left.labels})


def _of_call(node: ast.Call, arguments: list[Shaped]) -> Shaped:
    assert isinstance(node.func, ast.Name)
    units = {
        shaped.unit
        for shaped, side in zip(arguments, node.args, strict=True)
        if not isinstance(side, ast.Constant)
    }
    unit = units.pop() if len(units) == 1 else ""
    if node.func.id == "sqrt":
        return Shaped(arguments[0].dims, "", arguments[0].labels)
    return Shaped(arguments[0].dims, unit, arguments[0].labels) if node.func.id == "abs" else Shaped((), unit)
