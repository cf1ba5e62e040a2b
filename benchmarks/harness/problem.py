"""What is timed: structures of many sizes as plain arrays that every peer can use.

All of them are undamped and have point masses only, so that every peer can state the same physics:

f = weight + load + sum of -t d / l on node i and + on node j,   t = mu (l - rho), cables none when slack
U = sum mu (l - rho)^2 / 2 of taut members
K = sum of mu d d^T / l^2 + t/l (I - d d^T / l^2) of taut members, on the free coordinates
"""

from dataclasses import dataclass
from functools import cached_property
from importlib.resources import as_file, files
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# What is timed: force, energy, both Jacobians, and what an integrator asks for.
QUANTITIES = ("node_force", "elastic_energy", "tangent_stiffness", "state_jacobian", "acceleration")

_SEED = 4
_DISTURBANCE = 0.1  # of the mean member length: some cables go slack


@dataclass(frozen=True)
class StiffnessPattern:
    """Where the entries of member blocks land in the compressed columns of the tangent stiffness.

    row, column_start: the pattern; slot (k,): entry of S (n_members, 3, 3), flat; place (k,): the non-zero it
    adds to; sign (k,): +1 or -1.
    """

    row: IntArray
    column_start: IntArray
    slot: IntArray
    place: IntArray
    sign: FloatArray

    @property
    def n_nonzeros(self) -> int:
        """Number of non-zeros."""
        return len(self.row)

    def matrix(self, n_members: int) -> sparse.csr_array:
        """Return the sparse (n_nonzeros, 9 n_members) matrix that adds blocks up."""
        shape = (self.n_nonzeros, 9 * n_members)
        return sparse.csr_array((self.sign, (self.place, self.slot)), shape=shape)


@dataclass(frozen=True)
class Problem:
    """A structure to time and the coordinates at which it is evaluated."""

    name: str
    structure: Structure

    @property
    def n_members(self) -> int:
        """Number of members."""
        return self.structure.n_members

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return self.structure.n_nodes

    def request(self, quantity: str) -> ModelRequest:
        """Return the request for that quantity alone."""
        return ModelRequest((quantity,))

    @cached_property
    def coordinate(self) -> FloatArray:
        """(n_coordinates,): the free coordinates, a little off the scene's own [m]."""
        return self.coordinates(1)[0]

    def coordinates(self, count: int) -> FloatArray:
        """Return `count` different states, (count, n_coordinates) [m]."""
        scale = _DISTURBANCE * float(self.structure.member_length().mean())
        start = self.structure.node_position.reshape(-1)[self.free]
        noise = np.random.default_rng(_SEED).uniform(-scale, scale, (count, len(start)))
        return np.ascontiguousarray(start + noise)

    @cached_property
    def free(self) -> IntArray:
        """(n_coordinates,): place of each free coordinate among the 3 n_nodes node coordinates."""
        return self.structure.coordinate_node_axis @ np.array([3, 1])

    @property
    def is_all_free(self) -> bool:
        """Whether no node is held."""
        return len(self.free) == 3 * self.n_nodes

    @cached_property
    def fixed_position(self) -> FloatArray:
        """(3 n_nodes,): node coordinates of the scene, right where they are held [m]."""
        return np.array(self.structure.node_position.reshape(-1))

    @cached_property
    def first(self) -> IntArray:
        """(n_members,): node i of each member."""
        return np.ascontiguousarray(self.structure.connectivity[:, 0])

    @cached_property
    def second(self) -> IntArray:
        """(n_members,): node j of each member."""
        return np.ascontiguousarray(self.structure.connectivity[:, 1])

    @cached_property
    def mu(self) -> FloatArray:
        """(n_members,): spring constants mu = k + EA / rho [N/m]."""
        return self.structure.spring_constant + self.structure.axial_stiffness / self.rest_length

    @property
    def rest_length(self) -> FloatArray:
        """(n_members,): rest lengths rho [m]."""
        return self.structure.rest_length

    @property
    def tension_only(self) -> NDArray[np.bool_]:
        """(n_members,): members that go slack."""
        return self.structure.tension_only

    @cached_property
    def external(self) -> FloatArray:
        """(n_nodes, 3): weight and load [N]."""
        return self.structure.node_load + self.structure.node_mass[:, None] * self.structure.gravity

    @cached_property
    def mass(self) -> FloatArray:
        """(n_coordinates,): mass of each free coordinate [kg]."""
        return np.repeat(self.structure.node_mass, 3)[self.free]

    @cached_property
    def incidence(self) -> sparse.csr_array:
        """(n_nodes, n_members): -1 at node i, +1 at node j of each member."""
        member = np.arange(self.n_members)
        entries = np.repeat([-1.0, 1.0], self.n_members)
        places = (np.concatenate([self.first, self.second]), np.concatenate([member, member]))
        return sparse.csr_array((entries, places), shape=(self.n_nodes, self.n_members))

    @cached_property
    def stiffness_pattern(self) -> StiffnessPattern:
        """Compressed columns of the tangent stiffness, and where member blocks land in them."""
        index = np.full(3 * self.n_nodes, -1)
        index[self.free] = np.arange(len(self.free))
        at = index.reshape(-1, 3)
        shape = (self.n_members, 3, 3)
        ends = ((self.first, self.first, 1.0), (self.second, self.second, 1.0))
        ends += ((self.first, self.second, -1.0), (self.second, self.first, -1.0))
        parts: list[Any] = []
        for a, b, sign in ends:
            row = np.broadcast_to(at[a][:, :, None], shape).reshape(-1)
            column = np.broadcast_to(at[b][:, None, :], shape).reshape(-1)
            kept = np.flatnonzero((row >= 0) & (column >= 0))
            parts.append((row[kept], column[kept], kept, np.full(len(kept), sign)))
        row, column, slot, sign = (np.concatenate(part) for part in zip(*parts, strict=True))
        key, place = np.unique(column * len(self.free) + row, return_inverse=True)
        start = np.searchsorted(key, np.arange(len(self.free) + 1) * len(self.free))
        return StiffnessPattern(key % len(self.free), start, slot, place, sign)

    def largest_term(self) -> FloatArray:
        """Return the largest single term of each entry of the node force, (3 n_nodes,) [N]."""
        position = self.fixed_position.copy()
        position[self.free] = self.coordinate
        nodes = position.reshape(-1, 3)
        vector = nodes[self.first] - nodes[self.second]
        length = np.linalg.norm(vector, axis=1)
        tension = self.mu * (length - self.rest_length)
        tension[self.tension_only & (tension < 0)] = 0.0
        pull = np.abs(vector * (tension / length)[:, None])
        largest = np.abs(self.external)
        np.maximum.at(largest, self.first, pull)
        np.maximum.at(largest, self.second, pull)
        return largest.reshape(-1)


# The structures that are timed: the shipped prism and icosahedron, and towers up to 100,002 members.
#
# The tower is a stack of three-bar prisms whose levels share their rings of nodes, on an anchored ring:
# 9 members a level (a ring of three cables, three bars, three more cables) and 3 more for the last ring.


SHIPPED = ("prism", "icosahedron")

# Levels of the towers that are timed: 93, 903, 9,003 and 100,002 members.
LEVELS = (10, 100, 1000, 11_111)

_BARS, _RADIUS, _HEIGHT, _TWIST = 3, 0.2, 0.4, np.radians(150.0)
_BAR_CONSTANT, _CABLE_CONSTANT = 2e5, 500.0  # N/m
_SHORTENING = 0.98  # rest length of a cable, of its length
_NODE_MASS = 0.05  # kg


def make_problem(name: str) -> Problem:
    """Return a shipped scene by its name, or `tower<levels>`; undamped, with point masses only."""
    if name in SHIPPED:
        with as_file(files("tensegrity_codegen.scene").joinpath("examples", f"{name}.toml")) as path:
            structure, _ = load_scene(path)
        bare = np.zeros(structure.n_members)
        return Problem(name, structure.with_changes(damping=bare, member_mass=bare))
    return Problem(name, make_tower(int(name.removeprefix("tower"))))


def make_tower(levels: int) -> Structure:
    """Return the tower of that many levels, (9 levels + 3) members."""
    ring, place = np.divmod(np.arange(_BARS * (levels + 1)), _BARS)
    angle = 2 * np.pi * place / _BARS + _TWIST * ring
    position = np.stack([_RADIUS * np.cos(angle), _RADIUS * np.sin(angle), _HEIGHT * ring], axis=1)
    connectivity, is_bar, names = _join(levels)
    length = np.linalg.norm(position[connectivity[:, 0]] - position[connectivity[:, 1]], axis=1)
    nodes, zero = len(position), np.zeros(len(connectivity))
    return Structure(
        name=f"tower{levels}",
        axes=(0, 1, 2),
        node_name=tuple(f"n{r}_{k}" for r, k in zip(ring, place, strict=True)),
        node_position=position,
        node_velocity=np.zeros((nodes, 3)),
        node_mass=np.full(nodes, _NODE_MASS),
        node_anchored=np.repeat(ring[:, None] == 0, 3, axis=1),
        node_load=np.zeros((nodes, 3)),
        gravity=np.array([0.0, 0.0, -9.81]),
        member_name=names,
        member_class=tuple("bar" if bar else "cable" for bar in is_bar),
        connectivity=connectivity,
        is_bar=is_bar,
        tension_only=~is_bar,
        rest_length=np.where(is_bar, length, _SHORTENING * length),
        spring_constant=np.where(is_bar, _BAR_CONSTANT, _CABLE_CONSTANT),
        axial_stiffness=zero,
        damping=zero,
        member_mass=zero,
        radius=zero,
        groups={},
    )


def _join(levels: int) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return connectivity, which members are bars, and member names, level by level."""
    here = np.arange(_BARS)
    onward = np.roll(here, -1)
    ring = np.stack([here, onward], axis=1)
    level = np.concatenate([ring, np.stack([here, here + _BARS], 1), np.stack([here, onward + _BARS], 1)])
    words = [f"{word}{{0}}_{k}" for word in ("ring", "bar", "side") for k in range(_BARS)]
    start = _BARS * np.arange(levels)
    pairs = np.concatenate([(level + start[:, None, None]).reshape(-1, 2), ring + _BARS * levels])
    is_bar = np.concatenate([np.tile(np.repeat([False, True, False], _BARS), levels), np.zeros(_BARS, bool)])
    names = [word.format(k) for k in range(levels) for word in words]
    names += [word.format(levels) for word in words[:_BARS]]
    return pairs.astype(np.int64), is_bar, tuple(names)
