"""The structures that are timed: the shipped prism and icosahedron, and towers up to 100,002 members.

The tower is a stack of three-bar prisms whose levels share their rings of nodes, on an anchored ring:
9 members a level (a ring of three cables, three bars, three more cables) and 3 more for the last ring.
"""

from importlib.resources import as_file, files

import numpy as np

from harness.problem import Problem
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure

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
