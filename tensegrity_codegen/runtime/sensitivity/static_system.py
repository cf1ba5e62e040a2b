"""The equations of an equilibrium to first order: what one metre of rest length does to forces and tensions.

    K dx + J^T dt_b = F drho        forces on the coordinates stay in balance
    J dx            = dl_b          rigid bars keep their lengths, which may change themselves
    dt = T dx + diag(s) drho        tensions of springs follow; those of rigid bars are unknowns

K: tangent stiffness, with that of the forces in rigid bars; F = df/drho; T = dt/dx; s = dt/drho.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.bar_problem import BarProblem
from tensegrity_codegen.runtime.statics.body_problem import BodyProblem
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.manifest import Manifest

REST_LENGTH_QUANTITIES = (
    "residual_rest_length_jacobian",
    "tension_rest_length_derivative",
    "tension_jacobian",
)


@dataclass(frozen=True)
class StaticSystem:
    """Matrices at one equilibrium, over the coordinates x of its static problem [m].

    stiffness: K (n, n).
    constraint: J (n_bars, n).
    bar (n_bars,): members of the rows of J.
    force: F (n, n_members).
    tension_jacobian: T (n_members, n).
    tension_rest_length_derivative: s (n_members,).
    scale (n,): x = scale q of the model's coordinates q.
    node_jacobian: (3 n_nodes, n) of bodies, None where coordinates are those of nodes.
    """

    stiffness: Any
    constraint: Any
    bar: IntArray
    force: Any
    tension_jacobian: Any
    tension_rest_length_derivative: FloatArray
    scale: FloatArray
    node_jacobian: Any = None

    def build_gauge_rows(self, motions: FloatArray) -> Any:
        """Return the rows that set the share of rigid motions (n, k) to zero, (k, n), sparse.

        Row k times dx: the product of the node displacements of dx with those of motion k.
        """
        if self.node_jacobian is None:
            return scipy.sparse.csc_array(motions.T)
        return scipy.sparse.csc_array((self.node_jacobian @ motions).T @ self.node_jacobian)


def build_system(problem: StaticProblem, point: Point) -> StaticSystem:
    """Return the first-order equations at an equilibrium.

    problem: with the quantities of REST_LENGTH_QUANTITIES; point: the equilibrium, in the coordinates of the
    problem.
    Raises NonFiniteError: a derivative is not finite there.
    """
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
