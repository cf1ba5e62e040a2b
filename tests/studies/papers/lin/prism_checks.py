"""Errors and gaps in the print of LIN, each as a check to run again; the work of a load along a path."""

from itertools import pairwise, permutations
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.load_path import LoadPath
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.paths.path_solver import PathSolver
from tensegrity_codegen.studies.papers.lin.tables import (
    COLUMNS,
    LOADS,
    TOPS,
    compile_prism,
    compute_extensions,
    find_nearest_symmetrical,
    place_load,
    read_tables,
    settle,
)
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

# The order that Appendix A and section 2 suggest: L_1..L_3 side springs (A.1-A.3), L_4..L_6 top springs.
STATED = ("A1B2", "A2B3", "A3B1", "B1B2", "B2B3", "B3B1")
RADIUS_ANGLE = np.radians([90.0, 210.0, 330.0])  # gamma_i


def check_errata() -> dict[str, dict[str, Any]]:
    """Return all checks by name; docs/errata.md says what each of them shows."""
    return {
        "column_order": check_column_order(),
        "generalised_forces": check_generalised_forces(),
        "unloaded_row": check_unloaded_row(),
    }


def check_column_order() -> dict[str, Any]:
    """Return how well each order of the six springs fits the columns of Table 2.

    All 720 orders are tried. best, second: the two with the smallest mean difference [mm]; stated: the order
    of the text, with its mean and largest difference [mm].
    """
    printed = read_tables()["computed"]
    ours = compute_extensions(LOADS)
    orders = list(permutations(range(6)))
    mean = np.array([np.abs(ours[:, order] - printed).mean() for order in orders])
    first, second = (int(k) for k in np.argsort(mean)[:2])
    stated = [COLUMNS.index(name) for name in STATED]
    apart = np.abs(ours[:, stated] - printed)
    return {
        "best": tuple(COLUMNS[k] for k in orders[first]),
        "best_mean": float(mean[first]),
        "second": tuple(COLUMNS[k] for k in orders[second]),
        "second_mean": float(mean[second]),
        "stated": STATED,
        "stated_mean": float(apart.mean()),
        "stated_largest": float(apart.max()),
    }


def check_generalised_forces() -> dict[str, Any]:
    """Return how far (8)-(13) are from J^T F, for unit forces on B_i along x, y and z, at 5 N on B_3 [m].

    printed (3,): largest difference of any of the six, with alpha_i as in (A.1)-(A.6), from the outward
    radius of A_i; with_radius_angle (3,): the same with alpha_i + gamma_i in its place.
    """
    model = compile_prism()
    place = settle(model, np.array([place_load(3, (0.0, 0.0, -5.0))])).coordinate[0]
    jacobian = model.compute("node_jacobian", coordinate=place).toarray()
    names, nodes = model.manifest.coordinate_name, model.manifest.node_name
    azimuth = np.array([place[names.index(f"bar{k}_azimuth")] for k in (1, 2, 3)])
    elevation = np.array([place[names.index(f"bar{k}_elevation")] for k in (1, 2, 3)])
    columns = [names.index(f"bar{k}_{angle}") for angle in ("azimuth", "elevation") for k in (1, 2, 3)]
    length = _bar_length(model)
    difference = np.zeros((2, 3))
    for axis in range(3):
        force = np.tile(np.eye(3)[axis], (3, 1))
        right = sum(
            jacobian[3 * nodes.index(top) : 3 * nodes.index(top) + 3, columns].T @ force[k]
            for k, top in enumerate(TOPS)
        )
        for row, angle in enumerate((azimuth, azimuth + RADIUS_ANGLE)):
            # (8)-(13), alpha before beta, (6,), from forces (3, 3), one row a top
            x, y, z = force.T
            turning = length * np.cos(elevation) * (-x * np.sin(angle) + y * np.cos(angle))
            across = x * np.cos(angle) + y * np.sin(angle)
            lifting = length * (z * np.cos(elevation) - across * np.sin(elevation))
            difference[row, axis] = np.abs(np.concatenate([turning, lifting]) - right).max()
    return {"printed": difference[0], "with_radius_angle": difference[1]}


def check_unloaded_row() -> dict[str, Any]:
    """Return why the first row of Table 2 is no configuration of the printed prism.

    spread: how far springs of one kind differ in it though nothing tells them apart [mm]; nearest: least
    difference of any symmetrical configuration [mm], see find_nearest_symmetrical.
    """
    first = read_tables()["computed"][0]
    nearest = find_nearest_symmetrical()
    return {
        "printed_top": float(first[:3].mean()),
        "printed_side": float(first[3:].mean()),
        "spread": float(max(np.ptp(first[:3]), np.ptp(first[3:]))),
        "nearest_top": nearest["top"],
        "nearest_side": nearest["side"],
        "distance": nearest["distance"],
    }


def _bar_length(model: CompiledModel) -> float:
    place = model.compute("node_position")
    nodes = model.manifest.node_name
    return float(np.linalg.norm(place[nodes.index("bar1_B")] - place[nodes.index("bar1_A")]))


# The work of a load along a path of equilibria against the change of potential.
#
# W = integral of lambda F . dx over the path, by Gauss quadrature on each stretch between two points of the
# continuation, with an equilibrium solved for at every node of the quadrature. A stretch is parametrised by
# the distance along its chord in (q, lambda), which goes through limit points; points lie at every kink.


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
