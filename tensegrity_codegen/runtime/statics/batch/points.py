"""Configurations of many cases: coordinates with their energies and forces, as arrays over cases."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.static_problem import EPSILON, ORIGIN_DISTANCE_WEIGHT
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Points:
    """Configurations as of `Point`, one row a case; is_finite: whether energy and forces of each are."""

    coordinate: FloatArray  # (count, n_coordinates) [m]
    energy: FloatArray  # (count,) [J]
    residual: FloatArray  # (count, n_coordinates) [N]
    node_force: FloatArray  # (count,) [N]
    largest_force: FloatArray  # (count,) [N]
    longest: FloatArray  # (count,) [m]
    length: FloatArray  # (count, n_members) [m]
    tension: FloatArray  # (count, n_members) [N]
    is_finite: BoolArray  # (count,)

    def __len__(self) -> int:
        return len(self.energy)

    def take(self, rows: Any) -> "Points":
        """Return some of the rows."""
        return Points(*(getattr(self, item.name)[rows] for item in fields(self)))

    def put(self, rows: Any, other: "Points") -> None:
        """Replace some of the rows."""
        for item in fields(self):
            getattr(self, item.name)[rows] = getattr(other, item.name)

    def is_balanced(self, tolerance: float, floor: FloatArray) -> BoolArray:
        """Return whether the forces of each balance, as `Point.is_balanced` does."""
        held = np.where(self.largest_force <= floor, floor, tolerance * self.largest_force)
        return np.asarray(self.node_force <= held)

    @property
    def energy_scale(self) -> FloatArray:
        """Size of the numbers that each energy is summed up from [J]."""
        return np.abs(self.energy) + self.largest_force * self.longest


class BatchProblem:
    """The static problem of `StaticProblem` for cases with arguments of their own, in node coordinates.

    arguments: each with whether it has one row a case; cases are named by their numbers.
    """

    def __init__(self, model: CompiledModel, arguments: Mapping[str, tuple[FloatArray, bool]]) -> None:
        self.model, self.manifest, self.arguments = model, model.manifest, arguments
        places = self.manifest.coordinate_place
        self.node, self.axis, self.size = places[:, 0], places[:, 1], len(places)
        self.of_node = np.zeros((self.size, len(self.manifest.node_name)))
        self.of_node[np.arange(self.size), self.node] = 1.0

    def compute(self, quantity: str, coordinate: FloatArray, cases: IntArray) -> tuple[Any, BoolArray]:
        """Return a quantity of each case at rest, of sparse matrices the non-zeros; whether it is finite."""
        function, count = self.model.function(quantity), len(cases)
        given: dict[str, Any] = {"coordinate": coordinate, "velocity": np.zeros_like(coordinate)}
        for name, (array, is_batched) in self.arguments.items():
            if name in function.arguments:
                given[name] = array[cases] if is_batched else array
        if not any(name in ("coordinate", "velocity") or self._has_rows(name) for name in function.arguments):
            value = np.asarray(function.values([self._value(name) for name in function.arguments], None))
            return np.broadcast_to(value, (count, *value.shape)), np.ones(count, dtype=np.bool_)
        answer, status = self.model.compute_batch(quantity, on_error="status", **given)
        return np.asarray(answer), status == 0

    def _has_rows(self, name: str) -> bool:
        return name in self.arguments and self.arguments[name][1]

    def _value(self, name: str) -> FloatArray:
        return self.arguments[name][0] if name in self.arguments else self.model.nominal(name)

    def find_points(self, coordinate: FloatArray, cases: IntArray) -> Points:
        """Return the configurations at coordinates (count, n_coordinates)."""
        count = len(cases)
        residual, good = self.compute("node_residual", coordinate, cases)
        is_finite = good
        values = {}
        for name in ("member_tension", "potential_energy", "member_length"):
            values[name], good = self.compute(name, coordinate, cases)
            is_finite = is_finite & good
        tension, length = values["member_tension"], values["member_length"]
        with np.errstate(invalid="ignore", over="ignore"):
            node_force = np.sqrt((residual**2 @ self.of_node).max(axis=1, initial=0.0))
        return Points(
            np.array(coordinate),
            np.array(values["potential_energy"].reshape(count)),
            np.array(residual),
            node_force,
            np.abs(tension).max(axis=1, initial=0.0),
            length.max(axis=1, initial=0.0),
            np.array(length),
            np.array(tension),
            is_finite,
        )

    def find_stiffness(self, coordinate: FloatArray, cases: IntArray) -> tuple[FloatArray, BoolArray]:
        """Return the symmetric tangent stiffness of each case [N/m], and whether it is finite."""
        found, is_finite = self.compute("tangent_stiffness", coordinate, cases)
        pattern = self.model.function("tangent_stiffness").spec.pattern
        if pattern is not None:
            dense = np.zeros((len(cases), self.size, self.size))
            column = np.repeat(np.arange(self.size), np.diff(pattern.column_start))
            dense[:, pattern.row, column] = found
            found = dense
        return (found + found.transpose(0, 2, 1)) / 2, is_finite

    def place(self, coordinate: FloatArray, cases: IntArray) -> FloatArray:
        """Return positions of all nodes, (count, n_nodes, 3) [m]."""
        position = np.tile(self.manifest.stated_position, (len(cases), 1, 1))
        changeable = next((item for item in self.manifest.arguments if item.name == "anchor_position"), None)
        if changeable is not None and "anchor_position" in self.arguments:
            array, is_batched = self.arguments["anchor_position"]
            nodes = np.array([self.manifest.node_name.index(name) for name in changeable.over])
            position[:, nodes[:, None], list(self.manifest.axes)] = array[cases] if is_batched else array
        position[:, self.node, self.axis] = coordinate
        return position

    def rounding_floor(self, stiffness: FloatArray, points: Points, cases: IntArray) -> FloatArray:
        """Return the residual of each case that rounding alone explains [N], as of `StaticProblem`."""
        diagonal = np.abs(np.diagonal(stiffness, axis1=1, axis2=2)).max(axis=1, initial=0.0)
        reach = np.abs(self.place(points.coordinate, cases)).max(axis=(1, 2), initial=0.0)
        return np.asarray(
            64 * EPSILON * diagonal * np.maximum(points.longest, ORIGIN_DISTANCE_WEIGHT * reach)
        )

    def find_unbalanced_axes(self, points: Points, noise: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the first axis of each case along which nothing holds its loads, or -1; their sum [N]."""
        axis_of, total_of = np.full(len(points), -1), np.zeros(len(points))
        for axis in reversed(self.manifest.axes):
            along = points.residual[:, self.axis == axis]
            if along.shape[1] != len(self.manifest.node_name):
                continue
            total = along.sum(axis=1)
            is_unheld = np.abs(total) > 1e-12 * np.abs(along).sum(axis=1) + noise
            axis_of[is_unheld], total_of[is_unheld] = axis, total[is_unheld]
        return axis_of, total_of
