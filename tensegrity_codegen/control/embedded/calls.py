"""Calls of a controller in C to its model: accelerations, mass matrix, expected measurements."""

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from tensegrity_codegen.codegen.integrators.work_memory import count_entries
from tensegrity_codegen.codegen.print.printer import print_number
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import Precision


@dataclass(frozen=True)
class MeasuredNumber:
    """One measured number.

    source: a quantity of the model, ``"coordinate"``, ``"velocity"``, or ``""`` for a constant.
    index: place in the source.
    is_length: whether it is a length, above 0.
    """

    source: str
    index: int = 0
    value: float = 0.0
    is_length: bool = False


def find_measured(sensors: tuple[Sensor, ...], manifest: Manifest) -> tuple[MeasuredNumber, ...]:
    """Return the numbers that sensors measure, in their order."""
    return tuple(number for sensor in sensors for number in _measure(sensor, manifest))


def _measure(sensor: Sensor, manifest: Manifest) -> list[MeasuredNumber]:
    if sensor.kind in ("member_length", "member_tension"):
        is_length = sensor.kind == "member_length"
        return [MeasuredNumber(sensor.kind, e, is_length=is_length) for e in sensor.targets]
    axes, places = manifest.axes, [tuple(row) for row in manifest.coordinate_node_axis]
    moves = sensor.kind == "node_velocity"
    found = []
    for node in sensor.targets:
        for column, axis in enumerate(axes):
            if not places:
                found.append(MeasuredNumber(sensor.kind, node * len(axes) + column))
            elif (node, axis) in places:
                source = "velocity" if moves else "coordinate"
                found.append(MeasuredNumber(source, places.index((node, axis))))
            else:
                value = 0.0 if moves else float(manifest.stated_position[node, axis])
                found.append(MeasuredNumber("", value=value))
    return found


# The lower half of a symmetric matrix, row by row from the first entry of each row to the diagonal.


@dataclass(frozen=True)
class Envelope:
    """Where a matrix is stored.

    first (n,): first column of each row.
    row (n,): place of the first entry of each row.
    place (n_entries,): place of each entry that the model computes, -1 for one of the upper half.
    size: number of stored entries.
    """

    first: IntArray
    row: IntArray
    place: IntArray
    size: int


def find_envelope(spec: FunctionSpec) -> Envelope:
    """Return the envelope of a symmetric matrix that a model computes, sparse or dense."""
    n = spec.shape[0]
    if spec.pattern is not None:
        rows = spec.pattern.row.astype(np.int64)
        columns = np.repeat(np.arange(n), np.diff(spec.pattern.column_start))
    else:
        rows, columns = (part.ravel() for part in np.indices((n, n)))
    first = np.arange(n)
    lower = rows >= columns
    np.minimum.at(first, rows[lower], columns[lower])
    width = np.arange(n) - first + 1
    row = np.concatenate([[0], np.cumsum(width)[:-1]])
    place = np.where(lower, row[rows] + columns - first[rows], -1)
    return Envelope(first, row, place, int(width.sum()))


@dataclass(frozen=True)
class Calls:
    """Statements of the functions that call the model, and sizes of their memory.

    acceleration, measure, mass, length, equilibrium, state_jacobian, input_jacobian: C statements.
    envelope: of the mass matrix, None without
    one; size_measured, size_entries: numbers of memory.
    """

    acceleration: str
    measure: list[str]
    mass: str
    length: str
    equilibrium: str
    state_jacobian: str
    input_jacobian: str
    envelope: Envelope | None
    size_measured: int
    size_entries: int


def write_calls(model: Manifest | None, measured: tuple[MeasuredNumber, ...], precision: Precision) -> Calls:
    """Return the statements with which a controller calls its model."""
    functions = {} if model is None else {spec.quantity: spec for spec in model.functions}
    mass = functions.get("mass_matrix")
    sources = {item.source for item in measured} & set(functions)
    return Calls(
        acceleration=_call(functions.get("acceleration"), "acceleration"),
        measure=write_measure(functions, measured, precision),
        mass=_call(mass, "memory"),
        length=_call(functions.get("member_length"), "length"),
        equilibrium=_call(functions.get("equilibrium_matrix"), "entry"),
        state_jacobian=_call(functions.get("state_jacobian"), "by_state"),
        input_jacobian=_call(functions.get("input_jacobian"), "by_input"),
        envelope=None if mass is None else find_envelope(mass),
        size_measured=max((count_entries(functions[source]) for source in sources), default=1),
        size_entries=1 if mass is None else count_entries(mass),
    )


def _call(spec: FunctionSpec | None, result: str) -> str:
    return "" if spec is None else f"{spec.symbol}({', '.join((*spec.arguments, result))})"


def write_measure(
    functions: dict[str, FunctionSpec], measured: tuple[MeasuredNumber, ...], precision: Precision
) -> list[str]:
    """Return the lines that read the numbers, one call for each run of numbers of one source."""
    lines, ready = [], ""
    rows = list(enumerate(measured))
    for source, run in groupby(rows, key=lambda row: row[1].source):
        if source in functions and source != ready:
            lines += [f"if ({_call(functions[source], 'memory')} != 0) {{", "  return 1;", "}"]
            ready = source
        for k, item in run:
            memory = "memory" if source in functions else source
            value = f"{memory}[{item.index}]" if source else print_number(item.value, precision)
            lines.append(f"measured[{k}] = {value};")
    return lines
