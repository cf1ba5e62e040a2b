"""Quantities under JAX without Python: XLA calls the batch functions of a library through a function in C."""

import ctypes
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.learning.derivatives.quantity import QuantityFunction
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.system.errors import CompileError, CompilerMissingError
from tensegrity_codegen.system.extras import JAX, import_extra

SYMBOL = "tensegrity_xla_call"
MOST_ARGUMENTS = 16
N_RESULT = 4  # place of the number of results in a plan


@cache
def register_call() -> Any:
    """Return the compiled function that XLA calls, None without a compiler: Python is called then."""
    ffi = import_extra("jax.ffi", JAX)
    header = Path(ffi.include_dir()) / "xla/ffi/api/c_api.h"
    sources = {
        "c_api.h": header.read_text(encoding="utf-8"),
        "xla_call.c": render("xla_call.c", {"most": MOST_ARGUMENTS}),
    }
    try:
        flags = find_flags("reference")
        made = compile_library(sources, name="xla_call", compiler=find_compiler(), flags=flags)
    except (CompilerMissingError, CompileError):
        return None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # a loaded file may be removed
        path = Path(folder) / made.file_name
        path.write_bytes(made.library)
        library = ctypes.CDLL(str(path))
    ffi.register_ffi_target(SYMBOL, ffi.pycapsule(library[SYMBOL]), platform="cpu")
    return library


def call_in_c(
    way: str,
    function: QuantityFunction,
    names: Sequence[str],
    operands: Sequence[Any],
    results: Sequence[Any],
) -> list[Any]:
    """Return the results of "evaluate", "push" or "pull" in a computation of JAX."""
    jnp, ffi = import_extra("jax.numpy", JAX), import_extra("jax.ffi", JAX)
    values, second = dict(zip(names, operands, strict=False)), operands[len(names) :]
    called = function.function if way == "evaluate" else function.slopes
    shape = next(iter(function.outputs.values()))
    leading = results[0].shape
    lead = leading[: len(leading) - len(function.inputs[names[0]] if way == "pull" else shape)]
    # Arguments in the order of C, with one row for all or one for each.
    rows = []
    for name in called.arguments:
        own_shape = function.inputs[name]
        value = values.get(name, function.model.nominal(name).reshape((1,) * len(lead) + own_shape))
        is_shared = int(np.prod(value.shape)) == int(np.prod(own_shape))
        rows.append(jnp.asarray(value if is_shared else jnp.broadcast_to(value, (*lead, *own_shape))))
    if way == "push":
        tangents = dict(zip(names, second, strict=True))
        sizes = {name: int(np.prod(function.inputs[name])) for name in function.parts}
        vectors = [
            tangents[name].reshape((*lead, size)) if name in tangents else jnp.zeros((*lead, size))
            for name, size in sizes.items()
        ]
        rows.append(jnp.concatenate(vectors, axis=-1))
    elif way == "pull":
        rows.append(second[0])
    plan = _find_plan(function, way)
    count = plan[N_RESULT]
    kind = import_extra("jax", JAX).ShapeDtypeStruct((*lead, int(count)), np.float64)
    output = ffi.ffi_call(SYMBOL, kind)(*rows, plan=np.int64(plan.ctypes.data))
    if way != "pull":
        return [output.reshape((*lead, *shape))]
    return [output[..., function.parts[name]].reshape((*lead, *function.inputs[name])) for name in names]


@cache  # forever: compiled computations of JAX outlive the function
def _find_plan(function: QuantityFunction, way: str) -> IntArray:
    """Return what templates/xla_call.c.j2 reads of a method."""
    called = function.function if way == "evaluate" else function.slopes
    to, vector = ((index, matrix.shape[0]) for index, matrix in function.places)
    if way == "pull":
        to, vector = vector, to
    sizes = [int(np.prod(function.inputs[name])) for name in called.arguments]
    head = [called.batch.address, way != "evaluate", function.on_error == "nan", len(sizes), to[1], vector[1]]
    return np.array([*head, len(to[0]), to[0].ctypes.data, vector[0].ctypes.data, *sizes], dtype=np.int64)
