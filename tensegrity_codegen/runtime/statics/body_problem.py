"""The static problem of bodies: angles and positions brought to one measure, metres.

Each coordinate q_i is scaled to x_i = s_i q_i with s_i the most that a unit of it moves any node [m], so
that residuals are forces [N], stiffnesses [N/m], and a step has one length, whatever the coordinates are.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.charts import NEAR_POLE, NEAREST_POLE, name_charts
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError, NonFiniteError

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


class BodyProblem(StaticProblem):
    """A model of bodies with all arguments fixed but the coordinates, at rest, over x = s q [m].

    Configurations at the pole of a body's angles count as not finite. Raises what StaticProblem raises.
    """

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
        """Raise FormulationError where torques, or forces that turn with their body, act."""
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
        """Return the configuration with its energy and forces, None where not finite or at a pole."""
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
        place = np.asarray(self.compute("node_position", coordinate))
        return max(float(np.max(length, initial=0.0)), float(np.ptp(place, axis=0).max(initial=0.0)))

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
        place = self.node_position(coordinate)
        local = place - place.mean(axis=0)
        fields = [np.tile(axis, len(place)) for axis in np.eye(3)]
        fields += [np.cross(axis, local).ravel() for axis in np.eye(3)]
        wanted = np.array(fields).T
        motions, *_ = np.linalg.lstsq(jacobian, wanted, rcond=None)
        # Combinations of the six fields that the coordinates can follow exactly.
        _, singular, right = np.linalg.svd(jacobian @ motions - wanted, full_matrices=True)
        free = right[[k >= len(singular) or singular[k] <= RANK_TOLERANCE for k in range(6)]].T
        moved = motions @ free
        left, size, _ = np.linalg.svd(moved, full_matrices=False)
        basis: FloatArray = left[:, size > RANK_TOLERANCE]
        return basis

    def node_velocities(self, coordinate: FloatArray, directions: FloatArray) -> FloatArray:
        """Return how nodes move along directions (n_coordinates, k) of x, (n_nodes, 3, k)."""
        jacobian = np.asarray(self.compute("node_jacobian", coordinate).toarray()) / self.scale
        return np.asarray((jacobian @ directions).reshape(len(jacobian) // 3, 3, directions.shape[1]))

    def smallest_eigenvalue(self, coordinate: FloatArray, found: float, neutral: FloatArray) -> float:
        """Return the smallest eigenvalue of the Hessian over q, in which angles count by the radian."""
        if neutral.shape[1] >= self.size:
            return found
        stiffness = np.asarray(self.compute("tangent_stiffness", coordinate).toarray())
        basis = np.eye(self.size)
        if neutral.shape[1]:
            own = np.linalg.qr(neutral / self.scale[:, None])[0]
            basis = np.linalg.svd(own, full_matrices=True)[0][:, neutral.shape[1] :]
        projected = basis.T @ (stiffness + stiffness.T) @ basis / 2
        return float(np.linalg.eigvalsh(projected)[0])
