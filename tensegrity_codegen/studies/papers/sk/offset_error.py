"""Far from the origin and in single precision: what node positions lose, and node distances keep.

A structure is moved by an offset along (1, 1, 1). In node positions r_i - r_j then has the rounding of the
offset; differences as coordinates know nothing of it. Errors are relative to the largest exact value, which
is computed at the origin with more digits.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.prune import PrunedFunction, prune
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.models import compile_in
from tensegrity_codegen.studies.papers.sk.precision import evaluate_in
from tensegrity_codegen.studies.papers.sk.sample import sample_prism
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.tables.request import ModelRequest

OFFSETS = (0.0, 1e3, 1e6, 1e9)
PRECISIONS: dict[str, type[np.floating[Any]]] = {"double": np.float64, "single": np.float32}
QUANTITIES = ("member_tension", "acceleration")
FORMULATIONS = ("node_position", "node_distance")


def compare_offsets(
    structure: Structure | None = None, offsets: Iterable[float] = OFFSETS
) -> list[dict[str, Any]]:
    """Return one row an offset and precision: errors of both formulations relative to the exact values.

    structure: a free prism, 1 mm off equilibrium, if not given. Rows hold offset [m], precision ("double" or
    "single") and `<formulation>_<quantity>`: the largest error over the largest exact value; None where
    nodes coincide in that precision, so that there is no result.
    """
    structure = structure or sample_prism(spread=1e-3)
    sides = {name: _Side(structure, name) for name in FORMULATIONS}
    rows = []
    for precision, number in PRECISIONS.items():
        for offset in offsets:
            row: dict[str, Any] = {"offset": float(offset), "precision": precision}
            for name, side in sides.items():
                for quantity in QUANTITIES:
                    row[f"{name}_{quantity}"] = side.error(quantity, float(offset), number)
            rows.append(row)
    return rows


class _Side:
    """One formulation of a structure, evaluated in any precision at any offset."""

    def __init__(self, structure: Structure, formulation: str) -> None:
        self.model: SymbolicModel = build_model(structure, ModelRequest((), formulation=formulation))
        self.functions: dict[str, PrunedFunction] = {
            function.quantity.name: function for function in prune(self.model, QUANTITIES)
        }
        self.exact = {name: self._values(name, 0.0, np.longdouble) for name in QUANTITIES}

    def error(self, quantity: str, offset: float, number: type[np.floating[Any]]) -> float | None:
        """Return the largest error relative to the largest exact value, None if it is not finite."""
        found, exact = self._values(quantity, offset, number), self.exact[quantity]
        error = float(np.abs(found - exact).max() / np.abs(exact).max())
        return error if np.isfinite(error) else None

    def _values(self, quantity: str, offset: float, number: type[np.floating[Any]]) -> np.ndarray:
        arguments = {name: item.nominal for name, item in self.model.arguments.items()}
        arguments["coordinate"] = _move(self.model, offset)
        return evaluate_in(number, self.functions[quantity], arguments)


def _move(model: SymbolicModel, offset: float) -> np.ndarray:
    """Return the nominal coordinates, the absolute ones among them moved by the offset in more digits."""
    frame, coordinate = model.frame, model.arguments["coordinate"].nominal.astype(np.longdouble)
    absolute = [
        bool(frame.coordinate_node_axis) or name.startswith("centre") for name in frame.coordinate_name
    ]
    return np.asarray(np.where(absolute, coordinate + np.longdouble(offset), coordinate))


def compare_offset_trajectories(
    structure: Structure | None = None,
    offsets: Iterable[float] = OFFSETS,
    *,
    t_end: float = 1.0,
    step: float = 1e-3,
    samples: int = 101,
) -> dict[str, Any]:
    """Return how far tensions of a simulation in double precision stray from those at the origin.

    structure: a free prism if not given. time (n_t,) [s]; then formulation -> offset -> (n_t,) largest
    difference of a member tension [N] from the run in node distances at the origin, with equal steps of
    Runge-Kutta 4 in C; a run in which nodes coincide at the start has no entry.
    """
    structure = structure or sample_prism()
    models = {name: compile_in(structure, name) for name in FORMULATIONS}
    result: dict[str, Any] = {name: {} for name in FORMULATIONS}
    truth = simulate(models["node_distance"], t_end, samples=samples, method="rk4", step=step)
    for name, model in models.items():
        symbolic = build_model(structure, ModelRequest((), formulation=name))
        for offset in offsets:
            start = _move(symbolic, float(offset)).astype(np.float64)
            run = simulate(model, t_end, samples=samples, method="rk4", step=step, coordinate=start)
            count = len(run.time)
            apart = np.abs(run.member_tension - truth.member_tension[:count])
            result[name][float(offset)] = apart.max(axis=1)
    return {"time": truth.time, "largest_tension": float(np.abs(truth.member_tension).max()), **result}
