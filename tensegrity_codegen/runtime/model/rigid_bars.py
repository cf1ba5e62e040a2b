"""Rigid bars over the free coordinates: gaps of their lengths, directions they permit, forces they carry.

l_b(q) = k_b,  J = dl/dq (n_bars, n_coordinates): +u_b at node i, -u_b at node j, u_b = d_b / l_b, times the
share of each coordinate where an end is a point of a body
Bars that share free nodes, directly or through others, are one component; each has its own null space of J.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.placement import build_node_matrix
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.manifest import Manifest

# Part of a bar's direction that the others leave free, below which it repeats them.
DEPENDENCE_TOLERANCE = 1e-9
DENSE_BARS = 40  # bars up to which forces and corrections are found in least squares
MAX_CORRECTIONS = 25
EPSILON = float(np.finfo(float).eps)


class RigidBars:
    """Members of a manifest, by default its rigid bars, kept at `length` (n_bars,) [m]."""

    def __init__(self, manifest: Manifest, length: FloatArray, row: IntArray | None = None) -> None:
        self.row = list_rigid_bars(manifest) if row is None else row
        self.length = length
        self.ends = np.array(manifest.connectivity, dtype=np.int64).reshape(-1, 2)[self.row]
        self.size = len(manifest.coordinate_node_axis)
        # One entry of J for each bar and coordinate that moves an end of it, along the axis of that.
        moves = build_node_matrix(manifest)
        first, second = (3 * self.ends[:, end, None] + np.arange(3) for end in (0, 1))
        self._difference = moves[first.ravel()] - moves[second.ravel()]
        entries = self._difference.tocoo()
        place, column = (index.astype(np.int64) for index in entries.coords)
        order = np.lexsort((column, place // 3))  # of compressed rows
        self.column, self.sign = column[order], entries.data[order]
        self.bar, self.axis = place[order] // 3, place[order] % 3
        shape = (len(self.row), self.size)
        self._pattern = scipy.sparse.csr_array((self.sign, (self.bar, self.column)), shape=shape)

    def vectors(self, position: FloatArray) -> FloatArray:
        """Return d_b, (n_bars, 3) [m], at node positions (n_nodes, 3)."""
        vectors: FloatArray = position[self.ends[:, 0]] - position[self.ends[:, 1]]
        return vectors

    def gap(self, position: FloatArray) -> FloatArray:
        """Return lengths minus the kept ones, (n_bars,) [m]."""
        gap: FloatArray = np.linalg.norm(self.vectors(position), axis=1) - self.length
        return gap

    def jacobian(self, position: FloatArray) -> Any:
        """Return J, sparse (n_bars, n_coordinates)."""
        vectors = self.vectors(position)
        return self.rows(vectors / np.linalg.norm(vectors, axis=1)[:, None])

    def rows(self, vectors: FloatArray) -> Any:
        """Return one row a bar with its vector (n_bars, 3) at node i and minus it at j, sparse as J."""
        data, at = self.sign * vectors[self.bar, self.axis], self._pattern
        return scipy.sparse.csr_array((data, at.indices, at.indptr), shape=at.shape)

    def pull(self, jacobian: Any, tension: FloatArray) -> FloatArray:
        """Return J^T t, (n_coordinates,) [N]."""
        return _sum(self.column, jacobian.data * tension[self.bar], self.size)

    def stiffness(self, density: FloatArray) -> Any:
        """Return the Hessian of sum density_b l_b^2 / 2, sparse (n_coordinates, n_coordinates) [N/m]."""
        weights = scipy.sparse.diags_array(np.repeat(density, 3))
        return scipy.sparse.csc_array(self._difference.T @ weights @ self._difference)

    def bend(self, stiffness: FloatArray, density: FloatArray, jacobian: Any) -> FloatArray:
        """Return a dense stiffness and the Hessian of sum density_b l_b^2 / 2 off its part along the bars."""
        first, second, turns = self._pairs
        weight = density[self.bar[first]]
        turning = turns * weight
        along = jacobian.data[second] * (jacobian.data[first] * weight)
        place, shape = self.column[first] * self.size + self.column[second], stiffness.shape
        turning, along = (_sum(place, entry, self.size**2).reshape(shape) for entry in (turning, along))
        return stiffness + turning - along

    @cached_property
    def _pairs(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Return all pairs of entries of one bar, and 1 for one end, -1 for both, on one axis, else 0."""
        first, second = np.nonzero(self.bar[:, None] == self.bar)
        turns = (self.axis[first] == self.axis[second]) * self.sign[first] * self.sign[second]
        return first, second, turns

    def find_tension(self, jacobian: Any, force: FloatArray) -> FloatArray:
        """Return the tensions t that balance `force` (n_coordinates,) [N] best: least |force - J^T t|."""
        if len(self.row) <= DENSE_BARS:
            return np.asarray(np.linalg.lstsq(jacobian.toarray().T, force, rcond=DEPENDENCE_TOLERANCE)[0])
        return self._solve(jacobian, jacobian @ force)

    def find_directions(self, jacobian: Any) -> Any:
        """Return an orthonormal basis of J v = 0, sparse (n_coordinates, n_directions)."""
        touched = np.zeros(self.size, dtype=bool)
        rows, columns, values, count = [], [], [], 0
        for bars, coordinates in self.components:
            touched[coordinates] = True
            null = _null_space(jacobian[bars][:, coordinates].toarray())
            rows.append(np.repeat(coordinates, null.shape[1]))
            columns.append(count + np.tile(np.arange(null.shape[1]), len(coordinates)))
            values.append(null.ravel())
            count += null.shape[1]
        free = np.flatnonzero(~touched)
        rows.append(free)
        columns.append(count + np.arange(len(free)))
        values.append(np.ones(len(free)))
        at = (np.concatenate(rows), np.concatenate(columns))
        return scipy.sparse.csc_array((np.concatenate(values), at), shape=(self.size, count + len(free)))

    def find_correction(self, position: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the least change of coordinates that closes the gaps in first order, (n_coordinates,)."""
        jacobian = self.jacobian(position)
        if len(self.row) <= DENSE_BARS:
            return np.asarray(np.linalg.lstsq(jacobian.toarray(), -gap, rcond=DEPENDENCE_TOLERANCE)[0])
        return np.asarray(jacobian.T @ self._solve(jacobian, -gap))

    def place(self, locate: Callable[[FloatArray], FloatArray], coordinate: FloatArray) -> FloatArray | None:
        """Return the nearest coordinates at which all bars have their lengths, None if none is found."""
        placed, before = np.array(coordinate, dtype=float), np.inf
        for _ in range(MAX_CORRECTIONS):
            position = locate(placed)
            gap = self.gap(position)
            worst = float(np.abs(gap).max(initial=0.0))
            if not np.isfinite(worst):
                return None
            rounding = self.rounding(position)
            if worst <= rounding / 4 or (worst <= rounding and worst >= before / 2):
                return placed
            before = worst
            try:
                placed = placed + self.find_correction(position, gap)
            except (RuntimeError, np.linalg.LinAlgError):  # dependent bars, or bars without length
                return None
        return None

    def rounding(self, position: FloatArray) -> float:
        """Return the gap that rounding of positions explains [m]."""
        return 8 * EPSILON * float(np.abs(position).max(initial=0.0) + self.length.max(initial=0.0))

    def _solve(self, jacobian: Any, right: FloatArray) -> FloatArray:
        """Return (J J^T)^-1 right by sparse LU."""
        return np.asarray(
            scipy.sparse.linalg.splu(scipy.sparse.csc_array(jacobian @ jacobian.T)).solve(right)
        )

    @cached_property
    def components(self) -> list[tuple[IntArray, IntArray]]:
        """Return bars and coordinates of each connected set of bars."""
        count = len(self.row)
        graph = scipy.sparse.csr_array(
            (np.ones(len(self.bar)), (self.bar, count + self.column)),
            shape=(count + self.size, count + self.size),
        )
        number, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
        order = np.argsort(label, kind="stable")
        groups = np.split(order, np.searchsorted(label[order], np.arange(1, number)))
        pairs = [(group[group < count], group[group >= count] - count) for group in groups]
        return [(bars, coordinates) for bars, coordinates in pairs if len(bars) and len(coordinates)]


def _sum(place: IntArray, value: FloatArray, size: int) -> FloatArray:
    """Return the sums of the values at each place, (size,), in their order."""
    return np.asarray(np.bincount(place, value, size), dtype=np.float64)


def list_rigid_bars(manifest: Manifest) -> IntArray:
    """Return the numbers of the rigid bars among the members, (n_bars,)."""
    return np.array([manifest.member_name.index(name) for name in manifest.rigid_bar], dtype=np.int64)


def _null_space(matrix: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the null space of rows of unit length: by QR, by SVD if singular."""
    factor, upper = np.linalg.qr(matrix.T, mode="complete")
    rank = min(matrix.shape)
    if matrix.shape[0] <= matrix.shape[1] and np.abs(np.diag(upper)).min(initial=1.0) > DEPENDENCE_TOLERANCE:
        return np.asarray(factor[:, rank:])
    _, singular, right = np.linalg.svd(matrix, full_matrices=True)
    return np.asarray(right[int((singular > DEPENDENCE_TOLERANCE).sum()) :].T)
