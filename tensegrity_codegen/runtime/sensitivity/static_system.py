"""The equations of an equilibrium to first order: changes of forces and tensions by one metre of rest length.

    K dx + J^T dt_b = F drho        forces on the coordinates stay in balance
    J dx            = dl_b          rigid bars keep their lengths, which may change themselves
    dt = T dx + diag(s) drho        tensions of springs follow; those of rigid bars are unknowns

K: tangent stiffness, with that of the forces in rigid bars; F = df/drho; T = dt/dx; s = dt/drho.

They are solved by one sparse factorisation of the stiffness bordered by rigid bars and by a gauge.

    [K J^T C^T] [dx]   [right]        K R = 0, J R = 0: rigid motions that cost no force
    [J  0   0 ] [dt] = [dl   ]        C R regular: rows that hold them
    [C  0   0 ] [mu]   [0    ]        mu = 0 up to rounding: forces within the structure are orthogonal to R

The block of the inverse that belongs to dx, with R projected off, is Z (Z^T K Z)^-1 Z^T with Z the directions
orthogonal to J and R: its largest eigenvalue is one over the eigenvalue of the stiffness nearest zero.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.constrained_problems import BarProblem, BodyProblem
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT, SINGULAR_TOLERANCE
from tensegrity_codegen.runtime.statics.neutral_motion import find_neutral
from tensegrity_codegen.runtime.statics.newton import Stability
from tensegrity_codegen.runtime.statics.static_problem import (
    EPSILON,
    Point,
    StaticProblem,
    find_neutral_motions,
)
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.manifest import Manifest

REST_LENGTH_QUANTITIES = (
    "residual_rest_length_jacobian",
    "tension_rest_length_derivative",
    "tension_jacobian",
)
MIN_RAISE = float(np.finfo(np.float64).eps)  # [N/m], where a structure has no stiffness at all


@dataclass(frozen=True)
class StaticSystem:
    """Matrices at one equilibrium, over the coordinates x of its static problem [m]."""

    stiffness: Any  # K (n, n)
    constraint: Any  # J (n_bars, n)
    bar: IntArray  # (n_bars,), members of the rows of J
    force: Any  # F (n, n_members)
    tension_jacobian: Any  # T (n_members, n)
    tension_rest_length_derivative: FloatArray  # s (n_members,)
    scale: FloatArray  # (n,), x = scale q of the model's coordinates q
    node_jacobian: Any = None  # (3 n_nodes, n) of bodies, None if coordinates are those of nodes

    def build_gauge_rows(self, motions: FloatArray) -> Any:
        """Return rows (k, n) that set rigid motions (n, k) to zero, as products of node displacements."""
        if self.node_jacobian is None:
            return scipy.sparse.csc_array(motions.T)
        return scipy.sparse.csc_array((self.node_jacobian @ motions).T @ self.node_jacobian)


def build_system(problem: StaticProblem, point: Point) -> StaticSystem:
    """Return the first-order equations at an equilibrium; raises NonFiniteError for its derivatives."""
    x = point.coordinate
    scale = problem.scale if isinstance(problem, BodyProblem) else np.ones(len(x))
    per_metre = scipy.sparse.diags_array(1.0 / scale)
    force, slope, tension_jacobian = _find_springs(problem, x)
    if isinstance(problem, BarProblem):
        stiffness, constraint, bar = _with_bars(problem, point)
    else:
        stiffness, constraint = problem.stiffness(x), scipy.sparse.csc_array((0, len(x)))
        bar = np.zeros(0, dtype=np.int64)
    return StaticSystem(
        scipy.sparse.csc_array(stiffness),
        scipy.sparse.csc_array(constraint),
        bar,
        scipy.sparse.csc_array(per_metre @ force),
        scipy.sparse.csc_array(tension_jacobian @ per_metre),
        np.array(slope, dtype=float),
        scale,
        scipy.sparse.csc_array(problem.compute("node_jacobian", x) @ per_metre)
        if isinstance(problem, BodyProblem)
        else None,
    )


def has_springs(manifest: Manifest) -> bool:
    """Return whether a member is a spring: only then are there the quantities of REST_LENGTH_QUANTITIES."""
    return len(manifest.rigid_bar) < len(manifest.member_name)


def _find_springs(problem: StaticProblem, x: FloatArray) -> tuple[Any, Any, Any]:
    """Return df/drho, dt/drho and dt/dq over the model's coordinates."""
    if has_springs(problem.model.manifest):
        force, slope, tension_jacobian = (problem.compute(name, x) for name in REST_LENGTH_QUANTITIES)
        return force, slope, tension_jacobian
    count = len(problem.model.manifest.member_name)
    return scipy.sparse.csc_array((len(x), count)), np.zeros(count), scipy.sparse.csc_array((count, len(x)))


def _with_bars(problem: BarProblem, point: Point) -> tuple[Any, Any, IntArray]:
    """Return K with d2l/dx2 = (I - u u^T) / l of each rigid bar times its tension, J and the bars."""
    bars, x = problem.bars, point.coordinate
    density = point.tension[bars.row] / bars.length
    constraint = bars.jacobian(problem.node_position(x))
    along = constraint.T @ scipy.sparse.diags_array(density) @ constraint
    stiffness = problem.compute("tangent_stiffness", x) + bars.stiffness(density) - along
    return stiffness, constraint, bars.row


class Bordered:
    """The factors of a stiffness with rows `border` (n_border, n), which hold the motions `held` (n, k)."""

    def __init__(self, stiffness: Any, border: Any, held: FloatArray) -> None:
        self._held = held  # orthonormal columns
        self.size, n_border = stiffness.shape[0], border.shape[0]
        self.unit = float(abs(stiffness).max()) if stiffness.nnz else 1.0  # of the border's rows [N/m]
        self.unit = self.unit or 1.0
        rows = scipy.sparse.csc_array(self.unit * border)
        corner = scipy.sparse.csc_array((n_border, n_border))
        self._matrix = scipy.sparse.block_array([[stiffness, rows.T], [rows, corner]], format="csc")
        self._factor = scipy.sparse.linalg.splu(self._matrix)

    def solve(self, right: FloatArray, border: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return dx (n, k), multipliers and the change by a refinement; border: required border dx [m]."""
        right_side = np.vstack([right, self.unit * border])
        solution = self._factor.solve(right_side)
        change = self._factor.solve(right_side - self._matrix @ solution)
        solution += change
        moved, changed = np.abs(solution[: self.size]), np.abs(change[: self.size])
        largest = float(moved.max(initial=0.0))
        relative = float(changed.max(initial=0.0)) / largest if largest else 0.0
        return solution[: self.size], self.unit * solution[self.size :], relative

    def find_softest(self) -> tuple[float, FloatArray]:
        """Return the eigenvalue of the stiffness nearest zero, within the border [N/m], and its direction."""
        size = self.size
        if size <= DENSE_LIMIT:
            inverse = self._flexibility(np.eye(size))
            values, vectors = np.linalg.eigh((inverse + inverse.T) / 2)
            softest = int(np.abs(values).argmax())
            value, vector = float(values[softest]), vectors[:, softest]
        else:
            operator = scipy.sparse.linalg.LinearOperator(
                (size, size), matvec=lambda v: self._flexibility(np.ravel(v)[:, None])[:, 0], dtype=float
            )
            start = np.random.default_rng(0).normal(size=size)
            eigenvalues, columns = scipy.sparse.linalg.eigsh(operator, k=1, which="LM", v0=start, tol=1e-6)
            value, vector = float(eigenvalues[0]), columns[:, 0]
        return (1.0 / value if value else float("inf")), vector

    def _flexibility(self, right: FloatArray) -> FloatArray:
        right_side = np.zeros((self._matrix.shape[0], right.shape[1]))
        right_side[: self.size] = self._project(right)
        return self._project(self._factor.solve(right_side)[: self.size])

    def _project(self, columns: FloatArray) -> FloatArray:
        projected: FloatArray = columns - self._held @ (self._held.T @ columns)
        return projected


def factorise(stiffness: Any, border: Any, held: FloatArray, rounding: float) -> tuple[Bordered, bool]:
    """Return the factors, and whether they are regular; else of a stiffness raised by `rounding` or more."""
    try:
        return Bordered(stiffness, border, held), True
    except RuntimeError:  # a pivot is zero
        raised = rounding or MIN_RAISE
    while True:
        try:
            raised_stiffness = stiffness + raised * scipy.sparse.eye_array(stiffness.shape[0])
            return Bordered(scipy.sparse.csc_array(raised_stiffness), border, held), False
        except RuntimeError:  # a pivot is still zero, as where rounding takes away what was added
            raised *= 100


def find_gauge(problem: StaticProblem, point: Point, system: StaticSystem) -> tuple[FloatArray, float]:
    """Return the motions over x, (n, k) orthonormal, and the rounding of eigenvalues [N/m] by left forces."""
    position = problem.node_position(point.coordinate)
    size = float(abs(system.stiffness).sum(axis=0).max(initial=0.0))
    reach = float(np.abs(position).max(initial=0.0))
    distance_ratio = max(1.0, reach / point.longest) if point.longest else 1.0
    spread = float(np.linalg.norm(position - position.mean(axis=0)))
    blur = 10 * float(np.linalg.norm(point.residual)) / max(spread, 1e-300) + EPSILON * distance_ratio * size
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
