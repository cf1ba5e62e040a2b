"""Configurations of many cases: coordinates with energies, forces and stiff members, as arrays over cases."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.rigid_bars import MAX_CORRECTIONS, RigidBars
from tensegrity_codegen.runtime.statics.factors import SINGULAR_TOLERANCE
from tensegrity_codegen.runtime.statics.static_problem import EPSILON, ORIGIN_DISTANCE_WEIGHT
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
        row_entry, column_entry = np.nonzero(bar[:, None] == bar)
        position, number = np.unique(
            column[row_entry] * self.bars.size + column[column_entry], return_inverse=True
        )
        block = 9 * bar[row_entry] + 3 * axis[row_entry] + axis[column_entry]
        shape = (len(position), 9 * len(row))
        self.place = position
        self.difference = scipy.sparse.csr_array(
            (sign, (3 * bar + axis, column)), (3 * len(row), self.bars.size)
        )
        self.whole = scipy.sparse.csr_array(
            (sign[row_entry] * sign[column_entry], (number, block)), shape=shape
        )
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
        for _ in range(MAX_CORRECTIONS):
            position = self.place(placed[on], rows[on])
            bars = self.locate(position)
            gap = bars.length - target[on]
            worst = np.abs(gap).max(axis=1)
            rounding = 8 * EPSILON * (np.abs(position).max(axis=(1, 2)) + target[on].max(axis=1))
            is_done = (worst <= rounding / 4) | ((worst <= rounding) & (worst >= before[on] / 2))
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


def take(record: Any, rows: Any) -> Any:
    """Return rows of the arrays of a data class, by a mask or rising numbers; itself if these are all."""
    if isinstance(record, np.ndarray):
        return record[rows]
    rows = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
    arrays = vars(record).values()
    first_array = next(iter(arrays))
    return record if len(rows) == len(first_array) else type(record)(*[take(array, rows) for array in arrays])


def put(record: Any, rows: Any, replacement: Any) -> None:
    """Replace some of the rows of all arrays of a data class."""
    for array, new in zip(vars(record).values(), vars(replacement).values(), strict=True):
        array[rows] = new


@dataclass(frozen=True)
class Points:
    """Configurations as of `Point`, one row a case; is_finite: whether energy and forces of each are."""

    coordinate: FloatArray  # (count, n_coordinates) [m]
    position: FloatArray  # (count, n_nodes, 3) [m]
    energy: FloatArray  # (count,) [J]
    residual: FloatArray  # (count, n_coordinates) [N]
    node_force: FloatArray  # (count,) [N]
    unrounded_force: FloatArray  # (count,) [N]
    largest_force: FloatArray  # (count,) [N]
    longest: FloatArray  # (count,) [m]
    length: FloatArray  # (count, n_members) [m]
    tension: FloatArray  # (count, n_members) [N]
    is_finite: BoolArray  # (count,)

    def is_balanced(self, tolerance: float, floor: FloatArray) -> BoolArray:
        """Return whether the forces of each balance, as `Point.is_balanced` does."""
        allowed = tolerance * self.largest_force
        held = (self.node_force <= allowed) & (self.unrounded_force <= np.maximum(allowed, floor))
        return np.where(self.largest_force <= floor, self.node_force <= floor, held)

    @property
    def energy_scale(self) -> FloatArray:
        """Size of the numbers that each energy is summed up from [J]."""
        return np.abs(self.energy) + self.largest_force * self.longest


class BatchProblem:
    """The problem of `StaticProblem` for some cases in node coordinates; rows count cases from 0."""

    def __init__(
        self, model: CompiledModel, arguments: Mapping[str, tuple[FloatArray, bool]], cases: IntArray
    ) -> None:
        self.model, self.manifest, self.cases = model, model.manifest, cases
        self.arguments = {
            name: (array[cases] if is_batched else array, is_batched)
            for name, (array, is_batched) in arguments.items()
        }
        node_axis = self.manifest.coordinate_place
        self.node, self.axis, self.size = node_axis[:, 0], node_axis[:, 1], len(node_axis)
        self.of_node = np.zeros((self.size, len(self.manifest.node_name)))
        self.of_node[np.arange(self.size), self.node] = 1.0
        self.ends = np.array(self.manifest.connectivity, dtype=np.int64).reshape(-1, 2)
        self.stiff: StiffRows | None = None

    @cached_property
    def blocks(self) -> MemberBlocks:
        """How members add to matrices over the free coordinates."""
        return MemberBlocks(self.manifest, np.arange(len(self.ends)))

    def watch_stiff_members(self, row: IntArray, spring_constant: FloatArray) -> None:
        """From here on let steps keep the lengths of members; spring_constant: (n_cases, n_members) [N/m]."""
        if len(row):
            self.stiff = StiffRows(self.manifest, row, spring_constant[:, row], self.place)

    @property
    def kept_members(self) -> IntArray:
        """Numbers of the members whose lengths steps keep."""
        return np.zeros(0, dtype=np.int64) if self.stiff is None else self.stiff.row

    def compute(self, quantity: str, coordinate: FloatArray, rows: IntArray) -> tuple[Any, BoolArray]:
        """Return a quantity of each case at rest, of sparse matrices the non-zeros; whether it is finite."""
        function, count = self.model.function(quantity), len(rows)
        arguments: dict[str, Any] = {"coordinate": coordinate, "velocity": np.zeros_like(coordinate)}
        for name, (array, is_batched) in self.arguments.items():
            if name in function.arguments:
                arguments[name] = array[rows] if is_batched else array
        batched = {name for name, (_, is_batched) in self.arguments.items() if is_batched}
        if batched.isdisjoint(function.arguments) and not {"coordinate", "velocity"} & {*function.arguments}:
            shared = {name: array for name, (array, _) in self.arguments.items()}
            values = [
                shared[name] if name in shared else self.model.nominal(name) for name in function.arguments
            ]
            value = np.asarray(function.values(values, None))
            return np.broadcast_to(value, (count, *value.shape)), np.ones(count, dtype=np.bool_)
        answer, status = self.model.compute_batch(quantity, on_error="status", **arguments)
        return np.asarray(answer), status == 0

    @np.errstate(invalid="ignore", over="ignore", divide="ignore")
    def find_points(self, coordinate: FloatArray, rows: IntArray) -> Points:
        """Return the configurations at coordinates (count, n_coordinates)."""
        residual, is_finite = self.compute("node_residual", coordinate, rows)
        values = {}
        for name in ("member_tension", "potential_energy", "member_length"):
            values[name], good = self.compute(name, coordinate, rows)
            is_finite = is_finite & good
        tension, length, unbalanced = values["member_tension"], values["member_length"], residual
        position = self.place(coordinate, rows)
        if self.stiff is not None:
            tension, unbalanced = self.stiff.balance(position, residual, tension, rows)
        node_force, unrounded_force = (
            np.sqrt((force**2 @ self.of_node).max(axis=1, initial=0.0)) for force in (unbalanced, residual)
        )
        return Points(
            np.array(coordinate),
            position,
            np.array(values["potential_energy"].reshape(len(rows))),
            np.array(residual),
            node_force,
            unrounded_force,
            np.abs(tension).max(axis=1, initial=0.0),
            length.max(axis=1, initial=0.0),
            np.array(length),
            np.array(tension),
            is_finite,
        )

    def find_displaced_points(self, point: Points, step: FloatArray, rows: IntArray) -> Points:
        """Return the configurations steps (count, n_coordinates) away; not finite if there is none."""
        if self.stiff is None:
            return self.find_points(point.coordinate + step, rows)
        ahead, is_placed = self.stiff.follow(point.coordinate, point.position, step, rows)
        points = self.find_points(ahead, rows)
        points.is_finite[~is_placed] = False
        return points

    def find_stiffness(self, coordinate: FloatArray, rows: IntArray) -> tuple[FloatArray, BoolArray]:
        """Return the symmetric tangent stiffness of each case [N/m], and whether it is finite."""
        value, is_finite = self.compute("tangent_stiffness", coordinate, rows)
        pattern = self.model.function("tangent_stiffness").spec.pattern
        if pattern is None:
            return (value + value.transpose(0, 2, 1)) / 2, is_finite
        column = np.repeat(np.arange(self.size), np.diff(pattern.column_start))
        entry, mirrored = pattern.row * self.size + column, column * self.size + pattern.row
        dense = np.zeros((len(rows), self.size**2))
        dense[:, entry] = (value + value[:, np.searchsorted(mirrored, entry)]) / 2
        return dense.reshape(-1, self.size, self.size), is_finite

    def find_path(self, stiffness: FloatArray, point: Points) -> tuple[FloatArray, FloatArray]:
        """Return the Hessian along the curves of steps [N/m], and tensions as stiff members balance [N]."""
        if self.stiff is None:
            return stiffness, point.tension
        return self.stiff.find_path(stiffness, point.position, point.residual, point.tension)

    def bound_rounding(self, stiffness: FloatArray, point: Points, rows: IntArray) -> FloatArray:
        """Return the eigenvalue of each stiffness below which it is rounding [N/m], as of `StaticProblem`."""
        column = np.abs(stiffness).sum(axis=1)
        largest_sum = column.max(axis=1, initial=0.0)
        if self.stiff is not None:
            column -= self.stiff.sum_columns(point.position, rows)
        return np.asarray(SINGULAR_TOLERANCE * column.max(axis=1, initial=0.0) + 4 * EPSILON * largest_sum)

    def find_displacements(self, step: FloatArray) -> FloatArray:
        """Return the differences of the ends of members along steps, (count, n_members, 3) [m]."""
        moved = np.zeros((len(step), len(self.manifest.node_name), 3))
        moved[:, self.node, self.axis] = step
        return np.asarray(moved[:, self.ends[:, 0]] - moved[:, self.ends[:, 1]])

    def find_node_forces(self, pull: FloatArray) -> FloatArray:
        """Return forces (count, n_coordinates) on nodes, of forces of members (count, n_members, 3)."""
        return np.asarray((self.blocks.difference.T @ pull.reshape(len(pull), -1).T).T)

    def place(self, coordinate: FloatArray, rows: IntArray) -> FloatArray:
        """Return positions of all nodes, (count, n_nodes, 3) [m]."""
        position = np.tile(self.manifest.stated_position, (len(rows), 1, 1))
        changeable = self.manifest.find_argument("anchor_position")
        if changeable is not None and "anchor_position" in self.arguments:
            array, is_batched = self.arguments["anchor_position"]
            nodes = np.array([self.manifest.node_name.index(name) for name in changeable.over])
            position[:, nodes[:, None], list(self.manifest.axes)] = array[rows] if is_batched else array
        position[:, self.node, self.axis] = coordinate
        return position

    def rounding_floor(self, stiffness: FloatArray, points: Points) -> FloatArray:
        """Return the residual of each case that rounding alone explains [N], as of `StaticProblem`."""
        diagonal = np.abs(np.diagonal(stiffness, axis1=1, axis2=2)).max(axis=1, initial=0.0)
        reach = np.abs(points.position).max(axis=(1, 2), initial=0.0)
        return np.asarray(
            64 * EPSILON * diagonal * np.maximum(points.longest, ORIGIN_DISTANCE_WEIGHT * reach)
        )

    def find_unbalanced_axes(self, points: Points, noise: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the first axis of each case along which nothing holds its loads, or -1; their sum [N]."""
        count = len(points.energy)
        axis_of, total_of = np.full(count, -1), np.zeros(count)
        for axis in reversed(self.manifest.axes):
            along = points.residual[:, self.axis == axis]
            if along.shape[1] != len(self.manifest.node_name):
                continue
            total = along.sum(axis=1)
            is_unheld = np.abs(total) > 1e-12 * np.abs(along).sum(axis=1) + noise
            axis_of[is_unheld], total_of[is_unheld] = axis, total[is_unheld]
        return axis_of, total_of
