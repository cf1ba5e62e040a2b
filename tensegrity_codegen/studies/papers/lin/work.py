"""The work of a load along a path of equilibria against the change of potential.

W = integral of lambda F . dx over the path, by Gauss quadrature on each stretch between two points of the
continuation, with an equilibrium solved for at every node of the quadrature. A stretch is parametrised by
the distance along its chord in (q, lambda), which goes through limit points; points lie at every kink.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.paths.load_path import LoadPath
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.paths.path_solver import PathSolver
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

NODES = 12  # of the quadrature on each stretch


def compare_work(problem: ModelPath, path: LoadPath, *, nodes: int = NODES) -> dict[str, Any]:
    """Return the load's work along a path, the change of strain energy and weight, and their difference [J].

    Raises ConvergenceError where a point between two points of the path is not found.
    """
    solver = PathSolver(problem, (1.0, float(np.abs(path.load_factor).max()) or 1.0))
    places = [solver.join(q, load) for q, load in zip(path.coordinate, path.load_factor, strict=True)]
    work = sum(_stretch(solver, first, last, nodes) for first, last in pairwise(places))
    ends = [float(problem.compute("potential_energy", path.coordinate[k], 0.0)) for k in (0, -1)]
    change = ends[1] - ends[0]
    return {
        "work": float(work),
        "potential_change": change,
        "difference": float(work) - change,
        "n_points": len(places) + nodes * (len(places) - 1),
    }


def _stretch(solver: PathSolver, first: FloatArray, last: FloatArray, nodes: int) -> float:
    """Return the integral of lambda f . dq from one point of the path to the next [J]."""
    chord = last - first
    length = float(np.linalg.norm(chord))
    if length == 0.0:
        return 0.0
    along = chord / length
    place, weight = np.polynomial.legendre.leggauss(nodes)
    total = 0.0
    for part, share in zip((place + 1) / 2, weight / 2, strict=True):
        state = solver.solve(first + part * chord, along, float(along @ first) + part * length)
        tangent = None if state is None else solver.tangent(state, along)
        if state is None or tangent is None:
            raise ConvergenceError(
                "a point between two points of the path was not found",
                evidence={"load_factor": float(first[-1] * solver.load_scale)},
                where="compare_work",
                hint="follow the path with shorter steps",
            )
        moved = tangent[:-1] * (length / float(along @ tangent)) * solver.coordinate_scale
        load = solver.problem.load_vector(state.coordinate, state.load_factor)
        total += share * state.load_factor * float(load @ moved)
    return total
