"""The static problem at fixed loads and parameters: energy, residual and stiffness over the coordinates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
import scipy

from tensegrity_codegen.runtime.contacts.contacts import Contacts
from tensegrity_codegen.runtime.contacts.rest_memory import (
    RELAXED_QUANTITIES,
    REST_QUANTITIES,
    RING_QUANTITIES,
    find_rest_memory,
)
from tensegrity_codegen.runtime.model.arguments import check_parameter_values, merge_inputs
from tensegrity_codegen.runtime.model.interface import Model, require_quantities
from tensegrity_codegen.runtime.model.placement import build_node_matrix, place_nodes
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT, SINGULAR_TOLERANCE
from tensegrity_codegen.runtime.statics.stiff_members import StiffMembers, choose_stiff, find_spring_constants
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.manifest import VISCOUS_WORK, Manifest

RANK_TOLERANCE = 1e-10  # of motions scaled to unit size
ROUNDING = 1e-13  # of the norm of the stiffness
EQUILIBRIUM_QUANTITIES = (
    "potential_energy",
    "node_residual",
    "tangent_stiffness",
    "member_length",
    "member_tension",
)
EPSILON = float(np.finfo(float).eps)
# Axis of the turn from one axis to another, their cross product.
TURNS = {(0, 1): (0.0, 0.0, 1.0), (0, 2): (0.0, -1.0, 0.0), (1, 2): (1.0, 0.0, 0.0)}
# Weight of the distance from the origin beside the length of members, where rounding is estimated.
ORIGIN_DISTANCE_WEIGHT = 1 / 16


def build_rigid_motions(
    manifest: Manifest | Structure, position: FloatArray, *, nodes: Sequence[int] | None = None
) -> FloatArray:
    """Return an orthonormal basis of the rigid motions that the anchors permit, (n_coordinates, k).

    One translation along each modelled axis and one infinitesimal rotation in each plane of two modelled
    axes, combined so that every anchored coordinate rests. position: (n_nodes, 3) [m]. Motions that move
    nothing (a rod about its own axis) are dropped. nodes: those that move, by default all; the others rest.
    """
    place = np.array(manifest.coordinate_node_axis, dtype=np.int64).reshape(-1, 2)
    free = np.zeros((len(position), 3), dtype=bool)
    free[place[:, 0], place[:, 1]] = True
    moves = np.ones(len(position), dtype=bool)
    if nodes is not None:
        moves[:] = False
        moves[list(nodes)] = True
    moves[[node for body in manifest.body_places for node in body.point]] = False  # as their corners do
    position, free = position[moves], free[moves]
    motions, _ = build_all_motions(manifest.axes, position)
    chosen = free[:, manifest.axes].ravel()
    permitted = motions[chosen] @ _null_space(motions[~chosen])
    if permitted.size == 0:
        return np.zeros((len(place), 0))
    directions, singular, _ = np.linalg.svd(permitted, full_matrices=False)
    directions = directions[:, singular > RANK_TOLERANCE]
    basis: FloatArray = np.zeros((len(place), directions.shape[1]))
    basis[moves[place[:, 0]]] = directions
    return basis


def find_neutral_motions(stiffness: Any, motions: FloatArray, force_noise: float) -> FloatArray:
    """Return a basis of those `motions` that the stiffness annihilates to rounding, (n_coordinates, m).

    stiffness: (n_coordinates, n_coordinates) [N/m], sparse or dense. force_noise [N]: the change of force
    that a unit motion may cause and still count as none, on top of rounding. A rotation that tilts loads,
    such as a pendulum's, is no neutral motion.
    """
    if motions.shape[1] == 0:
        return motions
    size = float(abs(stiffness).sum(axis=0).max(initial=0.0))
    threshold = ROUNDING * size * np.sqrt(len(motions)) + force_noise
    _, singular, right = np.linalg.svd(np.asarray(stiffness @ motions), full_matrices=False)
    neutral: FloatArray = motions @ right[singular <= threshold].T
    return neutral


def build_all_motions(axes: Sequence[int], position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit translations and rotations (..., n_nodes * n_axes, k), and twists (..., 6, k)."""
    local = position[..., list(axes)]
    local = local - local.mean(axis=-2, keepdims=True)
    n_axes, planes = len(axes), list(combinations(range(len(axes)), 2))
    columns, twist = np.zeros((*local.shape, n_axes + len(planes))), np.zeros((6, n_axes + len(planes)))
    for number, axis in enumerate(axes):
        columns[..., number, number] = twist[3 + axis, number] = 1.0
    for number, (axis_1, axis_2) in enumerate(planes, n_axes):
        columns[..., axis_1, number], columns[..., axis_2, number] = -local[..., axis_2], local[..., axis_1]
        twist[:3, number] = TURNS[axes[axis_1], axes[axis_2]]
    motions = columns.reshape(*position.shape[:-2], -1, columns.shape[-1])
    norm = np.linalg.norm(motions, axis=-2, keepdims=True)
    norm = np.where(norm > 0, norm, 1.0)
    return motions / norm, twist / norm


def _null_space(matrix: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the null space of a tall or empty matrix, by SVD."""
    count = matrix.shape[1]
    if matrix.shape[0] == 0:
        return np.eye(count)
    _, singular, right = np.linalg.svd(matrix, full_matrices=matrix.shape[0] < count)
    rank = int((singular > RANK_TOLERANCE).sum())
    null: FloatArray = right[rank:].T
    return null


@dataclass(frozen=True)
class Point:
    """One configuration with its energy and forces; `node_force` is the largest residual of a node [N]."""

    coordinate: FloatArray  # (n_coordinates,) [m]
    energy: float  # [J]
    residual: FloatArray  # (n_coordinates,) [N], minus the gradient of the energy
    node_force: float  # [N], after the rounding of tensions of stiff members is taken out
    unrounded_force: float  # [N], the same with that rounding
    largest_force: float  # [N], over the members
    longest: float  # [m], longest member
    tension: FloatArray  # (n_members,) [N]

    def is_balanced(self, tolerance: float, floor: float) -> bool:
        """Return whether the largest node residual is at most `tolerance` times the largest member force.

        Where no member force exceeds the rounding `floor` [N], the members count as unstressed and the
        residual is held against the floor itself.
        """
        if self.largest_force <= floor:
            return self.node_force <= floor
        allowed = tolerance * self.largest_force
        return self.node_force <= allowed and self.unrounded_force <= max(allowed, floor)

    @property
    def energy_scale(self) -> float:
        """Size of the numbers that the energy is summed up from, for judging its rounding [J]."""
        return abs(self.energy) + self.largest_force * self.longest


class StaticProblem:
    """A model with all arguments fixed but the coordinates, at rest.

    arguments: values of inputs and parameters that differ from the scene's. Raises FormulationError if
    the model lacks a function and InvalidValueError if `arguments` hold a coordinate or velocity.
    Steps go along directions, here one for each coordinate.
    """

    quantities: ClassVar[tuple[str, ...]] = EQUILIBRIUM_QUANTITIES
    residual_quantity: ClassVar[str] = "node_residual"

    def __init__(self, model: Model, arguments: Mapping[str, Any] | None = None) -> None:
        self.model = model
        self.arguments = merge_inputs(model.manifest, arguments)
        _check_arguments(self.arguments)
        check_parameter_values(model.manifest, self.arguments)
        needed = self.list_needed_quantities(model)
        needed += REST_QUANTITIES if model.manifest.subjects_of("yield") else ()
        needed += RING_QUANTITIES if model.manifest.ring_name else ()
        needed += RELAXED_QUANTITIES if VISCOUS_WORK in model.manifest.internal_name else ()
        require_quantities(model, needed, "an equilibrium needs")
        pairs = np.array(model.manifest.coordinate_node_axis, dtype=np.int64).reshape(-1, 2)
        self.node, self.axis = pairs[:, 0], pairs[:, 1]
        self.size = len(pairs)
        self._given = {**self.arguments, "velocity": np.zeros(self.size)}
        self.strands = model.manifest.strands
        self.stiff: StiffMembers | None = None
        self.contacts: Contacts | None = None
        self.memory = find_rest_memory(model, self.arguments)
        if model.manifest.contact_name:
            if self.memory is not None or model.manifest.ring_name:
                raise FormulationError(
                    "equilibria on the ground know no members with memory, lags of motors, friction at rings",
                    where=model.manifest.name,
                    hint="simulate the motion with damping until it rests",
                )
            self.contacts = Contacts(model, self.arguments)
        # Velocities of nodes (3 n_nodes, n_coordinates) of those of coordinates.
        self._velocity = build_node_matrix(model.manifest)

    @classmethod
    def list_needed_quantities(cls, model: Model) -> tuple[str, ...]:
        """Return the quantities that this model has to have."""
        return cls.quantities

    def to_search_coordinate(self, coordinate: FloatArray) -> FloatArray:
        """Return the model's coordinates as the coordinates of this problem."""
        return coordinate

    def to_model_coordinate(self, coordinate: FloatArray) -> FloatArray:
        """Return the coordinates of this problem as the model's."""
        return coordinate

    def check_start(self, point: Point) -> None:
        """Raise FormulationError if no energy has the forces of this problem for its gradient."""

    def describe_pole(self, coordinate: FloatArray) -> str:
        """Return why these coordinates are not to be trusted, or an empty text."""
        return ""

    def compute(self, quantity: str, coordinate: FloatArray) -> Any:
        """Return one quantity at `coordinate`."""
        if self.contacts is None:
            arguments = {**self._given, "coordinate": coordinate}
            return self.model.compute(
                quantity, **(self.memory.choose(quantity, arguments) if self.memory else arguments)
            )
        position = self.node_position(coordinate)
        arguments = self._given | self.contacts.state(position)
        value = self.model.compute(quantity, coordinate=coordinate, **arguments)
        return self.contacts.complete(quantity, value, coordinate, position)

    @property
    def ground_contacts(self) -> Contacts:
        """The contacts of a structure on the ground."""
        assert self.contacts is not None
        return self.contacts

    @property
    def internal(self) -> FloatArray:
        """The internal states that members come from, (n_internal,)."""
        if self.memory is not None:
            return self.memory.begun
        return np.array(self._given.get("internal", self.model.nominal("internal")), dtype=np.float64)

    def put_internal(self, states: FloatArray) -> None:
        """Let members come from these internal states (n_internal,)."""
        self._given["internal"] = states
        if self.memory is not None:
            self.memory.begun = self.memory.start = states
        self.forget()

    def settle(self, coordinate: FloatArray) -> FloatArray | None:
        """Return the internal states of members at `coordinate`, (n_internal,); None if they have none."""
        arguments = {**self._given, "coordinate": coordinate}
        if self.memory is not None:
            return self.memory.settle(arguments)
        return self.internal if self.model.manifest.ring_name else None

    def forget(self) -> None:
        """Drop the stored configuration: loads or contacts have changed."""

    def find_point(self, coordinate: FloatArray) -> Point | None:
        """Return the configuration with its energy and forces, None if any of them is not finite."""
        try:
            residual, tension = self.forces(coordinate)
            energy = float(self.compute("potential_energy", coordinate))
            length = self.compute("member_length", coordinate)
        except NonFiniteError:
            return None
        if not all(np.all(np.isfinite(values)) for values in (energy, residual, tension, length)):
            return None
        unbalanced = residual
        if self.stiff is not None:
            tension, unbalanced = self.stiff.balance(self.node_position(coordinate), residual, tension)
        return Point(
            np.array(coordinate, dtype=float),
            energy,
            residual,
            self.largest_node_norm(unbalanced),
            self.largest_node_norm(residual),
            float(np.abs(tension).max(initial=0.0)),
            self.extent(coordinate, length),
            tension,
        )

    def find_displaced_point(self, coordinate: FloatArray, step: FloatArray) -> Point | None:
        """Return the configuration a step (n_directions,) away from `coordinate`, None if not finite."""
        if self.stiff is None:
            return self.find_point(coordinate + step)
        ahead = self.stiff.follow(coordinate, step, self.node_position)
        return None if ahead is None else self.find_point(ahead)

    def watch_stiff_members(self, coordinate: FloatArray) -> None:
        """From here on let steps keep the lengths of members that are much stiffer than the others."""
        try:
            spring_constant = find_spring_constants(self.compute, coordinate)
        except NonFiniteError:
            return
        spring_constant[self.strands.passes_rings] = 0.0
        row = choose_stiff(spring_constant)
        self.stiff = StiffMembers(self.model.manifest, row, spring_constant[row]) if len(row) else None

    def state_tensions(self, point: Point, tolerance: float) -> Point:
        """Return a point with the tensions that the laws of stiff members state, where these balance too."""
        if self.stiff is None or point.unrounded_force > tolerance * point.largest_force:
            return point
        tension = np.array(self.forces(point.coordinate)[1])
        return replace(point, tension=tension, node_force=point.unrounded_force)

    @property
    def kept_members(self) -> IntArray:
        """Numbers of the members whose lengths steps keep."""
        return np.zeros(0, dtype=np.int64) if self.stiff is None else self.stiff.row

    @property
    def kept_strands(self) -> IntArray:
        """Numbers of the strands whose lengths steps keep."""
        return np.flatnonzero(np.isin(self.strands.member, self.kept_members))

    def find_path_stiffness(self, stiffness: Any, point: Point) -> Any:
        """Return the Hessian of the energy along the curves that steps follow, dense if small."""
        if stiffness.shape[0] <= DENSE_LIMIT:
            stiffness = stiffness.toarray()
        if self.stiff is None:
            return stiffness
        return self.stiff.correct_stiffness(stiffness, self.node_position(point.coordinate), point.residual)

    def find_stiff_tension(self, point: Point) -> FloatArray:
        """Return tensions (n_members,) [N], those of stiff members as they balance the other forces best."""
        if self.stiff is None:
            return point.tension
        return self.stiff.balance_tension(self.node_position(point.coordinate), point.residual, point.tension)

    def bound_rounding(self, stiffness: Any, coordinate: FloatArray) -> float:
        """Return the eigenvalue of the stiffness below which it is rounding [N/m]."""
        column = np.asarray(abs(stiffness).sum(axis=0)).ravel()
        largest_sum = float(column.max(initial=0.0))
        if self.stiff is not None:  # their lengths are kept: of them, rounded entries alone count
            column = column - self.stiff.sum_columns(self.node_position(coordinate))
        return SINGULAR_TOLERANCE * float(column.max(initial=0.0)) + 4 * EPSILON * largest_sum

    def find_differences(self, coordinate: FloatArray) -> Any:
        """Return D: s_i - s_j of strands for directions s, (3 n_strands, n_directions), dense if small."""
        return self._difference

    @cached_property
    def _difference(self) -> Any:
        return self.subtract_ends(self._velocity)

    def subtract_ends(self, velocity: Any) -> Any:
        """Return the differences of the ends of strands, of velocities of nodes (3 n_nodes, k)."""
        if velocity.shape[1] <= DENSE_LIMIT:
            velocity = velocity.toarray()
        start_rows, end_rows = (
            (3 * self.strands.ends[:, end, None] + np.arange(3)).ravel() for end in (0, 1)
        )
        difference = velocity[start_rows] - velocity[end_rows]
        return difference if isinstance(difference, np.ndarray) else scipy.sparse.csc_array(difference)

    def move_coordinate(self, coordinate: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return coordinates moved by `by`, and the displacement; None if constraints cannot be kept."""
        return coordinate + by, by

    def directional_residual(self, point: Point) -> FloatArray:
        """Return the residual along the directions that steps have, (n_directions,) [N]: here all of it."""
        return point.residual

    def find_residual(self, coordinate: FloatArray) -> FloatArray | None:
        """Return the residual forces alone, (n_coordinates,) [N], None if they are not finite."""
        try:
            residual = self.residual(coordinate)
        except NonFiniteError:
            return None
        return residual if np.all(np.isfinite(residual)) else None

    def forces(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residual forces (n_coordinates,) and member tensions (n_members,) [N]; NonFiniteError."""
        return self.residual(coordinate), np.array(self.compute("member_tension", coordinate))

    def residual(self, coordinate: FloatArray) -> FloatArray:
        """Return the residual forces, (n_coordinates,) [N]; raises NonFiniteError."""
        return np.array(self.compute(self.residual_quantity, coordinate))

    def extent(self, coordinate: FloatArray, length: FloatArray) -> float:
        """Return the length [m] that steps and rounding are held against: that of the longest member."""
        return float(np.max(length, initial=0.0))

    def rigid_motions(self, coordinate: FloatArray) -> FloatArray:
        """Return an orthonormal basis of the rigid motions that the anchors permit, (n_directions, k)."""
        return build_rigid_motions(self.model.manifest, self.node_position(coordinate))

    def node_velocities(self, coordinate: FloatArray, directions: FloatArray) -> FloatArray:
        """Return how nodes move along directions (n_directions, k) of steps, (n_nodes, 3, k)."""
        return np.asarray(self._velocity @ directions).reshape(
            len(self.model.manifest.node_name), 3, directions.shape[1]
        )

    def smallest_eigenvalue(self, coordinate: FloatArray, eigenvalue: float, neutral: FloatArray) -> float:
        """Return the smallest eigenvalue in the model's coordinates, of that in those of this problem."""
        return eigenvalue

    def stiffness(self, coordinate: FloatArray) -> Any:
        """Return the tangent stiffness, a (n_directions, n_directions) sparse array [N/m]."""
        return self.compute("tangent_stiffness", coordinate)

    def row_stiffness(self, coordinate: FloatArray) -> FloatArray:
        """Return a bound of the stiffness on each coordinate, the sums of moduli of rows [N/m]."""
        return np.asarray(abs(self.stiffness(coordinate)).sum(axis=1)).ravel()

    def largest_node_norm(self, vector: FloatArray) -> float:
        """Return the largest Euclidean norm of a node's part of a vector over the coordinates."""
        square = np.zeros(len(self.model.manifest.node_name))
        np.add.at(square, self.node, vector**2)
        return float(np.sqrt(square.max(initial=0.0)))

    def find_unbalanced_axis(self, residual: FloatArray, noise: float) -> tuple[int, float] | None:
        """Return the first axis without anchors on which loads do not cancel, and their sum [N]."""
        n_nodes = len(self.model.manifest.node_name) - len(self.model.manifest.body_points)
        if self.contacts is not None:
            return None
        for axis in self.model.manifest.axes:
            along = residual[self.axis == axis]
            bound = 1e-12 * float(np.abs(along).sum()) + noise
            if len(along) == n_nodes and abs(along.sum()) > bound:
                return axis, float(along.sum())
        return None

    def node_position(self, coordinate: FloatArray) -> FloatArray:
        """Return all node positions, (n_nodes, 3) [m], anchors moved by `anchor_position` where given."""
        return place_nodes(self.model, coordinate, self.arguments.get("anchor_position"))

    def rounding_floor(self, stiffness: Any, point: Point) -> float:
        """Return the residual that rounding alone explains, 64 eps max(mu l) [N].

        The largest diagonal entry of the stiffness stands for the largest spring constant mu, the longest
        member for l; far from the origin, where positions are rounded more, l is a part of their size.
        """
        diagonal = np.abs(stiffness.diagonal())
        reach = float(np.abs(self.node_position(point.coordinate)).max(initial=0.0))
        length = max(point.longest, ORIGIN_DISTANCE_WEIGHT * reach)
        return 64 * EPSILON * float(diagonal.max(initial=0.0)) * length


def _check_arguments(arguments: Mapping[str, Any]) -> None:
    for name in ("coordinate", "velocity"):
        if name in arguments:
            raise InvalidValueError(
                f"{name} is no load or parameter",
                where="arguments",
                given=name,
                allowed="inputs and parameters",
                hint="an equilibrium is at rest; pass the starting point as coordinate=",
            )
