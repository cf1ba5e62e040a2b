"""Static problems with constraints: rigid bars that keep their lengths, and bodies.

With rigid bars the energy is least among the configurations that keep every length: stationary points of
L = U + sum t_b (l_b - k_b), force f = -dU/dq = J^T t with the tensions t of the bars. Steps s = Z p go along
an orthonormal basis Z of J s = 0, then back onto the lengths by the nearest change. There the energy has the
gradient -Z^T f and the Hessian Z^T (K + sum t_b d2l_b/dq2) Z, without a penalty, so that a rigid bar costs
neither accuracy nor iterations (D. G. Luenberger, "The gradient projection method along geodesics",
Management Science 18, 1972).

Coordinates q_i of bodies, angles and positions, are scaled to x_i = s_i q_i with s_i the most that a unit of
it moves any node [m], so that residuals are forces [N], stiffnesses [N/m], and a step has one length.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.placement import NEAR_POLE, NEAREST_POLE, name_charts
from tensegrity_codegen.runtime.model.rigid_bars import RigidBars
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, NonFiniteError

BAR_EQUILIBRIUM_QUANTITIES = (
    "potential_energy",
    "node_residual",
    "tangent_stiffness",
    "member_length",
    "spring_tension",
    "member_extension",
)

MAX_CORRECTION_RATIO = 1.0  # largest correction of a step, as part of the step
BODY_EQUILIBRIUM_QUANTITIES = (
    "potential_energy",
    "coordinate_force",
    "tangent_stiffness",
    "member_length",
    "member_tension",
    "node_position",
    "node_jacobian",
    "chart_margin",
)
RANK_TOLERANCE = 1e-9


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
    """A model of springs and rigid bars with all arguments fixed but the coordinates, at rest."""

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
        """Drop the stored configuration."""
        self._last = None

    @classmethod
    def list_needed_quantities(cls, model: Model) -> tuple[str, ...]:
        """Return the needed quantities: with constant rest lengths those of node positions alone."""
        changeable = any(
            argument.name == "rest_length" and not set(model.manifest.rigid_bar).isdisjoint(argument.over)
            for argument in model.manifest.arguments
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
        """Return the configuration a step (n_directions,) away, None if bars cannot follow it."""
        predicted = coordinate + self._at(coordinate).directions @ step
        placed = self.place(predicted)
        if placed is None or np.linalg.norm(placed - predicted) > MAX_CORRECTION_RATIO * np.linalg.norm(step):
            return None
        return self.find_point(placed)

    def directions(self, coordinate: FloatArray) -> Any:
        """Return the orthonormal basis Z that keeps the lengths, sparse (n_coordinates, n_directions)."""
        return self._at(coordinate).directions

    def directional_residual(self, point: Point) -> FloatArray:
        """Return the residual along the directions, (n_directions,) [N]."""
        return np.asarray(self._at(point.coordinate).directions.T @ point.residual)

    def forces(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residual (n_coordinates,) and tensions of all members (n_members,) [N]."""
        state = self._at(coordinate)
        tension = np.array(self.compute(self._tension, coordinate))
        tension[self.bars.row] = state.tension
        return state.residual, tension

    def residual(self, coordinate: FloatArray) -> FloatArray:
        """Return the forces that bars do not balance, (n_coordinates,) [N]; raises NonFiniteError."""
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
        """Return one bound for all coordinates; bars that turn into forces f have a stiffness of |f| / l."""
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
            if not (np.isfinite(force).all() and np.isfinite(jacobian.data).all()):
                raise NonFiniteError(
                    "the forces are not finite", where=self.model.manifest.name, allowed="finite forces"
                )
            self._last = _Place(self.bars, np.array(coordinate), jacobian, force)
        return self._last


class BodyProblem(StaticProblem):
    """A model of bodies with fixed arguments, at rest, over x = s q [m]; not finite at the pole of angles."""

    quantities: ClassVar[tuple[str, ...]] = BODY_EQUILIBRIUM_QUANTITIES
    residual_quantity: ClassVar[str] = "coordinate_force"

    def __init__(self, model: Model, arguments: Mapping[str, Any] | None = None) -> None:
        super().__init__(model, arguments)
        self.size = len(model.manifest.coordinate_name)
        self._given = {**self.arguments, "velocity": np.zeros(self.size)}
        self.scale = np.ones(self.size)

    def to_search_coordinate(self, coordinate: FloatArray) -> FloatArray:
        """Return x = s q, with s taken at this configuration."""
        jacobian = self.model.compute("node_jacobian", coordinate=coordinate).toarray()
        moved = np.linalg.norm(jacobian.reshape(-1, 3, self.size), axis=1)
        reach = moved.max(axis=0, initial=0.0)
        largest = float(reach.max(initial=0.0)) or 1.0
        self.scale = np.maximum(reach, 1e-3 * largest)
        return self.scale * coordinate

    def to_model_coordinate(self, coordinate: FloatArray) -> FloatArray:
        """Return q = x / s."""
        return coordinate / self.scale

    def check_start(self, point: Point) -> None:
        """Raise FormulationError if torques, or forces that turn with their body, act."""
        if not self.model.has("unpotential_force"):
            return
        force = np.abs(self.compute("unpotential_force", point.coordinate))
        if force.any():
            name = self.model.manifest.coordinate_name[int(force.argmax())]
            raise FormulationError(
                "these loads have no potential, so the equilibrium is not a minimum of the energy",
                where=self.model.manifest.name,
                given=f"a generalised force of {force.max():.6g} on {name} by torques or turning forces",
                allowed="weight, and forces that keep their direction",
                hint='set torques to zero, and give forces the frame "inertial"',
            )

    def compute(self, quantity: str, coordinate: FloatArray) -> Any:
        """Return one quantity at x, in the model's own units; NonFiniteError at the pole of a chart."""
        return self.model.compute(quantity, coordinate=coordinate / self.scale, **self._given)

    def find_point(self, coordinate: FloatArray) -> Point | None:
        """Return the configuration with its energy and forces, None if not finite or at a pole."""
        if self.find_pole(coordinate)[1] < NEAREST_POLE:
            return None
        return super().find_point(coordinate)

    def find_pole(self, coordinate: FloatArray) -> tuple[int, float]:
        """Return the chart that is nearest to its pole, and the sine of its angle to it (0 if not finite)."""
        try:
            margin = np.abs(self.compute("chart_margin", coordinate))
        except NonFiniteError:
            return 0, 0.0
        chart = int(margin.argmin())
        return chart, float(margin[chart])

    def describe_pole(self, coordinate: FloatArray) -> str:
        """Return which body is near the pole of its angles, or an empty text."""
        chart, margin = self.find_pole(coordinate)
        if margin >= NEAR_POLE:
            return ""
        body = name_charts(self.model.manifest)[chart]
        return f"the body {body!r} has reached the pole of its angles (margin {margin:.3g})"

    def watch_stiff_members(self, coordinate: FloatArray) -> None:
        """Leave tendons alone: rods are rigid already."""

    def find_differences(self, coordinate: FloatArray) -> Any:
        """Return D over x."""
        jacobian = scipy.sparse.csr_array(self.compute("node_jacobian", coordinate))
        jacobian.data = jacobian.data / self.scale[jacobian.indices]
        return self.subtract_ends(jacobian)

    def residual(self, coordinate: FloatArray) -> FloatArray:
        """Return the generalised forces over s, (n_coordinates,) [N]."""
        force: FloatArray = np.array(self.compute(self.residual_quantity, coordinate)) / self.scale
        return force

    def stiffness(self, coordinate: FloatArray) -> Any:
        """Return the Hessian of the energy over x, sparse (n_coordinates, n_coordinates) [N/m]."""
        stiffness = scipy.sparse.csc_array(self.compute("tangent_stiffness", coordinate))
        column_scale = np.repeat(self.scale, np.diff(stiffness.indptr))
        stiffness.data = stiffness.data / (self.scale[stiffness.indices] * column_scale)
        return stiffness

    def extent(self, coordinate: FloatArray, length: FloatArray) -> float:
        """Return the longest tendon or the largest extent of all nodes [m]."""
        position = np.asarray(self.compute("node_position", coordinate))
        return max(float(np.max(length, initial=0.0)), float(np.ptp(position, axis=0).max(initial=0.0)))

    def largest_node_norm(self, vector: FloatArray) -> float:
        """Return the largest entry: coordinates of bodies belong to no node."""
        return float(np.abs(vector).max(initial=0.0))

    def find_unbalanced_axis(self, residual: FloatArray, noise: float) -> tuple[int, float] | None:
        """Return None: a system that nothing holds shows itself by moving away without bound."""
        return None

    def node_position(self, coordinate: FloatArray) -> FloatArray:
        """Return all node positions, (n_nodes, 3) [m]."""
        return np.array(self.compute("node_position", coordinate), dtype=float)

    def rigid_motions(self, coordinate: FloatArray) -> FloatArray:
        """Return an orthonormal basis over x of the motions that move all nodes as one rigid body."""
        jacobian = np.asarray(self.compute("node_jacobian", coordinate).toarray()) / self.scale
        position = self.node_position(coordinate)
        local = position - position.mean(axis=0)
        fields = [np.tile(axis, len(position)) for axis in np.eye(3)]
        fields += [np.cross(axis, local).ravel() for axis in np.eye(3)]
        fields_of_axes = np.array(fields).T
        motions, *_ = np.linalg.lstsq(jacobian, fields_of_axes, rcond=None)
        # Combinations of the six fields that the coordinates can follow exactly.
        _, singular, right = np.linalg.svd(jacobian @ motions - fields_of_axes, full_matrices=True)
        free = right[[k >= len(singular) or singular[k] <= RANK_TOLERANCE for k in range(6)]].T
        combined = motions @ free
        directions, size, _ = np.linalg.svd(combined, full_matrices=False)
        basis: FloatArray = directions[:, size > RANK_TOLERANCE]
        return basis

    def node_velocities(self, coordinate: FloatArray, directions: FloatArray) -> FloatArray:
        """Return how nodes move along directions (n_coordinates, k) of x, (n_nodes, 3, k)."""
        jacobian = np.asarray(self.compute("node_jacobian", coordinate).toarray()) / self.scale
        return np.asarray((jacobian @ directions).reshape(len(jacobian) // 3, 3, directions.shape[1]))

    def smallest_eigenvalue(self, coordinate: FloatArray, eigenvalue: float, neutral: FloatArray) -> float:
        """Return the smallest eigenvalue of the Hessian over q, in which angles count by the radian."""
        if neutral.shape[1] >= self.size:
            return eigenvalue
        stiffness = np.asarray(self.compute("tangent_stiffness", coordinate).toarray())
        basis = np.eye(self.size)
        if neutral.shape[1]:
            neutral_q = np.linalg.qr(neutral / self.scale[:, None])[0]
            basis = np.linalg.svd(neutral_q, full_matrices=True)[0][:, neutral.shape[1] :]
        projected = basis.T @ (stiffness + stiffness.T) @ basis / 2
        return float(np.linalg.eigvalsh(projected)[0])
