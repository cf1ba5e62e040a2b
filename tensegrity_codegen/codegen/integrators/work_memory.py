"""Sizes of the work memory of integrators, read from the structs in `templates/c/`."""

import ast
import functools
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tensegrity_codegen.codegen.print.render import plain_c_folder, template_folder
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.manifest import FunctionSpec, IntegratorSpec
from tensegrity_codegen.tables.precision import Precision

STRUCT = r"typedef struct {{\n([^}}]*)}} {name};"
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
FIELD = re.compile(r"(?:const )?(\w+(?: \w+)*?) (\**\w+(?:\[[^\]]*\])?(?:, *\**\w+(?:\[[^\]]*\])?)*);")
POINTER = 8  # bytes
SIZES = {"double": 8, "real": 8, "int": 4, "long long": 8}
OPERATIONS = {ast.Add: int.__add__, ast.Sub: int.__sub__, ast.Mult: int.__mul__}


def count_bytes(struct: str, file: str, sizes: Mapping[str, int]) -> int:
    """Return what `sizeof` says of a struct, for the sizes that its fields name.

    struct, file: name of the struct, and the file in `templates/c/` that defines it.
    sizes: value of every constant in the lengths of its arrays, and bytes of every struct among its fields. A
        field inside `#if NAME` counts where that name is in `sizes` and not 0.
    Raises KeyError for a constant or a type without a size.
    """
    values = {**SIZES, **sizes}
    total = 0
    for (condition, kind), counts in _read_fields(plain_c_folder(template_folder()) / file, struct):
        if not condition or sizes.get(condition):
            for is_pointer, length in counts:
                total += POINTER if is_pointer else values[kind] * _evaluate(length, values)
    return -(-total // SIZES["double"]) * SIZES["double"]


@functools.cache
def _read_fields(path: Path, struct: str) -> tuple[tuple[tuple[str, str], tuple[tuple[bool, str], ...]], ...]:
    """Return the fields of a struct: condition and type, then whether a pointer, and the length, of each."""
    text = COMMENT.sub("", path.read_text(encoding="utf-8"))
    definition = re.search(STRUCT.format(name=struct), text)
    assert definition is not None, f"{path.name} has no struct {struct}"
    fields, condition = [], ""
    for line in definition[1].splitlines():
        word = line.strip()
        if word.startswith("#if "):
            condition = word.removeprefix("#if ")
        elif word == "#endif":
            condition = ""
        elif word:
            match = FIELD.fullmatch(word)
            assert match is not None, f"{path.name}: {word}"
            counts = []
            for declarator in match[2].split(","):
                length = re.search(r"\[(.*)\]", declarator)
                counts.append((declarator.strip().startswith("*"), length[1] if length else "1"))
            fields.append(((condition, match[1]), tuple(counts)))
    return tuple(fields)


def _evaluate(text: str, sizes: Mapping[str, int]) -> int:
    """Return the value of a product or sum of whole numbers and names."""

    def value(node: ast.expr) -> int:
        if isinstance(node, ast.Constant):
            return int(node.value)  # type: ignore[arg-type]
        if isinstance(node, ast.Name):
            return sizes[node.id]
        assert isinstance(node, ast.BinOp), text
        return OPERATIONS[type(node.op)](value(node.left), value(node.right))

    return value(ast.parse(text, mode="eval").body)


def count_entries(function: FunctionSpec) -> int:
    """Return the numbers that a function writes."""
    return int(np.prod(function.shape)) if function.pattern is None else len(function.pattern.row)


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
    """Return how many numbers of work memory integrator `name` takes over `width` states."""
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
    """Return the integrator with the memory of its batch function, if the library has batches and it one."""
    row = INTEGRATORS[spec.name]
    if not width or not row.in_batches or (n_internal and row.kind == "fixed"):
        return spec
    size = count_batch_work(spec.name, n_coordinates, n_internal, argument_sizes, width, precision)
    return replace(spec, batch_work_size=size)
