"""Long structures that repeat themselves, for tests of loops over many members."""

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import bar, cable, make_structure, spring


def tower(levels: int, *, damping: float = 0.0, spread: float = 0.1) -> Structure:
    """Triangles on three anchors, nine members a level; spread: of stiffness, from member to member."""
    rng = np.random.default_rng(levels)
    angle = 2 * np.pi * np.arange(3) / 3
    position, members = [], []
    for level in range(levels + 1):
        turned = angle + 0.5 * level
        position += np.column_stack([np.cos(turned), np.sin(turned), np.full(3, 0.9 * level)]).tolist()
    for own in range(0, 3 * levels, 3):
        for k in range(3):
            stiffness = rng.uniform(1 - spread, 1 + spread, 3)
            members.append(bar(own + k, own + 3 + (k + 1) % 3, 1.9, 1000 * stiffness[0]))
            members.append(cable(own + k, own + 3 + k, 0.9, 100 * stiffness[1]))
            members.append(cable(own + 3 + k, own + 3 + (k + 1) % 3, 1.6, 0.0, axial=100 * stiffness[2]))
    mass = rng.uniform(1, 2, len(position))
    made = make_structure(position, members, anchored=dict.fromkeys(range(3), "xyz"), mass=mass)
    return made.with_changes(name="tower", damping=np.full(len(members), damping))


def spine(units: int) -> Structure:
    """Five-node units in a row, each joined to the next by saddle and ridge cables, none of them held."""
    rng = np.random.default_rng(units)
    unit = np.array([[0, 0, 0], [1, 1, 0], [1, -1, 0], [-0.2, 0, 1], [-0.2, 0, -1]])
    position = (unit + 0.7 * np.arange(units)[:, None, None] * [1, 0, 0]).reshape(-1, 3)
    members = []
    for first in range(0, 5 * units, 5):
        members += [bar(first, first + k, 1.3, rng.uniform(900, 1100)) for k in range(1, 5)]
        if first:
            members += [spring(first + k, first - 5 + k, 0.6) for k in range(1, 5)]
            members += [
                cable(first - 5 + k, first + m, 1.2, rng.uniform(90, 110)) for k in (1, 2) for m in (3, 4)
            ]
    mass = rng.uniform(1, 2, len(position))
    return make_structure(position, members, gravity=(0.0, 0.0, -9.81), mass=mass)


def grid(length: int, rows: int, axes: str = "xyz") -> Structure:
    """A net of squares with one diagonal each, row after row; its first row is held."""
    rng = np.random.default_rng(length)
    place = np.array([(k, r, 0) for r in range(rows) for k in range(length)], dtype=float)
    place += rng.uniform(-0.1, 0.1, place.shape)
    members = []
    for node in range(length * rows):
        if (node + 1) % length:
            members.append(cable(node, node + 1, 0.9, rng.uniform(90, 110)))
        if node + length < length * rows:
            members.append(cable(node + length, node, 0.8, rng.uniform(90, 110)))
        if (node + 1) % length and node + length < length * rows:
            members.append(spring(node + 1, node + length, 1.2))
    return make_structure(place, members, axes=axes, anchored=dict.fromkeys(range(length), axes))


def twisted(count: int) -> Structure:
    """A chain in which each node is joined to three behind it, by doubled cables to the farthest."""
    rng = np.random.default_rng(count)
    angle = 0.7 * np.arange(count)
    place = np.column_stack([np.cos(angle), np.sin(angle), 0.2 * np.arange(count)])
    members = []
    for node in range(count):
        members += [bar(node, node + k, 0.8, rng.uniform(900, 1100)) for k in (1, 2) if node + k < count]
        members += [cable(node + 12, node, 1.0, 50.0) for _ in range(2) if node + 12 < count]
    return make_structure(place, members)


def shuffled(structure: Structure, seed: int = 0) -> Structure:
    """The same structure with nodes, members and the two ends of members in random order."""
    rng = np.random.default_rng(seed)
    node, member = rng.permutation(structure.n_nodes), rng.permutation(structure.n_members)
    number = np.argsort(node)
    ends = number[structure.connectivity[member]]
    turned = rng.random(len(ends)) < 0.5
    ends[turned] = ends[turned, ::-1]
    of_nodes = ("node_position", "node_velocity", "node_mass", "node_anchored", "node_load")
    of_members = (
        *("is_bar", "tension_only", "rest_length", "spring_constant", "axial_stiffness"),
        *("damping", "member_mass", "radius"),
    )
    return structure.with_changes(
        connectivity=ends,
        **{name: getattr(structure, name)[node] for name in of_nodes},
        **{name: getattr(structure, name)[member] for name in of_members},
    )
