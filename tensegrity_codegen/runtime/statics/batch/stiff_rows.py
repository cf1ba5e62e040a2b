"""Stiff members of many cases at once: the lengths and forces of `StiffMembers`, one row a case."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.rigid_bars import EPSILON, MOST_CORRECTIONS, RigidBars
from tensegrity_codegen.runtime.statics.stiff_members import MAX_CORRECTION_RATIO, ROUNDING
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.tables.manifest import Manifest

DEPENDENT = (
    1e-12  # added to the diagonal of J J^T: what keeps it regular where stiff members repeat each other
)


class Locate(Protocol):
    """Gives positions of nodes."""

    def __call__(self, coordinate: FloatArray, rows: IntArray) -> FloatArray:
        """Return them, (count, n_nodes, 3) [m], of coordinates (count, n_coordinates) of cases in rows."""


class MemberBlocks:
    """Adds 3x3 blocks of members to matrices over the free coordinates: D^T W D."""

    def __init__(self, manifest: Manifest, row: IntArray) -> None:
        self.bars = RigidBars(manifest, np.zeros(len(row)), row)
        bar, column, axis, sign = self.bars.bar, self.bars.column, self.bars.axis, self.bars.sign
        first, second = np.nonzero(bar[:, None] == bar)
        place, number = np.unique(column[first] * self.bars.size + column[second], return_inverse=True)
        block = 9 * bar[first] + 3 * axis[first] + axis[second]
        shape = (len(place), 9 * len(row))
        self.place = place
        self.difference = scipy.sparse.csr_array(
            (sign, (3 * bar + axis, column)), (3 * len(row), self.bars.size)
        )
        self.whole = scipy.sparse.csr_array((sign[first] * sign[second], (number, block)), shape=shape)
        diagonal = scipy.sparse.kron(scipy.sparse.eye_array(len(row)), np.eye(3).reshape(9, 1))
        self.scalar = scipy.sparse.csr_array(self.whole @ diagonal)

    def add(self, matrix: FloatArray, block: FloatArray) -> None:
        """Add to matrices (count, n, n) blocks (count, n_members, 3, 3), or multiples of ones."""
        spread, flat = self.whole if block.ndim == 4 else self.scalar, matrix.reshape(len(matrix), -1)
        flat[:, self.place] += (spread @ block.reshape(len(block), -1).T).T


@dataclass(frozen=True)
class Bars:
    """Stiff members at configurations: lengths, directions, J = dl/dq (count, n_stiff, n_coordinates)."""

    length: FloatArray  # (count, n_stiff) [m]
    unit: FloatArray  # (count, n_stiff, 3)
    jacobian: FloatArray

    def transpose(self, tension: FloatArray) -> FloatArray:
        """Return J^T t, (count, n_coordinates), of (count, n_stiff)."""
        return np.asarray((tension[:, None, :] @ self.jacobian)[:, 0])

    def apply(self, step: FloatArray) -> FloatArray:
        """Return J s, (count, n_stiff), of (count, n_coordinates)."""
        return np.asarray((self.jacobian @ step[:, :, None])[:, :, 0])

    def solve(self, right: FloatArray) -> FloatArray:
        """Return (J J^T)^-1 b, (count, n_stiff)."""
        gram = self.jacobian @ self.jacobian.transpose(0, 2, 1) + DEPENDENT * np.eye(right.shape[1])
        return np.asarray(np.linalg.solve(gram, right[:, :, None])[:, :, 0])


class StiffRows:
    """The stiff members that all cases of a problem have; row: their numbers."""

    def __init__(self, manifest: Manifest, row: IntArray, spring_constant: FloatArray, place: Locate) -> None:
        self.row, self.spring_constant, self.place = row, spring_constant, place
        self.blocks = MemberBlocks(manifest, row)
        self.ends, self.size = self.blocks.bars.ends, self.blocks.bars.size

    def locate(self, position: FloatArray) -> Bars:
        """Return the stiff members with nodes at position (count, n_nodes, 3)."""
        vector = position[:, self.ends[:, 0]] - position[:, self.ends[:, 1]]
        length, entry = np.sqrt((vector**2).sum(axis=2)), self.blocks.bars
        unit = vector / length[:, :, None]
        jacobian = np.zeros((len(position), len(self.row), self.size))
        jacobian[:, entry.bar, entry.column] = entry.sign * unit[:, entry.bar, entry.axis]
        return Bars(length, unit, jacobian)

    def balance(
        self, position: FloatArray, residual: FloatArray, tension: FloatArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return tensions and residuals, tensions changed within rounding to balance these best."""
        bars = self.locate(position)
        reach = bars.length + np.abs(position).max(axis=(1, 2))[:, None] / 16
        noise = ROUNDING * self.spring_constant[rows] * reach
        change = np.clip(bars.solve(bars.apply(residual)), -noise, noise)
        changed = tension.copy()
        changed[:, self.row] += change
        return changed, residual - bars.transpose(change)

    def find_path(
        self, stiffness: FloatArray, position: FloatArray, residual: FloatArray, tension: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the Hessian K* along curves, and tensions t* that balance the residual best."""
        bars = self.locate(position)
        change = bars.solve(bars.apply(residual))
        across = np.eye(3) - bars.unit[:, :, :, None] * bars.unit[:, :, None, :]
        path, balanced = stiffness.copy(), tension.copy()
        self.blocks.add(path, (change / bars.length)[:, :, None, None] * across)
        balanced[:, self.row] += change
        return path, balanced

    def sum_columns(self, position: FloatArray, rows: IntArray) -> FloatArray:
        """Return the column sums of moduli of their part of the stiffness, (count, n_coordinates) [N/m]."""
        bars = self.locate(position)
        size = np.abs(bars.jacobian)
        return np.asarray(((self.spring_constant[rows] * size.sum(axis=2))[:, None, :] @ size)[:, 0])

    def follow(
        self, coordinate: FloatArray, position: FloatArray, step: FloatArray, rows: IntArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return the coordinates nearest to ends of steps at which lengths are kept; whether they exist."""
        bars, placed = self.locate(position), coordinate + step
        target, before = bars.length + bars.apply(step), np.full(len(rows), np.inf)
        is_placed, on = np.zeros(len(rows), dtype=np.bool_), np.arange(len(rows))
        for _ in range(MOST_CORRECTIONS):
            there = self.place(placed[on], rows[on])
            bars = self.locate(there)
            gap = bars.length - target[on]
            worst = np.abs(gap).max(axis=1)
            least = 8 * EPSILON * (np.abs(there).max(axis=(1, 2)) + target[on].max(axis=1))
            is_done = (worst <= least / 4) | ((worst <= least) & (worst >= before[on] / 2))
            is_placed[on[is_done]] = True
            goes_on = ~is_done & np.isfinite(worst)
            before[on] = worst
            on = on[goes_on]
            if not len(on):
                break
            bars = Bars(bars.length[goes_on], bars.unit[goes_on], bars.jacobian[goes_on])
            placed[on] -= bars.transpose(bars.solve(gap[goes_on]))
        correction = np.linalg.norm(placed - coordinate - step, axis=1)
        return placed, is_placed & (correction <= MAX_CORRECTION_RATIO * np.linalg.norm(step, axis=1))
