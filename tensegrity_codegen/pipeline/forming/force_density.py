"""Shapes of nets whose force densities are stated: linear equations (Schek 1974).

With the tension over the length q_e of each member, the forces at a node are linear in positions:
D x = p, D = C^T diag(q) C with the differences C of the ends of members. Where forces t_e are stated the
shape is a stationary point of the energy sum(q_e l_e^2 / 2) + sum(t_e l_e) - p x, found by Newton's method.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.runtime.statics.factors import Factoriser
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError
from tensegrity_codegen.system.summaries import count_names

FIRST_SHAPES = 5  # with q_e = t_e / l_e of the one before, from which Newton's method begins
MOST_STEPS = 100
LEAST_RESIDUAL = 1e-12  # of the largest force: a residual from which the shape is found
SINGULAR = 1e-11  # smallest over largest pivot
LEAST_LENGTH = 1e-6  # of the structure's size: a shorter member has no direction


@dataclass(frozen=True)
class DensityShape:
    """A shape in balance: node_position (n_nodes, 3) [m], force_density (n_members,) [N/m]."""

    node_position: FloatArray
    force_density: FloatArray


def static_load(structure: Structure) -> FloatArray:
    """Return loads and weights of all nodes, (n_nodes, 3) [N]."""
    return np.asarray(structure.node_load + structure.lumped_mass[:, None] * structure.gravity)


def sum_forces(structure: Structure, position: FloatArray, q: FloatArray) -> FloatArray:
    """Return loads, weights and the pull of members with force densities q at all nodes, (n_nodes, 3) [N]."""
    i, j = structure.connectivity.T
    pull = q[:, None] * (position[j] - position[i])
    force = static_load(structure)
    np.add.at(force, i, pull)
    np.add.at(force, j, -pull)
    return force


def find_density_shape(structure: Structure, density: FloatArray, force: FloatArray) -> DensityShape:
    """Return the shape with densities [N/m] of members, or forces [N] where these are not nan."""
    position = structure.node_position.copy()
    size = float(np.ptp(position, axis=0).max(initial=0.0)) or 1.0
    is_force = np.isfinite(force)
    factoriser = Factoriser()
    for _ in range(FIRST_SHAPES if is_force.any() else 1):
        q = np.where(is_force, force / check_lengths(structure, position, size), density)
        position = _solve(structure, q, position, factoriser)
    length = check_lengths(structure, position, size)
    if not is_force.any():
        return DensityShape(position, q)
    newton = _Energy(structure, np.where(is_force, 0.0, density), np.where(is_force, force, 0.0))
    position, steps, residual = newton.minimise(position, size)
    length = check_lengths(structure, position, size)
    q = np.where(is_force, force / length, density)
    largest = float(np.abs(q * length).max())
    if residual <= 1e3 * LEAST_RESIDUAL * largest:
        return DensityShape(position, q)
    raise ConvergenceError(
        "the forces have no shape in balance",
        evidence={"steps": steps, "residual": residual, "largest_force": largest},
        where=structure.name,
        hint="state force densities of some of these members",
    )


class _Energy:
    """Energy of members with force densities q and forces t, zero where the other one is stated."""

    def __init__(self, structure: Structure, density: FloatArray, force: FloatArray) -> None:
        self.structure, self.density, self.force = structure, density, force
        self.i, self.j = structure.connectivity.T
        index = np.full((structure.n_nodes, 3), -1)
        node, axis = structure.coordinate_node_axis.T
        index[node, axis] = np.arange(len(node))
        self.node, self.axis = node, axis
        ends = np.stack([index[self.i], index[self.j]], axis=1)  # (n_members, 2, 3)
        self.rows = np.broadcast_to(ends[:, :, :, None, None], (*ends.shape, 2, 3)).reshape(-1)
        self.columns = np.broadcast_to(ends[:, None, None, :, :], (*ends.shape, 2, 3)).reshape(-1)
        self.is_free = (self.rows >= 0) & (self.columns >= 0)
        self.factoriser = Factoriser()

    def find_force(self, position: FloatArray) -> FloatArray:
        """Return the force on every coordinate, minus the slope of the energy."""
        q = self.density + self.force / np.linalg.norm(position[self.j] - position[self.i], axis=1)
        return np.asarray(sum_forces(self.structure, position, q)[self.node, self.axis])

    def find_step(self, position: FloatArray, force: FloatArray) -> FloatArray:
        """Return the step of Newton's method, with more stiffness where that has directions without any."""
        span = position[self.j] - position[self.i]
        length = np.linalg.norm(span, axis=1)
        along, q = span / length[:, None], self.force / length
        block = (self.density + q)[:, None, None] * np.eye(3)
        block = block - q[:, None, None] * along[:, :, None] * along[:, None, :]
        signs = np.array([[1.0, -1.0], [-1.0, 1.0]])
        values = (signs[None, :, None, :, None] * block[:, None, :, None, :]).reshape(-1)
        n, free = len(force), self.is_free
        matrix = scipy.sparse.csc_array((values[free], (self.rows[free], self.columns[free])), shape=(n, n))
        mean = float(np.abs(matrix.diagonal()).mean())
        for shift in (0.0, 1e-6, 1e-3, 1e-1, 1.0, 10.0):
            shifted = scipy.sparse.csc_array(matrix + shift * mean * scipy.sparse.eye_array(n, format="csc"))
            solve = self.factoriser.factorise(shifted)
            if solve is not None:
                step = solve(force)
                if np.isfinite(step).all():
                    return step
        return force / mean

    def minimise(self, position: FloatArray, size: float) -> tuple[FloatArray, int, float]:
        """Return positions, steps and the largest residual [N] where no step makes that smaller."""
        force = self.find_force(position)
        largest = float(np.abs(self.force).max())
        for count in range(MOST_STEPS):
            residual = float(np.abs(force).max(initial=0.0))
            if residual <= LEAST_RESIDUAL * largest:
                return position, count, residual
            step = self.find_step(position, force)
            step *= min(1.0, 0.3 * size / float(np.abs(step).max()))
            for _ in range(12):
                trial = position.copy()
                trial[self.node, self.axis] += step
                after = self.find_force(trial)
                if np.linalg.norm(after) < np.linalg.norm(force):
                    break
                step /= 3.0
            else:
                return position, count, residual
            position, force = trial, after
        return position, MOST_STEPS, residual


def check_lengths(structure: Structure, position: FloatArray, size: float) -> FloatArray:
    """Return the lengths of members; raises ConvergenceError for one that is a point."""
    ends = position[structure.connectivity]
    length = np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    points = np.flatnonzero(length < LEAST_LENGTH * size)
    if points.size:
        names = [structure.member_name[e] for e in points]
        raise ConvergenceError(
            "members have shrunk to points",
            where=f"{structure.name}: members",
            evidence={"members": count_names(names), "shortest": float(length.min())},
            hint="anchor more nodes, or state a length of these members",
        )
    return length


def _solve(structure: Structure, q: FloatArray, position: FloatArray, factoriser: Factoriser) -> FloatArray:
    """Return the positions with force densities q."""
    i, j = structure.connectivity.T
    n, ones = structure.n_nodes, np.concatenate([q, q])
    rows, columns = np.concatenate([i, j]), np.concatenate([j, i])
    matrix = scipy.sparse.csr_array((-ones, (rows, columns)), shape=(n, n))
    matrix = scipy.sparse.csr_array(matrix + scipy.sparse.diags_array(np.bincount(rows, ones, n)))
    load, moved = static_load(structure), position.copy()
    held = [structure.node_anchored[:, axis] for axis in structure.axes]
    for group in {mask.tobytes() for mask in held}:  # axes along which the same nodes are anchored
        axes = [axis for axis, mask in zip(structure.axes, held, strict=True) if mask.tobytes() == group]
        fixed = structure.node_anchored[:, axes[0]]
        free = ~fixed
        if not free.any():
            continue
        reduced = scipy.sparse.csc_array(matrix[free][:, free])
        right = load[free][:, axes] - matrix[free][:, fixed] @ position[fixed][:, axes]
        solve = factoriser.factorise(reduced)
        if solve is None or not _is_regular(reduced, solve):
            solution = _solve_indefinite(structure, reduced, right, free, q)
        else:
            solution = np.stack([solve(column) for column in right.T], axis=1)
        for axis, column in zip(axes, solution.T, strict=True):
            moved[free, axis] = column
    return moved


def _is_regular(matrix: "scipy.sparse.csc_array", solve: "object") -> bool:
    """Return whether the factors of a matrix with a positive diagonal solve it."""
    n = matrix.shape[0]
    probe = np.cos(np.arange(n))  # no eigenvector of anything
    solution = solve(matrix @ probe)  # type: ignore[operator]
    return bool(np.abs(solution - probe).max() < 1e-6)


def _solve_indefinite(
    structure: Structure,
    matrix: "scipy.sparse.csc_array",
    right: FloatArray,
    free: NDArray[np.bool_],
    q: FloatArray,
) -> FloatArray:
    """Return D^-1 p for densities of both signs; raises ConvergenceError where D is singular."""
    nodes = np.flatnonzero(free)
    try:
        factors = scipy.sparse.linalg.splu(matrix)
        pivots = np.abs(factors.U.diagonal())
        is_singular = pivots.min() <= SINGULAR * pivots.max()
    except RuntimeError:  # exactly singular
        is_singular = True
    if not is_singular:
        return np.asarray(factors.solve(right))
    shift = 1e-10 * float(np.abs(matrix.diagonal()).max() or 1.0)
    shifted = scipy.sparse.linalg.splu(matrix + shift * scipy.sparse.eye_array(len(nodes), format="csc"))
    null = np.cos(np.arange(len(nodes)))
    for _ in range(5):  # inverse iteration
        null = shifted.solve(null)
        null /= np.abs(null).max()
    moving = [structure.node_name[k] for k in nodes[np.abs(null) > 0.1]]
    motion = np.zeros(structure.n_nodes)
    motion[nodes] = null
    i, j = structure.connectivity.T
    weight = np.abs(q * (motion[i] - motion[j]))
    location = f"{structure.name}: force densities"
    if (weight <= 1e-6 * np.abs(q).max()).all():
        problem, hint = "nothing holds some nodes", "anchor one of them, or state lengths of bars"
        raise ConvergenceError(problem, evidence={"nodes": count_names(moving)}, where=location, hint=hint)
    named = [structure.member_name[e] for e in np.flatnonzero(weight > 0.1 * weight.max())]
    raise ConvergenceError(
        "force densities of both signs cancel: the shape is not determined",
        evidence={"nodes": count_names(moving), "members": count_names(named)},
        where=location,
        hint="change these densities, or state lengths of bars",
    )
