"""One configuration of a model: its matrices, forces and motions, the same for nodes and for bodies.

Directions are those of the static problem: components of node positions [m], or coordinates of bodies scaled
to metres, so that the equilibrium matrix has no unit.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.analysis.rank import build_part_motions, find_parts
from tensegrity_codegen.runtime.model.arrays import check_finite, check_shape, to_doubles
from tensegrity_codegen.runtime.model.interface import Model, require_quantities
from tensegrity_codegen.runtime.statics.constrained_problems import BarProblem
from tensegrity_codegen.runtime.statics.equilibrium import build_problem
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.formulations import find_formulation

Subject = Structure | BodySystem

EPSILON = float(np.finfo(float).eps)
LOAD_TOLERANCE = 1e-12  # loads below this part of the forces from which they are computed are rounding
HELD = 1e-9  # part of the motion of contacts, below which a rigid motion does not move them
DIFFERENCE_STEP = 1e-3  # of the extent of the structure: step of differences of fourth order
ZERO_FREQUENCY_TOLERANCE = 1e-13  # part of the largest square of a frequency that counts as none


class Configuration:
    """A configuration of nodes with its forces, of a problem and the structure that it was made from."""

    def __init__(self, problem: StaticProblem, point: Point, structure: Subject) -> None:
        self.problem = problem
        self.structure = structure
        self.point = point
        self.manifest = problem.model.manifest
        self.coordinate = point.coordinate
        self.position = problem.node_position(self.coordinate)
        self.length = np.array(problem.compute("member_length", self.coordinate), dtype=float)
        length, owner = self.manifest.strands.strand_lengths(self.position), self.manifest.strands.member
        # Of strands; those without length, of slack cables, have no direction and no part in any of it.
        self.strand_length = np.where(length > 0.0, length, np.inf)
        # Rigid bars between the corners of one body, which are no members that carry tensions.
        self.is_edge = np.asarray(getattr(structure, "is_edge", np.zeros(len(self.length), dtype=bool)))
        self.is_absent = np.bincount(owner, ~np.isfinite(self.strand_length), len(self.length)) > 0
        self.is_absent |= self.is_edge
        self.tension_only = np.asarray(structure.tension_only, dtype=bool) & ~self.is_absent

    @property
    def tension(self) -> FloatArray:
        """Present member tensions, (n_members,) [N]."""
        return self.point.tension

    @cached_property
    def equilibrium_matrix(self) -> FloatArray:
        """Equilibrium matrix A = (dl/dx)^T, (n_directions, n_members)."""
        return np.asarray(self.problem.compute("equilibrium_matrix", self.coordinate).toarray())

    @property
    def rounding(self) -> float:
        """Relative error of direction cosines of members due to rounding of positions."""
        largest_coordinate = float(np.abs(self.position).max(initial=0.0))
        shortest = float(self.length[~self.is_absent].min(initial=np.inf))
        return EPSILON * max(1.0, largest_coordinate / shortest)

    @cached_property
    def force_floor(self) -> float:
        """Forces that rounding alone explains [N]."""
        if not len(self.coordinate):
            return 0.0
        return self.problem.rounding_floor(self.problem.stiffness(self.coordinate), self.point)

    @cached_property
    def load(self) -> FloatArray:
        """Weight and loads along the directions, (n_directions,) [N]; exactly zero if there are none."""
        residual = self.point.residual
        load: FloatArray = residual + self.equilibrium_matrix @ self.tension
        size = np.abs(self.equilibrium_matrix) @ np.abs(self.tension) + np.abs(residual)
        is_rounding = np.linalg.norm(load) <= LOAD_TOLERANCE * np.linalg.norm(size)
        return np.zeros_like(load) if is_rounding else load

    @cached_property
    def separate_parts(self) -> tuple[tuple[int, ...], ...]:
        """Nodes of each part of the structure that no members join to the others."""
        return find_parts(self.manifest)

    @cached_property
    def rigid_motions(self) -> FloatArray:
        """Orthonormal rigid motions of each part that the supports allow, (n_directions, k)."""
        return build_part_motions(self.manifest, self.position, self.separate_parts)

    def node_velocities(self, directions: FloatArray) -> FloatArray:
        """Return the node velocities (n_nodes, 3, k) of unit rates along directions (n_directions, k)."""
        return StaticProblem.node_velocities(self.problem, self.coordinate, directions)

    def geometric_stiffness(self, tension: FloatArray, directions: FloatArray) -> FloatArray:
        """Return sum t_e d2l_e/dx2 along directions (n_directions, k), (k, k) [N/m]."""
        transverse, strands = self._find_transverse_velocities(directions), self.manifest.strands
        weight = np.repeat(strands.spread(tension) / self.strand_length, 3)
        flat = transverse.reshape(-1, transverse.shape[2])
        return np.asarray(flat.T @ (weight[:, None] * flat))

    def curvature(self, direction: FloatArray) -> FloatArray:
        """Return d2l_e/ds2 of each member along one direction (n_directions,), (n_members,) [1/m]."""
        transverse = self._find_transverse_velocities(direction[:, None])[:, :, 0]
        return self.manifest.strands.add_up(np.sum(transverse**2, axis=1) / self.strand_length)

    def load_stiffness(self, directions: FloatArray) -> FloatArray:
        """Return the stiffness of loads along directions (n_directions, k), (k, k) [N/m]: none."""
        return np.zeros((directions.shape[1], directions.shape[1]))

    def _find_transverse_velocities(self, directions: FloatArray) -> FloatArray:
        """Return the velocities of strands' ends relative to each other, across the strands, (m, 3, k)."""
        strands, ends = self.manifest.strands, self.manifest.strands.ends
        unit = strands.vectors(self.position) / self.strand_length[:, None]
        velocity = self.node_velocities(directions)
        relative_velocity = velocity[ends[:, 0]] - velocity[ends[:, 1]]
        axial_velocity = np.einsum("ea,eak->ek", unit, relative_velocity)
        return np.asarray(relative_velocity - unit[:, :, None] * axial_velocity[:, None, :])


class HeldConfiguration(Configuration):
    """A configuration with bodies or on the ground: directions are combinations of those that stay free.

    Closed contacts hold some, and bodies keep their shapes, which leaves six directions of each. The forces
    of the ground along what contacts hold are those of supports; its friction on feet that slip counts with
    the loads. The tangent stiffness has the contacts as springs.
    """

    @cached_property
    def held(self) -> FloatArray:
        """Directions that the edges of bodies hold, then those that contacts hold, (k, n_coordinates)."""
        rows = [self._whole_matrix[:, self.is_edge].T]
        if self.problem.contacts is not None:
            rows.append(self.problem.ground_contacts.find_held(self.position))
        return np.vstack(rows)

    @cached_property
    def free(self) -> FloatArray:
        """Orthonormal directions that nothing holds, (n_coordinates, n_directions)."""
        return (
            np.asarray(scipy.linalg.null_space(self.held)) if len(self.held) else np.eye(len(self.coordinate))
        )

    @cached_property
    def equilibrium_matrix(self) -> FloatArray:
        """Equilibrium matrix A, (n_directions, n_members); zero in edges of bodies."""
        return np.asarray(self.free.T @ np.where(self.is_edge, 0.0, self._whole_matrix))

    @cached_property
    def _edge_tension(self) -> FloatArray:
        """Tensions of the edges that balance a force on each coordinate, (n_edges, n_coordinates)."""
        return np.asarray(np.linalg.pinv(self.held.T)[: self.is_edge.sum()])

    def geometric_stiffness(self, tension: FloatArray, directions: FloatArray) -> FloatArray:
        """Return sum t_e d2l_e/dx2 along directions (n_directions, k), (k, k) [N/m], with that of edges."""
        complete = np.array(tension)
        complete[self.is_edge] = -self._edge_tension @ (self._whole_matrix @ tension)
        return super().geometric_stiffness(complete, directions)

    def load_stiffness(self, directions: FloatArray) -> FloatArray:
        """Return the stiffness of loads, which turn bodies, along directions (n_directions, k), (k, k)."""
        tension = np.zeros(len(self.length))
        tension[self.is_edge] = self._edge_tension @ self._force
        return super().geometric_stiffness(tension, directions)

    def curvature(self, direction: FloatArray) -> FloatArray:
        """Return d2l_e/ds2 of each member along one direction, with that of the edges that it stresses."""
        own = super().curvature(direction)
        own -= (self._edge_tension @ self._whole_matrix).T @ own[self.is_edge]
        return np.where(self.is_edge, 0.0, own)

    @cached_property
    def load(self) -> FloatArray:
        """Weight, loads and friction that slips, (n_directions,) [N]; exactly zero if there are none."""
        size = np.abs(self._whole_matrix) @ np.abs(self.tension) + np.abs(self.point.residual)
        load: FloatArray = self.free.T @ self._force
        return load if np.linalg.norm(load) > LOAD_TOLERANCE * np.linalg.norm(size) else np.zeros_like(load)

    @cached_property
    def rigid_motions(self) -> FloatArray:
        """Orthonormal rigid motions of each part that anchors and contacts allow, (n_directions, k)."""
        rigid = build_part_motions(self.manifest, self.position, self.separate_parts)
        held = rigid - self.free @ (self.free.T @ rigid)
        _, size, right = np.linalg.svd(held, full_matrices=False)
        return np.asarray(self.free.T @ rigid @ right[size <= HELD].T)

    def node_velocities(self, directions: FloatArray) -> FloatArray:
        """Return the node velocities (n_nodes, 3, k) of unit rates along directions (n_directions, k)."""
        return super().node_velocities(self.free @ directions)

    @cached_property
    def _force(self) -> FloatArray:
        """Weight, loads and friction that slips, on coordinates (n_coordinates,) [N]."""
        return np.asarray(self.point.residual + self._whole_matrix @ self.tension)

    @cached_property
    def _whole_matrix(self) -> FloatArray:
        return np.asarray(self.problem.compute("equilibrium_matrix", self.coordinate).toarray())


class BodyConfiguration(Configuration):
    """A configuration of bodies; second derivatives are differences of fourth order."""

    @cached_property
    def equilibrium_matrix(self) -> FloatArray:
        """Equilibrium matrix of the tendons over x = s q, (n_coordinates, n_members)."""
        return self._compute_equilibrium_matrix(self.coordinate)

    @cached_property
    def separate_parts(self) -> tuple[tuple[int, ...], ...]:
        """All nodes: bodies join them."""
        return (tuple(range(len(self.position))),) if len(self.coordinate) else ()

    @cached_property
    def rigid_motions(self) -> FloatArray:
        """Orthonormal rigid motions of the whole system, (n_coordinates, k)."""
        return self.problem.rigid_motions(self.coordinate)

    def node_velocities(self, directions: FloatArray) -> FloatArray:
        """Return the node velocities (n_nodes, 3, k) of unit rates along directions (n_coordinates, k)."""
        return self.problem.node_velocities(self.coordinate, directions)

    def geometric_stiffness(self, tension: FloatArray, directions: FloatArray) -> FloatArray:
        """Return sum t_e d2l_e/dx2 along directions (n_coordinates, k), (k, k) [N/m]."""
        return self._differentiate(lambda x: self._compute_equilibrium_matrix(x) @ tension, directions)

    def curvature(self, direction: FloatArray) -> FloatArray:
        """Return d2l_e/ds2 of each member along one direction (n_coordinates,), (n_members,) [1/m]."""
        return self._difference(lambda x: self._compute_equilibrium_matrix(x).T @ direction, direction)

    def load_stiffness(self, directions: FloatArray) -> FloatArray:
        """Return the stiffness of weight and loads, which turn bodies, (k, k) [N/m]."""

        def load(x: FloatArray) -> FloatArray:
            residual, tension = self.problem.forces(x)
            return np.asarray(-residual - self._compute_equilibrium_matrix(x) @ tension)

        if not self.load.any():
            return super().load_stiffness(directions)
        return self._differentiate(load, directions)

    def _compute_equilibrium_matrix(self, x: FloatArray) -> FloatArray:
        scale = self.problem.scale  # type: ignore[attr-defined]
        return np.asarray(self.problem.compute("equilibrium_matrix", x).toarray() / scale[:, None])

    def _differentiate(self, function: Any, directions: FloatArray) -> FloatArray:
        """Return the symmetric part of directions^T df/dx directions."""
        columns = [self._difference(function, column) for column in directions.T]
        product = directions.T @ np.array(columns).reshape(-1, len(directions)).T
        return np.asarray((product + product.T) / 2)

    def _difference(self, function: Any, direction: FloatArray) -> FloatArray:
        """Return df/ds along a direction, by differences of fourth order."""
        extent = self.problem.extent(self.coordinate, self.length)
        step = DIFFERENCE_STEP * extent / float(np.abs(direction).max())
        samples = [np.asarray(function(self.coordinate + k * step * direction)) for k in (-2, -1, 1, 2)]
        return np.asarray((samples[0] - 8 * samples[1] + 8 * samples[2] - samples[3]) / (12 * step))


def read_configuration(
    model: Model, coordinate: ArrayLike | None, arguments: Mapping[str, Any] | None
) -> Configuration:
    """Return a configuration of a model, by default the scene's; rigid bars keep their lengths there."""
    problem = build_problem(model, arguments)
    require_quantities(model, ("equilibrium_matrix",), "an analysis of tensions needs")
    nominal = model.nominal("coordinate").ravel()
    start = nominal if coordinate is None else to_doubles(coordinate, "coordinate", f"shape {nominal.shape}")
    check_shape(start, nominal.shape, "coordinate")
    check_finite(start, "coordinate")
    of_bodies = find_formulation(model.manifest.formulation).of_bodies
    structure = _find_structure(model)
    if not of_bodies:
        _check_lengths(problem, start, structure)
    search_coordinate = problem.to_search_coordinate(start)
    if problem.contacts is not None:
        problem.contacts.rest(problem.node_position(search_coordinate), problem.arguments.get("internal"))
    point = problem.find_point(search_coordinate)
    if point is None:
        raise FormulationError(
            "the forces in this configuration are not finite",
            where=model.manifest.name,
            given="a member without length, or a body at the pole of its angles",
            allowed="finite lengths and forces",
            hint="move coincident nodes apart, or give the body another polar_axis",
        )
    is_held = problem.contacts is not None or (bool(getattr(structure, "bodies", ())) and not of_bodies)
    kind = BodyConfiguration if of_bodies else HeldConfiguration if is_held else Configuration
    return kind(problem, point, structure)


def _find_structure(model: Model) -> Subject:
    """Return the structure of a model; raises FormulationError if it is unknown."""
    structure: Subject | None = getattr(model, "structure", None)
    if structure is None:
        raise FormulationError(
            "the model does not know its structure, which says which members can go slack",
            where=model.manifest.name,
            given="a library that was loaded alone",
            allowed="a model of compile_scene or build_library",
            hint='compile_scene("scene.toml", for_="analyse")',
        )
    return structure


def _check_lengths(problem: StaticProblem, coordinate: FloatArray, structure: Subject) -> None:
    """Raise InvalidValueError for a member whose two nodes coincide and that is no cable, which is slack."""
    manifest = problem.model.manifest
    strands = manifest.strands
    joined = (strands.vectors(problem.node_position(coordinate)) == 0.0).all(axis=1)
    short = np.flatnonzero(joined & ~np.asarray(structure.tension_only)[strands.member])
    if len(short):
        member = int(strands.member[short[0]])
        node_1, node_2 = (manifest.node_name[node] for node in strands.ends[short[0]])
        raise InvalidValueError(
            "a member has no length",
            where=f"{manifest.name}: members.{manifest.member_name[member]}",
            given=f"nodes {node_1} and {node_2} at the same place",
            allowed="two places, or a cable",
            hint="move one of the nodes, or leave out the member: a tension in it has no direction",
        )


@dataclass(frozen=True)
class Modes:
    """Small undamped vibrations about a configuration."""

    frequency: FloatArray  # (n_modes,) [Hz], ascending; 0 if a motion has no stiffness
    growth_rate: FloatArray  # (n_modes,) [1/s], at which unstable modes grow; 0 for the others
    shape: FloatArray  # (n_nodes, 3, n_modes), displacements, the largest of each mode 1
    n_rigid: int  # rigid motions without stiffness, which are not among the modes
    n_total: int  # number of modes there are; only the first are computed


def find_modes(at: Configuration, rigid: FloatArray, count: int) -> Modes | None:
    """Find the first modes, K v = (2 pi f)^2 H v, off the rigid ones (n, k); None if masses are zero."""
    problem = at.problem
    # Matrices over motions orthogonal to the rigid ones: R^T H v = 0.
    stiffness = np.asarray(problem.stiffness(at.coordinate).toarray())
    mass = _find_mass(at)
    if len(mass) and mass.diagonal().min() <= 0.0:
        return None
    basis = scipy.linalg.null_space(rigid.T @ mass) if rigid.shape[1] else np.eye(len(stiffness))
    total = basis.shape[1]
    if total == 0:
        return Modes(np.zeros(0), np.zeros(0), np.zeros((len(at.position), 3, 0)), rigid.shape[1], 0)
    k, m = (basis.T @ (matrix + matrix.T) @ basis / 2 for matrix in (stiffness, mass))
    try:
        value, vector = scipy.linalg.eigh(k, m)
    except np.linalg.LinAlgError as error:
        raise NonFiniteError(
            f"the natural frequencies cannot be computed: {error}",
            where=problem.model.manifest.name,
            allowed="masses and stiffnesses whose quotients are numbers",
        ) from error
    # Squares of angular frequencies; rounding counts as zero.
    chosen = slice(0, min(count, total))
    square = np.where(np.abs(value) > ZERO_FREQUENCY_TOLERANCE * np.abs(value).max(), value, 0.0)[chosen]
    shape = problem.node_velocities(at.coordinate, basis @ vector[:, chosen])
    largest = np.linalg.norm(shape, axis=1).max(axis=0)
    return Modes(
        frequency=np.sqrt(np.maximum(square, 0.0)) / (2 * np.pi),
        growth_rate=np.sqrt(np.maximum(-square, 0.0)),
        shape=shape / np.where(largest > 0, largest, 1.0),
        n_rigid=rigid.shape[1],
        n_total=total,
    )


def _find_mass(at: Configuration) -> FloatArray:
    """Return the mass matrix over the directions of the static problem."""
    problem = at.problem
    mass = np.asarray(problem.compute("mass_matrix", at.coordinate).toarray())
    if isinstance(problem, BarProblem):
        directions = problem.directions(at.coordinate)
        return np.asarray(directions.T @ mass @ directions)
    if find_formulation(at.manifest.formulation).of_bodies:
        scale = problem.scale  # type: ignore[attr-defined]
        return np.asarray(mass / scale[:, None] / scale)
    return mass
