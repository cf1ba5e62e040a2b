"""How a controller in C calls its model: accelerations, mass matrix, expected measurements."""

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from tensegrity_codegen.codegen.print.printer import print_number
from tensegrity_codegen.control.embedded.envelope import Envelope, find_envelope
from tensegrity_codegen.control.embedded.measured import MeasuredNumber
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import Precision


@dataclass(frozen=True)
class Calls:
    """Statements of the functions that call the model, and sizes of their memory.

    acceleration, measure, mass, length, equilibrium: C statements; envelope: of the mass matrix, None without
    one; size_measured, size_entries: numbers of memory.
    """

    acceleration: str
    measure: list[str]
    mass: str
    length: str
    equilibrium: str
    envelope: Envelope | None
    size_measured: int
    size_entries: int


def count_entries(spec: FunctionSpec) -> int:
    """Return how many numbers a function returns."""
    return int(np.prod(spec.shape)) if spec.pattern is None else len(spec.pattern.row)


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
