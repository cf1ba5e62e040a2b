"""Random structures for property tests: valid, connected and well-conditioned, of every flavour."""

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import ActuatedInput, Structure

Array = NDArray[np.float64]
AXES = ((0, 1, 2), (0, 1, 2), (0, 1, 2), (0, 2), (0, 1), (1, 2), (2,))
SHORTEST, LONGEST = 0.3, 3.0
KINK_GAP = 1e-3  # least |l - rho| / l and least |tension| / (mu l) of a taut cable


@st.composite
def structures(draw: st.DrawFn, *, least_nodes: int = 2, most_nodes: int = 40) -> Structure:
    """Structures of 2 to 40 nodes, with and without every optional feature.

    Some axes dropped, some nodes anchored on some axes, slack and two-sided cables, both stiffness laws,
    bars with own mass, gravity, damping, loads, velocities, inputs of both kinds. Members measure 0.3 to
    3 m; no cable is near its slack kink at the stated positions and velocities.
    """
    axes = draw(st.sampled_from(AXES))
    n_nodes = draw(st.integers(least_nodes, min(most_nodes, 12 if len(axes) == 1 else most_nodes)))
    wants = {
        name: draw(st.booleans())
        for name in ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack")
    }
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return make_structure(rng, n_nodes, axes, wants)


def make_structure(
    rng: np.random.Generator, n_nodes: int, axes: tuple[int, ...], wants: dict[str, bool]
) -> Structure:
    """Return one random structure with the wanted features."""
    position, tree = place_nodes(rng, n_nodes, axes)
    connectivity = add_members(rng, position, tree)
    anchored = place_anchors(rng, n_nodes, axes) if wants["anchors"] else np.zeros((n_nodes, 3), dtype=bool)
    members = member_values(rng, position, connectivity, wants)
    on_axes = np.isin(np.arange(3), axes)
    velocity = rng.normal(size=(n_nodes, 3)) * on_axes * ~anchored * wants["velocity"]
    members["damping"] = keep_off_kink(position, velocity, connectivity, members)
    heavy = np.isin(np.arange(n_nodes), connectivity[members["member_mass"] > 0])
    massless = heavy & (rng.random(n_nodes) < 0.3)
    count = len(connectivity)
    return Structure(
        name="random",
        axes=axes,
        node_name=tuple(f"n{k}" for k in range(n_nodes)),
        node_position=position,
        node_velocity=velocity,
        node_mass=np.where(massless, 0.0, rng.uniform(0.1, 2.0, n_nodes)),
        node_anchored=anchored,
        node_load=rng.normal(size=(n_nodes, 3)) * on_axes * wants["loads"],
        gravity=np.where(on_axes, rng.uniform(-10, 10, 3), 0.0) * wants["gravity"],
        member_name=tuple(f"e{k}" for k in range(count)),
        member_class=tuple("bar" if bar else "cable" for bar in members["is_bar"]),
        connectivity=connectivity,
        radius=np.zeros(count),
        inputs=make_inputs(rng, n_nodes, count, axes) if wants["inputs"] else (),
        **members,
    )


def place_nodes(
    rng: np.random.Generator, n_nodes: int, axes: tuple[int, ...]
) -> tuple[Array, list[tuple[int, int]]]:
    """Grow a tree of nodes: each 0.5 to 1.5 m from its parent and well off all the others."""
    reach = np.array(axes)
    position = np.tile(rng.uniform(-1, 1, 3), (n_nodes, 1))
    tree = []
    for node in range(1, n_nodes):
        while True:
            parent = int(rng.integers(node))
            step = rng.normal(size=len(axes))
            step *= rng.uniform(0.5, 1.5) / np.linalg.norm(step)
            candidate = position[parent, reach] + step
            gaps = np.linalg.norm(position[:node, reach] - candidate, axis=1)
            if gaps.min() > SHORTEST:
                break
        position[node, reach] = candidate
        tree.append((parent, node))
    return position, tree


def add_members(rng: np.random.Generator, position: Array, tree: list[tuple[int, int]]) -> NDArray[np.int64]:
    """Add up to three members a node between pairs less than 3 m apart; ends in random order."""
    taken = {frozenset(pair) for pair in tree}
    pairs = list(tree)
    for _ in range(int(rng.integers(0, 3 * len(position) + 1))):
        i, j = (int(k) for k in rng.choice(len(position), 2, replace=False))
        if frozenset((i, j)) not in taken and np.linalg.norm(position[i] - position[j]) < LONGEST:
            taken.add(frozenset((i, j)))
            pairs.append((i, j))
    return np.array([pair if rng.random() < 0.5 else pair[::-1] for pair in pairs], dtype=np.int64)


def place_anchors(rng: np.random.Generator, n_nodes: int, axes: tuple[int, ...]) -> NDArray[np.bool_]:
    """Anchor some nodes, wholly or on some axes, and leave at least one coordinate free."""
    whole = rng.random((n_nodes, 1)) < 0.2
    partly = (rng.random((n_nodes, 1)) < 0.2) & (rng.random((n_nodes, 3)) < 0.5)
    anchored = whole | partly
    anchored[int(rng.integers(n_nodes)), axes[0]] = False
    return np.asarray(anchored)


def member_values(
    rng: np.random.Generator, position: Array, connectivity: NDArray[np.int64], wants: dict[str, bool]
) -> dict[str, Any]:
    """Kinds, stiffnesses, rest lengths and masses of the members."""
    count = len(connectivity)
    length = np.linalg.norm(position[connectivity[:, 0]] - position[connectivity[:, 1]], axis=1)
    is_bar = rng.random(count) < 0.35
    tension_only = ~is_bar & (rng.random(count) < 0.8)
    strain = rng.uniform(0.01, 0.3, count)
    loose = rng.random(count) < 0.3
    strain[loose & (is_bar | ~tension_only | wants["slack"])] *= -1
    mu = np.exp(rng.uniform(np.log(20), np.log(2000), count)) * np.where(is_bar, 20, 1)
    rest_length = length * (1 - strain)
    axial = rng.random(count) < 0.5
    return {
        "is_bar": is_bar,
        "tension_only": tension_only,
        "rest_length": rest_length,
        "spring_constant": np.where(axial, 0.0, mu),
        "axial_stiffness": np.where(axial, mu * rest_length, 0.0),
        "damping": rng.uniform(0.1, 5, count) * (rng.random(count) < 0.7) * wants["damping"],
        "member_mass": rng.uniform(0.1, 1, count) * is_bar * wants["bar_mass"],
    }


def keep_off_kink(
    position: Array, velocity: Array, connectivity: NDArray[np.int64], members: dict[str, Any]
) -> Array:
    """Return the damping with those taken out that bring a taut cable's force near zero."""
    i, j = connectivity.T
    vector = position[i] - position[j]
    length = np.linalg.norm(vector, axis=1)
    rate = (vector * (velocity[i] - velocity[j])).sum(axis=1) / length
    mu = members["spring_constant"] + members["axial_stiffness"] / members["rest_length"]
    force = mu * (length - members["rest_length"]) + members["damping"] * rate
    near = members["tension_only"] & (np.abs(force) < KINK_GAP * mu * length)
    return np.where(near, 0.0, members["damping"])


def make_inputs(
    rng: np.random.Generator, n_nodes: int, n_members: int, axes: tuple[int, ...]
) -> tuple[ActuatedInput, ...]:
    """One to four inputs of both kinds, each on one to three targets."""
    made = []
    for number in range(int(rng.integers(1, 5))):
        force = bool(rng.random() < 0.5)
        among = n_nodes if force else n_members
        targets = rng.choice(among, min(among, int(rng.integers(1, 4))), replace=False)
        direction = np.zeros(3)
        if force:
            direction[list(axes)] = rng.normal(size=len(axes))
            direction /= np.linalg.norm(direction)
        made.append(
            ActuatedInput(
                f"u{number}",
                "force" if force else "rest_length",
                tuple(int(k) for k in targets),
                (float(direction[0]), float(direction[1]), float(direction[2])),
            )
        )
    return tuple(made)
