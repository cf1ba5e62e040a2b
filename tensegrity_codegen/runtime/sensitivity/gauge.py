"""Rigid motions that cost no force at an equilibrium: found, named, and what nodes do in them."""

import numpy as np

from tensegrity_codegen.runtime.sensitivity.static_system import StaticSystem
from tensegrity_codegen.runtime.statics.bar_problem import BarProblem
from tensegrity_codegen.runtime.statics.factors import SINGULAR_TOLERANCE
from tensegrity_codegen.runtime.statics.neutral_motion import find_neutral
from tensegrity_codegen.runtime.statics.newton import Stability
from tensegrity_codegen.runtime.statics.rigid_motion import find_neutral_motions
from tensegrity_codegen.runtime.statics.static_problem import EPSILON, Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray


def find_gauge(problem: StaticProblem, point: Point, system: StaticSystem) -> tuple[FloatArray, float]:
    """Return the motions over the coordinates x, (n, k) orthonormal, and the rounding of eigenvalues [N/m].

    What is left of the forces, and the rounding of positions far from the origin, blur the stiffness.
    """
    position = problem.node_position(point.coordinate)
    size = float(abs(system.stiffness).sum(axis=0).max(initial=0.0))
    reach = float(np.abs(position).max(initial=0.0))
    far = max(1.0, reach / point.longest) if point.longest else 1.0
    spread = float(np.linalg.norm(position - position.mean(axis=0)))
    blur = 10 * float(np.linalg.norm(point.residual)) / max(spread, 1e-300) + EPSILON * far * size
    if isinstance(problem, BarProblem):  # whose own motions go along the directions that keep the lengths
        motions = StaticProblem.rigid_motions(problem, point.coordinate)
    else:
        motions = problem.rigid_motions(point.coordinate)
    return find_neutral_motions(system.stiffness, motions, blur), SINGULAR_TOLERANCE * size + blur


def find_node_velocities(problem: StaticProblem, point: Point, moved: FloatArray) -> FloatArray:
    """Return how nodes move along columns over the coordinates x, (n_nodes, 3, k)."""
    if isinstance(problem, BarProblem):  # as above
        return StaticProblem.node_velocities(problem, point.coordinate, moved)
    return problem.node_velocities(point.coordinate, moved)


def name_gauge(
    problem: StaticProblem, point: Point, gauge: FloatArray, eigenvalue: float, direction: FloatArray
) -> tuple[str, ...]:
    """Return the motions in words: "slide along x", "turn about z"."""
    if not gauge.shape[1]:
        return ()
    if isinstance(problem, BarProblem):
        directions = problem.directions(point.coordinate)
        gauge, direction = np.asarray(directions.T @ gauge), np.asarray(directions.T @ direction)
    count = gauge.shape[1]
    stability = Stability(abs(eigenvalue), direction, count, 0.0, eigenvalue, gauge)
    return find_neutral(problem, point.coordinate, stability).names
