"""Quantities of a library for every case of a chunk, side by side where it can; use of limits of members."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.condition_text import POSITION
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.sweeps.tasks.case_arguments import CaseArguments
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.manifest import FunctionSpec

RealArray = NDArray[Any]


def compute_rows(
    model: CompiledModel, quantity: str, given: CaseArguments, threads: int = 1
) -> tuple[RealArray, BoolArray]:
    """Return a quantity (count, ...) and whether each row is finite; sparse matrices as dense arrays."""
    function = model.function(quantity)
    if not any(name in given.rows for name in function.arguments):
        found, is_good = _compute_each(model, quantity, replace(given, count=1, rows={}))
        found = np.repeat(found, given.count, axis=0)
        is_good = np.repeat(is_good, given.count)
    elif model.library.batch_width:
        answer, status = model.compute_batch(quantity, threads=threads, on_error="status", **given.all)
        found, is_good = np.asarray(answer), status == 0
    else:
        found, is_good = _compute_each(model, quantity, given)
    return _fill_pattern(found, function.spec), is_good


def compute_values(
    model: CompiledModel, names: Iterable[str], given: CaseArguments, threads: int = 1
) -> dict[str, tuple[RealArray, BoolArray]]:
    """Return quantities by name, each as `compute_rows` does, positions of nodes as (count, n_nodes, 3)."""
    return {
        name: place_rows(model, given, threads)
        if name == POSITION
        else compute_rows(model, name, given, threads)
        for name in names
    }


def place_rows(model: CompiledModel, given: CaseArguments, threads: int = 1) -> tuple[RealArray, BoolArray]:
    """Return positions of all nodes (count, n_nodes, 3) [m], and whether each row is finite."""
    manifest = model.manifest
    axes, places = list(manifest.axes), manifest.coordinate_place
    result = np.tile(manifest.stated_position.astype(model.dtype), (given.count, 1, 1))
    if not manifest.coordinate_node_axis:
        found, is_good = compute_rows(model, POSITION, given, threads)
        result[..., axes] = found
        return result, is_good
    case_arguments = given.all
    changeable = next((item for item in manifest.arguments if item.name == "anchor_position"), None)
    if changeable is not None and "anchor_position" in case_arguments:
        nodes = np.array([manifest.node_name.index(name) for name in changeable.over])
        result[:, nodes[:, None], axes] = case_arguments["anchor_position"]
    result[:, places[:, 0], places[:, 1]] = case_arguments.get("coordinate", model.nominal("coordinate"))
    return result, np.isfinite(result).all(axis=(1, 2))


def _compute_each(model: CompiledModel, quantity: str, given: CaseArguments) -> tuple[RealArray, BoolArray]:
    """Return the values one case after the other; of sparse matrices the non-zeros, (count, n_nonzeros)."""
    function, rows, shared = model.function(quantity), given.rows, given.shared
    own = [name for name in function.arguments if name in rows]
    values = [shared[name] if name in shared else model.nominal(name) for name in function.arguments]
    places = {name: function.arguments.index(name) for name in own}
    pattern = function.spec.pattern
    shape = (len(pattern.row),) if pattern else function.spec.shape
    found = np.full((given.count, *shape), np.nan, dtype=model.dtype)
    is_good = np.ones(given.count, dtype=np.bool_)
    for k in range(given.count):
        for name in own:
            values[places[name]] = rows[name][k]
        try:
            found[k] = function.values(values, None).reshape(shape)
        except NonFiniteError:
            is_good[k] = False
    return found, is_good


def _fill_pattern(found: RealArray, spec: FunctionSpec) -> RealArray:
    """Return dense matrices of the non-zeros of sparse ones, anything else as it is."""
    if spec.pattern is None:
        return found
    column = np.repeat(np.arange(spec.shape[1]), np.diff(spec.pattern.column_start))
    dense = np.zeros((len(found), *spec.shape), dtype=found.dtype)
    dense[:, spec.pattern.row, column] = found
    return dense


LIMIT_USE = "limit_use"
OF_STIFFNESS = ("spring_constant", "axial_stiffness", "rest_length")
BEYOND = "members buckle, are strained by more than 1 %, or exceed a limit"
LIMIT_USE_RESULT = (
    "float64",
    "1",
    "Largest part that a member uses of its limits, of Euler's load and of 1 % strain; above 1: exceeded.",
)


def compute_limit_use(
    model: CompiledModel, case_arguments: CaseArguments, rows: slice, tension: FloatArray, length: FloatArray
) -> FloatArray:
    """Return the largest use of a limit in each case, (count,); NaN with a library that was loaded alone.

    rows: the cases, of those in `case_arguments`; tension, length: (count, ..., n_members) [N, m].
    """
    structure, count = model.structure, len(tension)
    if structure is None or not structure.n_members:
        return np.full(count, np.nan)
    values = {name: getattr(structure, name) for name in OF_STIFFNESS}
    for item in model.manifest.arguments:
        if item.name in values and item.name in case_arguments.all:
            array = np.tile(values[item.name], (count, 1))
            places = [structure.member_name.index(name) for name in item.over]
            array[:, places] = (
                case_arguments.rows[item.name][rows]
                if item.name in case_arguments.rows
                else case_arguments.shared[item.name]
            )
            values[item.name] = array
    elastic = values["axial_stiffness"] + values["spring_constant"] * values["rest_length"]
    if elastic.ndim == 2:
        elastic = elastic.reshape(count, *(1,) * (tension.ndim - 2), -1)
    use = check_members(structure, tension, length, elastic=elastic).largest_use
    return np.asarray(np.fmax.reduce(use.reshape(count, -1), axis=1))
