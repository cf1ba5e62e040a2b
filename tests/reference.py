"""Every quantity written out in plain NumPy: the yardstick that generated code is measured by.

Straight from the formulas (MODEL 1 and 3), member by member through the incidence matrix; it shares no
code with the package apart from the frozen data classes. `ReferenceModel` has the face of a compiled
model, so the runtime can be tested with it, without a compiler.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg as sparse_linalg

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.quantities import ARGUMENTS, PARAMETERS, QUANTITIES
from tests.reference_manifest import NODE_POSITION_QUANTITIES, all_parameters, build_manifest, full_value
from tests.segments import Nearest, find_nearest

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Values:
    """All arguments in full size, axes reduced to the modelled ones."""

    position: Array  # (n_nodes, n_axes)
    velocity: Array  # (n_nodes, n_axes)
    input: Array  # (n_inputs,)
    rest_length: Array  # (n_members,), inputs added
    spring_constant: Array
    axial_stiffness: Array
    damping: Array
    node_mass: Array  # (n_nodes,)
    node_load: Array  # (n_nodes, n_axes), without force inputs
    gravity: Array  # (n_axes,)


@dataclass(frozen=True)
class Members:
    """What the members do: one row a member."""

    vector: Array  # (n_members, n_axes)
    length: Array
    direction: Array  # (n_members, n_axes)
    rate: Array  # d length / dt
    relative_velocity: Array  # (n_members, n_axes)
    stiffness: Array  # mu
    extension: Array  # l - rho
    static_active: NDArray[np.bool_]  # carries a static force
    active: NDArray[np.bool_]  # carries a force, damping counted
    static_tension: Array
    tension: Array


class ReferenceModel:
    """All quantities of one structure; arguments of `compute` default to the structure's own values.

    parameters: argument name -> indices that its value runs over; by default every parameter runs over all
    nodes or members. `anchor_position` (k, n_axes) moves the anchored axes of its nodes alone.
    """

    def __init__(self, structure: Structure, parameters: Mapping[str, tuple[int, ...]] | None = None) -> None:
        if structure.is_rigid.any():
            raise ValueError("members without stiffness are beyond this reference")
        self.structure = structure
        self.axes = list(structure.axes)
        self.parameters = dict(parameters) if parameters is not None else all_parameters(structure)
        self.free = ~structure.node_anchored[:, self.axes].ravel()
        self.incidence = self._incidence()
        self.spread = sparse.csr_array(sparse.kron(self.incidence, sparse.eye_array(len(self.axes))))
        self.manifest = build_manifest(structure, self.parameters)

    def has(self, quantity: str) -> bool:
        return quantity in NODE_POSITION_QUANTITIES

    def nominal(self, argument: str) -> Array:
        spec = self.manifest.argument(argument)
        return np.array(spec.nominal, dtype=float).reshape(spec.shape)

    def compute(self, quantity: str, /, *, out: Array | None = None, **arguments: Any) -> Any:
        unknown = set(arguments) - set(ARGUMENTS)
        if unknown:
            raise KeyError(f"unknown arguments {sorted(unknown)}")
        values = self._values(arguments)
        result = getattr(self, f"_{quantity}")(values, self._members(values))
        if QUANTITIES[quantity].sparse:
            return sparse.csc_array(result)
        if QUANTITIES[quantity].shape == ():
            return float(result)
        if out is None:
            return np.asarray(result)
        out[...] = result
        return out

    # --- arguments ---------------------------------------------------------------------------------

    def _parameter(self, name: str, given: Mapping[str, Any]) -> Array:
        value = np.array(full_value(self.structure, name), dtype=float)
        if given.get(name) is not None:
            index = slice(None) if name == "gravity" else list(self.parameters[name])
            value[index] = np.asarray(given[name], dtype=float).reshape(value[index].shape)
        return value

    def _values(self, given: Mapping[str, Any]) -> Values:
        s = self.structure
        position = self._parameter("anchor_position", given).ravel()
        coordinate = given.get("coordinate")
        start = s.node_position[:, self.axes].ravel()[self.free]
        position[self.free] = start if coordinate is None else np.asarray(coordinate)
        velocity = np.zeros(position.size)
        rates = given.get("velocity")
        nominal = s.node_velocity[:, self.axes].ravel()[self.free]
        velocity[self.free] = nominal if rates is None else np.asarray(rates)
        inputs = np.array(given.get("input") if given.get("input") is not None else np.zeros(len(s.inputs)))
        rest_length = self._parameter("rest_length", given)
        for value, item in zip(inputs, s.inputs, strict=True):
            for e, gain in item.rest_length_gain.items():
                rest_length[e] += gain * value
        shape = (s.n_nodes, len(self.axes))
        others = ("spring_constant", "axial_stiffness", "damping", "node_mass", "node_load", "gravity")
        return Values(
            position.reshape(shape),
            velocity.reshape(shape),
            inputs,
            rest_length,
            **{name: self._parameter(name, given) for name in others},
        )

    def _members(self, v: Values) -> Members:
        vector, relative = self.incidence @ v.position, self.incidence @ v.velocity
        length = np.sqrt((vector**2).sum(axis=1))
        direction = vector / length[:, None]
        rate = (direction * relative).sum(axis=1)
        stiffness = v.spring_constant + v.axial_stiffness / v.rest_length
        extension = length - v.rest_length
        taut = ~self.structure.tension_only | (extension > 0)
        pull = stiffness * extension + v.damping * rate
        active = taut & (~self.structure.tension_only | (pull > 0))
        return Members(
            vector,
            length,
            direction,
            rate,
            relative,
            stiffness,
            extension,
            taut,
            active,
            np.where(taut, stiffness * extension, 0.0),
            np.where(active, pull, 0.0),
        )

    # --- members -----------------------------------------------------------------------------------

    def _member_vector(self, v: Values, m: Members) -> Array:
        return m.vector

    def _member_length(self, v: Values, m: Members) -> Array:
        return m.length

    def _member_tension(self, v: Values, m: Members) -> Array:
        return m.tension

    def _force_density(self, v: Values, m: Members) -> Array:
        return m.tension / m.length

    def _member_extension(self, v: Values, m: Members) -> Array:
        return m.extension

    def _member_stress(self, v: Values, m: Members) -> Array:
        outer, inner = self._radii()
        return m.tension / (np.pi * (outer**2 - inner**2))

    def _buckling_margin(self, v: Values, m: Members) -> Array:
        outer, inner = self._radii()
        load = np.pi**2 * m.stiffness * v.rest_length * (outer**2 + inner**2) / 4 / m.length**2
        presses = ~self.structure.tension_only & (-m.tension * 1e6 > load)
        return np.where(presses, load / np.where(presses, -m.tension, 1.0), 1e6)

    def _radii(self) -> tuple[Array, Array]:
        outer, inner = self.structure.radius, self.structure.inner_radius
        return outer, np.zeros_like(outer) if inner is None else inner

    def _cable_margin(self, v: Values, m: Members) -> Array:
        margin = np.minimum(m.extension, m.extension + v.damping * m.rate / m.stiffness)
        return margin[self.structure.tension_only]

    def _switch_margin(self, v: Values, m: Members) -> Array:
        return np.zeros(0)

    # --- pairs of bars -----------------------------------------------------------------------------

    def _bars(self, v: Values) -> list[tuple[Array, Nearest]]:
        """The four end points (4, 3) of each pair and where the two are nearest."""
        space = np.zeros((self.structure.n_nodes, 3))
        space[:, self.axes] = v.position
        corners = [
            space[self.structure.connectivity[pair]].reshape(4, 3) for pair in self.structure.bar_pairs
        ]
        return [(four, find_nearest(*four)) for four in corners]

    def _bar_distance(self, v: Values, m: Members) -> Array:
        radii = self.structure.radius[self.structure.bar_pairs].sum(axis=1)
        return np.array([near.distance for _, near in self._bars(v)]) - radii

    def _bar_distance_case(self, v: Values, m: Members) -> Array:
        return np.array([float(near.case) for _, near in self._bars(v)])

    def _bar_distance_parameters(self, v: Values, m: Members) -> Array:
        return np.array([(near.s, near.t) for _, near in self._bars(v)]).reshape(-1, 2)

    def _bar_nearest_point(self, v: Values, m: Members) -> Array:
        points = [(a + near.s * (b - a), c + near.t * (d - c)) for (a, b, c, d), near in self._bars(v)]
        return np.array(points).reshape(-1, 3)[:, self.axes]

    def _bar_distance_jacobian(self, v: Values, m: Members) -> Array:
        rows = np.zeros((len(self.structure.bar_pairs), self.structure.n_nodes, len(self.axes)))
        for row, pair, ((a, b, c, d), near) in zip(
            rows, self.structure.bar_pairs, self._bars(v), strict=True
        ):
            gap = c + near.t * (d - c) - a - near.s * (b - a)
            weights = (near.s - 1, -near.s, 1 - near.t, near.t)
            for node, weight in zip(self.structure.connectivity[pair].ravel(), weights, strict=True):
                row[node] += weight * gap[self.axes] / np.linalg.norm(gap)
        return rows.reshape(len(rows), self.free.size)[:, self.free]

    # --- forces ------------------------------------------------------------------------------------

    def _carried_mass(self, v: Values) -> Array:
        """Mass whose weight acts on each node: its own and half of its members'."""
        return np.asarray(v.node_mass + abs(self.incidence).T @ self.structure.member_mass / 2)

    def _applied(self, v: Values) -> Array:
        """Weight, loads and force inputs on every node, (n_nodes, n_axes)."""
        force = v.node_load + self._carried_mass(v)[:, None] * v.gravity
        for value, item in zip(v.input, self.structure.inputs, strict=True):
            if item.kind == "force":
                for node in item.targets:
                    force[node] += value * np.array(item.direction)[self.axes]
        return force

    def _static_force(self, v: Values, m: Members) -> Array:
        return self._applied(v) - self.incidence.T @ (m.static_tension[:, None] * m.direction)

    def _node_speed(self, v: Values, m: Members) -> Array:
        return np.linalg.norm(v.velocity, axis=1)

    def _node_force(self, v: Values, m: Members) -> Array:
        return self._applied(v) - self.incidence.T @ (m.tension[:, None] * m.direction)

    def _node_residual(self, v: Values, m: Members) -> Array:
        return self._static_force(v, m).ravel()[self.free]

    def _cable_force(self, v: Values, m: Members) -> Array:
        tension = np.where(self.structure.tension_only, m.tension, 0.0)
        force = self._applied(v) - self.incidence.T @ (tension[:, None] * m.direction)
        return force.ravel()[self.free]

    def _member_law(self, v: Values, m: Members) -> Array:
        """Rest length, mu, damping and the part of the member vector that anchors make."""
        held = np.where(self.free.reshape(v.position.shape), 0.0, v.position)
        return np.column_stack([v.rest_length, m.stiffness, v.damping, self.incidence @ held])

    def _support_reaction(self, v: Values, m: Members) -> Array:
        return -self._static_force(v, m).ravel()[~self.free]

    def _equilibrium_matrix(self, v: Values, m: Members) -> Any:
        """Column e: +d/l on node i, -d/l on node j."""
        return self._from_members(m.direction)[self.free]

    # --- energies ----------------------------------------------------------------------------------

    def _elastic_energy(self, v: Values, m: Members) -> Any:
        return (m.stiffness * m.extension**2 / 2)[m.static_active].sum()

    def _potential_energy(self, v: Values, m: Members) -> Any:
        return self._elastic_energy(v, m) - (self._applied(v) * v.position).sum()

    def _kinetic_energy(self, v: Values, m: Members) -> Any:
        rates = v.velocity.ravel()[self.free]
        return rates @ (self._mass_matrix(v, m) @ rates) / 2

    def _total_energy(self, v: Values, m: Members) -> Any:
        return self._kinetic_energy(v, m) + self._potential_energy(v, m)

    # --- dynamics ----------------------------------------------------------------------------------

    def _mass_matrix(self, v: Values, m: Members) -> Any:
        """Point masses; (m/6) [2 1; 1 2] of bars, |B|^T (m/6) |B| as its all-ones part; m/2 of cables."""
        bar = self.structure.member_mass * self.structure.is_bar
        ends = abs(self.incidence)
        ones = ends.T @ sparse.diags_array(bar / 6) @ ends
        more = sparse.diags_array(ends.T @ (bar / 6 + (self.structure.member_mass - bar) / 2))
        whole = sparse.diags_array(v.node_mass) + ones + more
        return self._free_block(sparse.kron(whole, sparse.eye_array(len(self.axes))))

    def _solve_mass(self, v: Values, m: Members, right: Any) -> Any:
        matrix = sparse.csc_array(self._mass_matrix(v, m))
        diagonal = matrix.diagonal()
        if (abs(matrix - sparse.diags_array(diagonal))).sum() == 0:
            return sparse.diags_array(1 / diagonal) @ right
        return sparse_linalg.splu(matrix).solve(right.toarray() if sparse.issparse(right) else right)

    def _acceleration(self, v: Values, m: Members) -> Array:
        return np.asarray(self._solve_mass(v, m, self._node_force(v, m).ravel()[self.free]))

    def _state_derivative(self, v: Values, m: Members) -> Array:
        return np.concatenate([v.velocity.ravel()[self.free], self._acceleration(v, m)])

    # --- stiffness ---------------------------------------------------------------------------------

    def _material_stiffness(self, v: Values, m: Members) -> Any:
        factor = np.where(m.static_active, m.stiffness, 0.0)
        return self._free_block(
            self._between_members(factor[:, None, None] * outer(m.direction, m.direction))
        )

    def _geometric_stiffness(self, v: Values, m: Members) -> Any:
        factor = m.static_tension / m.length
        return self._free_block(self._between_members(factor[:, None, None] * across(m.direction)))

    def _tangent_stiffness(self, v: Values, m: Members) -> Any:
        return self._material_stiffness(v, m) + self._geometric_stiffness(v, m)

    def _damping_matrix(self, v: Values, m: Members) -> Any:
        return self._free_block(self._between_members(self._damping_blocks(v, m)))

    def _damping_blocks(self, v: Values, m: Members) -> Array:
        return np.where(m.active, v.damping, 0.0)[:, None, None] * outer(m.direction, m.direction)

    def _force_gradient(self, v: Values, m: Members) -> Any:
        """d(node force)/d(node position), all nodes: the tangent stiffness with the damping terms."""
        turned = (across(m.direction) @ m.relative_velocity[:, :, None])[:, :, 0] / m.length[:, None]
        pull = m.stiffness[:, None] * m.direction + v.damping[:, None] * turned
        blocks = outer(m.direction, np.where(m.active[:, None], pull, 0.0))
        blocks += (m.tension / m.length)[:, None, None] * across(m.direction)
        return -self._between_members(blocks)

    # --- Jacobians of the state derivative ---------------------------------------------------------

    def _state_jacobian(self, v: Values, m: Members) -> Any:
        to_position = self._solve_mass(v, m, self._free_block(self._force_gradient(v, m)))
        to_velocity = self._solve_mass(v, m, -self._damping_matrix(v, m))
        n = int(self.free.sum())
        return sparse.block_array(
            [
                [sparse.csr_array((n, n)), sparse.eye_array(n)],
                [sparse.csr_array(to_position), sparse.csr_array(to_velocity)],
            ]
        )

    def _to_state(self, v: Values, m: Members, force_columns: Any) -> Any:
        """[0; H^-1 df/dp] from df/dp over all nodes and axes."""
        lower = self._solve_mass(v, m, sparse.csc_array(sparse.csr_array(force_columns)[self.free]))
        return sparse.vstack([sparse.csr_array(lower.shape), sparse.csr_array(lower)])

    def _of_tension(self, m: Members, change: Array) -> Any:
        """df/dp when p of each member changes its tension by `change`."""
        return self._from_members(-np.where(m.active, change, 0.0)[:, None] * m.direction)

    def _of_rest_length(self, v: Values, m: Members) -> Any:
        return self._of_tension(m, -v.spring_constant - v.axial_stiffness * m.length / v.rest_length**2)

    def _rest_length_jacobian(self, v: Values, m: Members) -> Any:
        return self._to_state(v, m, self._of_rest_length(v, m))

    def _residual_rest_length_jacobian(self, v: Values, m: Members) -> Any:
        slope = -v.spring_constant - v.axial_stiffness * m.length / v.rest_length**2
        pulls = -np.where(m.static_active, slope, 0.0)[:, None] * m.direction
        return self._from_members(pulls)[self.free]

    def _tension_rest_length_derivative(self, v: Values, m: Members) -> Array:
        slope = -v.spring_constant - v.axial_stiffness * m.length / v.rest_length**2
        return np.where(m.active, slope, 0.0)

    def _tension_jacobian(self, v: Values, m: Members) -> Any:
        turned = (across(m.direction) @ m.relative_velocity[:, :, None])[:, :, 0] / m.length[:, None]
        gradient = m.stiffness[:, None] * m.direction + v.damping[:, None] * turned
        return self._from_members(np.where(m.active[:, None], gradient, 0.0))[self.free].T

    def _input_jacobian(self, v: Values, m: Members) -> Any:
        of_rest_length = sparse.csc_array(self._of_rest_length(v, m)).toarray()
        columns = np.zeros((self.free.size, len(self.structure.inputs)))
        for column, item in enumerate(self.structure.inputs):
            if item.kind == "rest_length":
                columns[:, column] = of_rest_length[:, list(item.targets)].sum(axis=1)
            else:
                push = np.zeros((self.structure.n_nodes, len(self.axes)))
                for node in item.targets:
                    push[node] += np.array(item.direction)[self.axes]
                columns[:, column] = push.ravel()
        return self._to_state(v, m, columns)

    def _parameter_jacobian(self, v: Values, m: Members) -> Any:
        """Columns parameter by parameter in the order of PARAMETERS; node vectors node by node."""
        blocks = [self._columns(name, v, m) for name in PARAMETERS if name in self.parameters]
        if not blocks:
            return np.zeros((2 * int(self.free.sum()), 0))
        return self._to_state(v, m, np.hstack(blocks))

    def _columns(self, name: str, v: Values, m: Members) -> Array:
        n_axes, index = len(self.axes), np.array(self.parameters[name], dtype=int)
        per_axis = (index[:, None] * n_axes + np.arange(n_axes)).ravel()
        eye = np.eye(self.free.size)
        if name == "rest_length":
            return np.asarray(self._of_rest_length(v, m).toarray()[:, index])
        if name == "spring_constant":
            return np.asarray(self._of_tension(m, m.extension).toarray()[:, index])
        if name == "axial_stiffness":
            return np.asarray(self._of_tension(m, m.extension / v.rest_length).toarray()[:, index])
        if name == "damping":
            return np.asarray(self._of_tension(m, m.rate).toarray()[:, index])
        if name == "node_mass":
            missing = np.tile(v.gravity, self.structure.n_nodes)
            missing[self.free] -= self._acceleration(v, m)
            return (eye * missing).reshape(-1, self.structure.n_nodes, n_axes).sum(axis=2)[:, index]
        if name == "node_load":
            return eye[:, per_axis]
        if name == "anchor_position":
            moved = self._force_gradient(v, m).toarray() * ~self.free
            return np.asarray(moved[:, per_axis])
        return np.kron(self._carried_mass(v)[:, None], np.eye(n_axes))

    # --- assembly ----------------------------------------------------------------------------------

    def _incidence(self) -> Any:
        """(n_members, n_nodes): +1 at i, -1 at j."""
        s = self.structure
        members = np.arange(s.n_members)
        i, j = s.connectivity.T
        signs = np.concatenate([np.ones(s.n_members), -np.ones(s.n_members)])
        where = (np.concatenate([members, members]), np.concatenate([i, j]))
        return sparse.csr_array((signs, where), shape=(s.n_members, s.n_nodes))

    def _from_members(self, vectors: Array) -> Any:
        """Matrix with vectors[e] on node i and -vectors[e] on node j in column e."""
        count, n_axes = vectors.shape
        starts = np.arange(count + 1)
        blocks = sparse.bsr_array(
            (vectors[:, :, None], np.arange(count), starts), shape=(count * n_axes, count)
        )
        return sparse.csr_array(self.spread.T @ blocks)

    def _between_members(self, blocks: Array) -> Any:
        """Sum over members of (e_i - e_j)(e_i - e_j)^T kron blocks[e]."""
        count, n_axes = blocks.shape[:2]
        middle = sparse.bsr_array(
            (blocks, np.arange(count), np.arange(count + 1)), shape=(count * n_axes, count * n_axes)
        )
        return sparse.csr_array(self.spread.T @ middle @ self.spread)

    def _free_block(self, matrix: Any) -> Any:
        return sparse.csc_array(sparse.csr_array(matrix)[self.free])[:, self.free]


def outer(left: Array, right: Array) -> Array:
    """Row by row outer products, (n, a, a)."""
    return left[:, :, None] * right[:, None, :]


def across(direction: Array) -> Array:
    """I - u u^T of each row u."""
    return np.eye(direction.shape[1]) - outer(direction, direction)
