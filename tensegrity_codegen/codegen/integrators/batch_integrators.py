"""Integrations of several states side by side: which integrators have them, and the memory that they take."""

from collections.abc import Iterable
from dataclasses import replace

from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.manifest import IntegratorSpec
from tensegrity_codegen.tables.precision import Precision

LINE_BYTES = 64  # of the cache: lanes begin at a multiple of it


def count_line(precision: Precision) -> int:
    """Return how many numbers fill a line of the cache."""
    return LINE_BYTES // precision.dtype.itemsize


def count_batch_work(
    name: str,
    n_coordinates: int,
    n_internal: int,
    argument_sizes: Iterable[int],
    width: int,
    precision: Precision,
) -> int:
    """Return how many numbers of work memory integrator `name` takes over `width` states.

    n_internal: internal states of each; argument_sizes: numbers in each argument that it passes on.
    """
    line, n, n_states = count_line(precision), n_coordinates, 2 * n_coordinates + n_internal
    table = INTEGRATORS[name].tableau
    # Lanes: state, trial, acceleration, stages. Row: old and new (q, v, a), spare.
    if table is None or not table.errors:
        lanes, row = (2 + 2 + 1 + 7) * n, 7 * n
    else:  # may the step grow, lost, state, change, trial, spare, rates, dense output
        dense = 3 + len(table.dense) if table.dense else 0
        lanes, row = 1 + n_states * (5 + table.rates + dense), (4 + dense) * n_states
    row = -(-row // line) * line
    return line + row + width * (lanes + sum(argument_sizes))


def with_batch(
    spec: IntegratorSpec,
    n_coordinates: int,
    n_internal: int,
    argument_sizes: Iterable[int],
    width: int,
    precision: Precision,
) -> IntegratorSpec:
    """Return the integrator with the memory of its batch function, if the library has batches and it one.

    Fixed steps have none with internal states.
    """
    row = INTEGRATORS[spec.name]
    if not width or not row.in_batches or (n_internal and row.kind == "fixed"):
        return spec
    size = count_batch_work(spec.name, n_coordinates, n_internal, argument_sizes, width, precision)
    return replace(spec, batch_work_size=size)
