"""Exact directional derivatives of accelerations and outputs, by forward differentiation."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.print.printer import print_body
from tensegrity_codegen.codegen.unrolled import MOST_MEMBERS
from tensegrity_codegen.export.fmu.layout import Layout
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.symbolic.operations import count_operations
from tensegrity_codegen.tables.request import ModelRequest

MOST_OPERATIONS = 60_000  # of the C function, which compilers take some ten seconds for


@dataclass(frozen=True)
class Tangent:
    """The statements of the function, and which unknowns depend on which knowns.

    inputs, outputs: names of its arrays in C, and where they are.
    pattern: (n_unknowns, n_knowns) of accelerations and calculated values on arguments, coordinates and
    velocities.
    """

    lines: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]
    outputs: tuple[tuple[str, str], ...]
    pattern: NDArray[np.bool_]


def find_tangent(layout: Layout, request: ModelRequest) -> Tangent | None:
    """Return the derivatives of a unit, None where the structure is too large for straight-line code."""
    if layout.structure.n_members > MOST_MEMBERS:
        return None
    model = build_model(layout.structure, request)
    names, sources = _find_arguments(layout)
    symbols = [ca.vec(model.arguments[name].symbol) for name in names]
    seeds = [ca.SX.sym(f"seed_{name}", symbol.numel()) for name, symbol in zip(names, symbols, strict=True)]
    known, seed = ca.vertcat(*symbols), ca.vertcat(*seeds)
    unknowns = _find_unknowns(model, layout)
    results = [ca.cse(ca.densify(ca.jtimes(item, known, seed))) for _, _, item in unknowns]
    function = ca.Function("tangent", [*symbols, *seeds], results)
    if count_operations(function) > MOST_OPERATIONS:
        return None
    labels = [*names, *(f"change_of_{name}" for name in names)]
    outputs = [name for name, _, _ in unknowns]
    body = print_body(function, labels, outputs)
    places = [*(f"{array} + {place}" for array, place in sources)]
    changes = [*(f"seed_{array} + {place}" for array, place in sources)]
    return Tangent(
        body.lines,
        tuple(zip(labels, [*places, *changes], strict=True)),
        tuple((name, place) for name, place, _ in unknowns),
        _find_pattern(layout, known, [item for _, _, item in unknowns]),
    )


def _find_arguments(layout: Layout) -> tuple[list[str], list[tuple[str, int]]]:
    """Return the names of all arguments, and array and place of each in C."""
    names = [item.name for item in layout.arguments] + ["coordinate", "velocity"]
    places = [("argument", item.place) for item in layout.arguments]
    return names, [*places, ("state", 0), ("state", layout.n_coordinates)]


def _find_unknowns(model: SymbolicModel, layout: Layout) -> list[tuple[str, str, ca.SX]]:
    """Return name in C, place and expression (a column) of accelerations and of each block."""
    found = [("change_of_acceleration", "seed_acceleration", _column(model, "acceleration"))]
    for block in layout.blocks:
        if block.spec is not None:
            place = f"seed_value + {block.start}"
            found.append((f"change_of_value_{block.quantity}", place, _column(model, block.quantity)))
    return found


def _column(model: SymbolicModel, quantity: str) -> ca.SX:
    return ca.vec(ca.densify(model.expression(quantity)))


def _find_pattern(layout: Layout, known: ca.SX, unknowns: list[ca.SX]) -> NDArray[np.bool_]:
    """Return which accelerations and values depend on which arguments and states."""
    everything = ca.vertcat(*unknowns)
    sparsity = ca.Function("values", [known], [everything]).jac_sparsity(0, 0)
    rows, columns = sparsity.get_triplet()
    own = np.zeros((everything.numel(), known.numel()), dtype=np.bool_)
    own[rows, columns] = True
    n = layout.n_coordinates
    pattern = np.zeros((n + layout.n_values, known.numel()), dtype=np.bool_)
    pattern[:n] = own[:n]
    at = n
    for block in layout.blocks:
        if block.spec is not None:
            pattern[n + block.start : n + block.start + block.size] = own[at : at + block.size]
            at += block.size
    return pattern
