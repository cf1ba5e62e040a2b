"""Batch functions: which quantities get a body over lanes, and what their templates read."""

from collections.abc import Mapping, Sequence
from typing import Any

from tensegrity_codegen.codegen.integrators.batch_integrators import count_line
from tensegrity_codegen.codegen.print.lane_printer import PrintedLanes, print_lanes
from tensegrity_codegen.codegen.prune import PrunedFunction
from tensegrity_codegen.tables.precision import Precision

# Bytes of stack and operations that a body over lanes may have; a longer one evaluates one by one.
MOST_STACK = 200_000
MOST_OPERATIONS = 20_000

# Rows of lanes that registers of 512 bits hold: they are transposed in whole multiples of it.
REGISTER_LANES = 8


def write_lanes(
    functions: Sequence[PrunedFunction], width: int, precision: Precision
) -> dict[str, PrintedLanes]:
    """Return the bodies in `width` lanes, by quantity, of functions short enough for compiler and stack."""
    found: dict[str, PrintedLanes] = {}
    for function in functions:
        if not function.arguments or function.operations > MOST_OPERATIONS:
            continue
        name = function.quantity.name
        rows = function.function.nnz_in() + function.function.nnz_out()
        if rows * width * precision.dtype.itemsize > MOST_STACK:
            continue
        found[name] = print_lanes(function.function, list(function.arguments), name, precision)
    return found


def batch_context(width: int, lanes: Mapping[str, PrintedLanes], precision: Precision) -> dict[str, Any]:
    """Return what all batch functions share; has_avx512: whether it turns 8 rows at once."""
    return {
        "width": width,
        "line": count_line(precision),
        "has_lanes": bool(lanes),
        "has_avx512": bool(lanes) and precision.name == "double" and width % REGISTER_LANES == 0,
    }
