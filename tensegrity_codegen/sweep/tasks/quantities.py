"""Quantities of a library for every case of a chunk, side by side where it has batch functions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import NonFiniteError
from tensegrity_codegen.manifest import FunctionSpec
from tensegrity_codegen.runtime.model.model import CompiledModel

__all__ = ["compute_rows"]

RealArray = NDArray[Any]
BoolArray = NDArray[np.bool_]


def compute_rows(
    model: CompiledModel,
    quantity: str,
    rows: Mapping[str, RealArray],
    shared: Mapping[str, RealArray],
    count: int,
    threads: int = 1,
) -> tuple[RealArray, BoolArray]:
    """Return a quantity (count, ...) and whether each row is finite; sparse matrices as dense arrays.

    rows: arguments with one row a case; shared: arguments of all cases.
    """
    function = model.function(quantity)
    if not any(name in rows for name in function.arguments):
        found, is_good = _compute_each(model, quantity, {}, shared, 1)
        found = np.repeat(found, count, axis=0)
        is_good = np.repeat(is_good, count)
    elif model.library.batch_width:
        answer, status = model.compute_batch(
            quantity, threads=threads, on_error="status", **{**shared, **rows}
        )
        found, is_good = np.asarray(answer), status == 0
    else:
        found, is_good = _compute_each(model, quantity, rows, shared, count)
    return _fill_pattern(found, function.spec), is_good


def _compute_each(
    model: CompiledModel,
    quantity: str,
    rows: Mapping[str, RealArray],
    shared: Mapping[str, RealArray],
    count: int,
) -> tuple[RealArray, BoolArray]:
    """Return the values one case after the other; of sparse matrices the non-zeros, (count, n_nonzeros)."""
    function = model.function(quantity)
    own = [name for name in function.arguments if name in rows]
    values = [shared[name] if name in shared else model.nominal(name) for name in function.arguments]
    places = {name: function.arguments.index(name) for name in own}
    pattern = function.spec.pattern
    shape = (len(pattern.row),) if pattern else function.spec.shape
    found = np.full((count, *shape), np.nan, dtype=model.dtype)
    is_good = np.ones(count, dtype=np.bool_)
    for k in range(count):
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
