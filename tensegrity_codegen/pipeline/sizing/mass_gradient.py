"""Derivatives of the least mass by positions of nodes, at the constraints that are active.

At an optimum the tensions t of loaded members and the masses m solve the active constraints R(t, m, x) = 0:
balance A(x) t = load, masses equal to what a force needs, tensions at a limit or at a kink of the mass. With
multipliers y of R in the Lagrangian, d(sum m)/dx = -y dR/dx (envelope theorem). Where moving a node needs a
force in a member that has none, y is not unique and there is no derivative: such a force costs mass by its
square root.
"""

import numpy as np

from tensegrity_codegen.pipeline.sizing.member_mass import MassLaw
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

ACTIVE = 1e-7  # relative difference of masses or forces that count as equal
SINGULAR = 1e-9  # singular values over the largest one that count as zero


def find_mass_gradient(
    structure: Structure,
    law: MassLaw,
    tension: FloatArray,
    matrix: FloatArray,
    limits: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Return the derivatives of the least mass by positions, (n_nodes, 3) [kg/m]; nan without any."""
    system = _ActiveConstraints(structure, law, tension, matrix, limits)
    gradient = system.differentiate(tension != 0)
    if np.isnan(gradient).any():  # in a case that does not decide a section a force from zero costs nothing
        idle = system.differentiate((tension != 0) | (system.most_mass > 0))
        gradient = np.where(np.isnan(gradient), idle, gradient)
    gradient = gradient.reshape(structure.n_nodes, 3)
    gradient[:, [axis for axis in range(3) if axis not in structure.axes]] = np.nan
    return gradient


class _ActiveConstraints:
    """Active constraints at an optimum, differentiated by tensions, masses and positions."""

    def __init__(
        self,
        structure: Structure,
        law: MassLaw,
        tension: FloatArray,
        matrix: FloatArray,
        limits: tuple[FloatArray, FloatArray],
    ) -> None:
        self.tension, self.matrix = tension, matrix
        mass = law.find_mass(tension)
        self.most_mass = mass.max(axis=0)
        self.by_tension, self.by_length = law.find_slopes(tension)
        self.stretch = equilibrium_matrix(structure.node_position, structure.connectivity).T  # d(length)/dx
        self.turn = [move_balance(structure, case) for case in tension]
        loaded, margin = tension != 0, ACTIVE * np.abs(tension)
        self.decides = loaded & (mass >= self.most_mass * (1 - ACTIVE))
        at_limit = loaded & (np.minimum(*(np.abs(tension - limit) for limit in limits)) <= margin)
        at_kink = loaded & (np.abs(tension + law.kink) <= margin)
        self.is_fixed = at_limit | at_kink
        # The kink is in proportion to the square of the length.
        self.by_kink = np.where(at_kink & ~at_limit, 2.0 * np.where(at_kink, law.kink, 0.0) / law.length, 0.0)

    def differentiate(self, is_free: BoolArray) -> FloatArray:
        """Return the derivatives (3 n_nodes,), where tensions that are not free stay zero."""
        cases, members = is_free.shape
        used, loaded = np.flatnonzero(is_free), np.flatnonzero(self.most_mass > 0)
        of_tension = np.full(is_free.shape, -1)
        of_tension[is_free] = np.arange(len(used))
        of_mass = np.full(members, -1)
        of_mass[loaded] = len(used) + np.arange(len(loaded))
        width = len(used) + len(loaded)
        rows, moved = [], []
        for k in range(cases):
            block = np.zeros((len(self.matrix), width))
            block[:, of_tension[k][is_free[k]]] = self.matrix[:, is_free[k]]
            rows.append(block)
            moved.append(self.turn[k])
        for k, e in zip(*np.nonzero(self.decides), strict=True):
            row = np.zeros((1, width))
            row[0, of_mass[e]], row[0, of_tension[k, e]] = 1.0, -self.by_tension[k, e]
            rows.append(row)
            moved.append(-self.by_length[k, e] * self.stretch[e][None])
        for k, e in zip(*np.nonzero(self.is_fixed), strict=True):
            row = np.zeros((1, width))
            row[0, of_tension[k, e]] = 1.0
            rows.append(row)
            moved.append(self.by_kink[k, e] * self.stretch[e][None])
        return _apply_multipliers(np.concatenate(rows), np.concatenate(moved), len(loaded))


def _apply_multipliers(rows: FloatArray, moved: FloatArray, n_masses: int) -> FloatArray:
    """Return -y dR/dx for the multipliers y of the constraints, nan where these are not unique."""
    scale = np.abs(rows).max(axis=1)
    scale = np.where(scale > 0, scale, 1.0)  # nodes whose members carry nothing
    rows, moved = rows / scale[:, None], moved / scale[:, None]
    columns = np.abs(rows).max(axis=0)
    rows = rows / columns
    price = np.zeros(rows.shape[1])
    price[-n_masses:] = 1.0 / columns[-n_masses:]
    left_vectors, value, right_vectors = np.linalg.svd(rows, full_matrices=True)
    rank = int((value > SINGULAR * value[0]).sum())
    y = left_vectors[:, :rank] @ ((right_vectors[:rank] @ price) / value[:rank])
    gradient = -(y @ moved)
    free = np.abs(left_vectors[:, rank:].T @ moved).max(axis=0, initial=0.0)
    is_unknown = free > SINGULAR * np.abs(moved).max(axis=0, initial=0.0)
    if np.abs(rows.T @ y - price).max() > ACTIVE * np.abs(price).max():
        is_unknown[:] = True  # no multipliers: the masses are not stationary here
    return np.where(is_unknown, np.nan, gradient)


def move_balance(structure: Structure, tension: FloatArray) -> FloatArray:
    """Return d(A t)/dx at constant tensions (n_members,), (n_coordinates, 3 n_nodes) [N/m]."""
    i, j = structure.connectivity.T
    span = structure.node_position[i] - structure.node_position[j]
    length = structure.member_length()
    unit = span / length[:, None]
    across = (tension / length)[:, None, None] * (np.eye(3) - unit[:, :, None] * unit[:, None, :])
    derivative = np.zeros((structure.n_nodes, structure.n_nodes, 3, 3))
    for a, b, sign in ((i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)):
        np.add.at(derivative, (a, b), sign * across)
    node, axis = structure.coordinate_node_axis.T
    return np.asarray(derivative.transpose(0, 2, 1, 3)[node, axis].reshape(len(node), 3 * structure.n_nodes))
