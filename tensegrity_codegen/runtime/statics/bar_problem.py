"""The static problem with rigid bars: the least energy among the configurations that keep every length.

Stationary points of L = U + sum t_b (l_b - k_b): force f = -dU/dq = J^T t with the tensions t of the bars.
Steps s = Z p go along an orthonormal basis Z of J s = 0, then back onto the lengths by the nearest change.
There the energy has the gradient -Z^T f and the Hessian Z^T (K + sum t_b d2l_b/dq2) Z, without a penalty, so
that a rigid bar costs neither accuracy nor iterations (D. G. Luenberger, "The gradient projection method
along geodesics", Management Science 18, 1972).
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.rigid_bars import RigidBars
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import InvalidValueError

BAR_EQUILIBRIUM_QUANTITIES = (
    "potential_energy",
    "node_residual",
    "tangent_stiffness",
    "member_length",
    "spring_tension",
    "member_extension",
)

MAX_CORRECTION_RATIO = 1.0  # largest correction of a step, as part of the step


@dataclass(frozen=True)
class _Place:
    """Directions and tensions of the bars at one configuration; directions are made when asked for."""

    bars: RigidBars
    coordinate: FloatArray
    jacobian: Any
    force: FloatArray

    @cached_property
    def tension(self) -> FloatArray:
        return self.bars.find_tension(self.jacobian, self.force)

    @cached_property
    def directions(self) -> Any:
        return self.bars.find_directions(self.jacobian)

    @property
    def residual(self) -> FloatArray:
        return np.asarray(self.force - self.jacobian.T @ self.tension)


class BarProblem(StaticProblem):
    """A model of springs and rigid bars with all arguments fixed but the coordinates, at rest.

    Raises what StaticProblem raises, and InvalidValueError where bars cannot have their lengths near a start.
    """

    quantities: ClassVar[tuple[str, ...]] = BAR_EQUILIBRIUM_QUANTITIES

    def __init__(self, model: Model, arguments: Mapping[str, Any] | None = None) -> None:
        super().__init__(model, arguments)
        nominal = model.nominal("coordinate").ravel()
        self.bars = RigidBars(model.manifest, np.zeros(len(model.manifest.rigid_bar)))
        length = np.array(self.compute("member_length", nominal))
        if model.has("member_extension"):
            length -= self.compute("member_extension", nominal)
        self.bars.length = length[self.bars.row]
        self._tension = "spring_tension" if model.has("spring_tension") else "member_tension"
        self._last: _Place | None = None

    def forget(self) -> None:
        """Drop what is kept of the last configuration."""
        self._last = None

    @classmethod
    def list_needed_quantities(cls, model: Model) -> tuple[str, ...]:
        """Return what has to be there: with constant rest lengths only what node positions need too.

        Lengths are then those of the scene, and tensions of springs those of all members at rest.
        """
        changeable = any(
            item.name == "rest_length" and not set(model.manifest.rigid_bar).isdisjoint(item.over)
            for item in model.manifest.arguments
        )
        if changeable or not model.has("member_tension"):
            return cls.quantities
        return tuple(name for name in cls.quantities if name not in ("spring_tension", "member_extension"))

    def under(self, **arguments: Any) -> "BarProblem":
        """Return the problem under other loads; the lengths that bars are kept at stay."""
        result = copy(self)
        result.arguments = {**self.arguments, **arguments}
        result._given = {**self._given, **arguments}
        result._last = None
        if self.contacts is not None:
            result.contacts = self.contacts.under(result.arguments)
        return result

    def to_search_coordinate(self, coordinate: FloatArray) -> FloatArray:
        """Return the nearest coordinates at which all bars have their lengths."""
        placed = self.place(coordinate)
        if placed is None:
            gap = np.abs(self.bars.gap(self.node_position(coordinate)))
            worst = int(gap.argmax())
            raise InvalidValueError(
                "no configuration near the start has the lengths of the rigid bars",
                where=f"{self.model.manifest.name}: members.{self.model.manifest.rigid_bar[worst]}",
                given=f"off by {gap[worst]:.3g} m at the start",
                allowed=f"a length of {self.bars.length[worst]:.9g} m",
                hint="start from other positions, or change rest lengths of bars that can move",
            )
        return placed

    def place(self, coordinate: FloatArray) -> FloatArray | None:
        """Return the nearest coordinates at which all bars have their lengths, None if none is found."""
        return self.bars.place(self.node_position, coordinate)

    def move_coordinate(self, coordinate: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return coordinates moved by `by` and back onto the lengths, and the whole way there."""
        placed = self.place(coordinate + by)
        return None if placed is None else (placed, placed - coordinate)

    def find_displaced_point(self, coordinate: FloatArray, step: FloatArray) -> Point | None:
        """Return the configuration a step (n_directions,) away, None where bars cannot follow it."""
        ahead = coordinate + self._at(coordinate).directions @ step
        placed = self.place(ahead)
        if placed is None or np.linalg.norm(placed - ahead) > MAX_CORRECTION_RATIO * np.linalg.norm(step):
            return None
        return self.find_point(placed)

    def directions(self, coordinate: FloatArray) -> Any:
        """Return the orthonormal basis Z of what keeps the lengths, sparse (n_coordinates, n_directions)."""
        return self._at(coordinate).directions

    def directional_residual(self, point: Point) -> FloatArray:
        """Return the residual along the directions, (n_directions,) [N]."""
        return np.asarray(self._at(point.coordinate).directions.T @ point.residual)

    def forces(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residual (n_coordinates,) and tensions of all members (n_members,) [N]."""
        place = self._at(coordinate)
        tension = np.array(self.compute(self._tension, coordinate))
        tension[self.bars.row] = place.tension
        return place.residual, tension

    def residual(self, coordinate: FloatArray) -> FloatArray:
        """Return what the bars leave of the forces, (n_coordinates,) [N]; raises NonFiniteError."""
        return self._at(coordinate).residual

    def stiffness(self, coordinate: FloatArray) -> Any:
        """Return the Hessian along the directions, sparse (n_directions, n_directions) [N/m]."""
        directions = self._at(coordinate).directions
        return scipy.sparse.csc_array(directions.T @ self._full_stiffness(coordinate) @ directions)

    def watch_stiff_members(self, coordinate: FloatArray) -> None:
        """Leave elastic members alone: rigid bars are kept already."""

    @property
    def kept_members(self) -> IntArray:
        """Numbers of the rigid bars among the members."""
        return self.bars.row

    def find_differences(self, coordinate: FloatArray) -> Any:
        """Return D of the directions that keep the lengths."""
        directions = self._at(coordinate).directions
        return self.subtract_ends(self._velocity @ directions)

    def row_stiffness(self, coordinate: FloatArray) -> FloatArray:
        """Return one bound for all coordinates, since masses that differ would not go along the bars.

        A bar that turns into the direction of the forces f gets a stiffness of |f| / l.
        """
        rows = np.asarray(abs(self._full_stiffness(coordinate)).sum(axis=1)).ravel()
        force = self.largest_node_norm(self._at(coordinate).force)
        turned = 2 * force / float(self.bars.length.min())
        return np.full(self.size, max(float(rows.max(initial=0.0)), turned))

    def rigid_motions(self, coordinate: FloatArray) -> FloatArray:
        """Return the rigid motions that the anchors permit, over the directions, (n_directions, k)."""
        return np.asarray(self._at(coordinate).directions.T @ super().rigid_motions(coordinate))

    def node_velocities(self, coordinate: FloatArray, directions: FloatArray) -> FloatArray:
        """Return how nodes move along directions (n_directions, k), (n_nodes, 3, k)."""
        return super().node_velocities(coordinate, np.asarray(self.directions(coordinate) @ directions))

    def _full_stiffness(self, coordinate: FloatArray) -> Any:
        """Return the Hessian of the Lagrangian, sparse (n_coordinates, n_coordinates) [N/m]."""
        density = self._at(coordinate).tension / self.bars.length
        return self.compute("tangent_stiffness", coordinate) + self.bars.stiffness(density)

    def _at(self, coordinate: FloatArray) -> _Place:
        """Return the bars at these coordinates; the last ones are kept."""
        if self._last is None or not np.array_equal(self._last.coordinate, coordinate):
            force = np.array(self.compute(self.residual_quantity, coordinate))
            jacobian = self.bars.jacobian(self.node_position(coordinate))
            self._last = _Place(self.bars, np.array(coordinate), jacobian, force)
        return self._last
