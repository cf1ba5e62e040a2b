"""Small structures written in a few words, for the tests of the analyses."""

from typing import Any

import numpy as np

from tensegrity_codegen.structure.structure import ActuatedInput, Structure


def cable(i: int, j: int, rest: float, mu: float = 100.0, **more: Any) -> dict[str, Any]:
    """A cable that goes slack."""
    return {"ends": (i, j), "rest": rest, "mu": mu, "tension_only": True} | more


def spring(i: int, j: int, rest: float, mu: float = 100.0, **more: Any) -> dict[str, Any]:
    """A two-sided cable."""
    return {"ends": (i, j), "rest": rest, "mu": mu} | more


def bar(i: int, j: int, rest: float, mu: float = 1e5, **more: Any) -> dict[str, Any]:
    """A bar by its spring constant."""
    return {"ends": (i, j), "rest": rest, "mu": mu, "bar": True} | more


def make_structure(
    position: Any,
    members: list[dict[str, Any]],
    *,
    anchored: dict[int, str] | None = None,
    axes: str = "xyz",
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    load: dict[int, tuple[float, float, float]] | None = None,
    mass: Any = 1.0,
    inputs: tuple[ActuatedInput, ...] = (),
) -> Structure:
    """Return the structure of (n, 3) positions; anchored: node -> the axes that are held."""
    place = np.array(position, dtype=float)
    n, held, loads = len(place), np.zeros((len(place), 3), dtype=bool), np.zeros((len(place), 3))
    for node, letters in (anchored or {}).items():
        held[node, ["xyz".index(letter) for letter in letters]] = True
    for node, force in (load or {}).items():
        loads[node] = force

    def column(key: str, default: Any) -> Any:
        return np.array([m.get(key, default) for m in members])

    return Structure(
        name="small",
        axes=tuple("xyz".index(letter) for letter in axes),
        node_name=tuple(f"n{k}" for k in range(n)),
        node_position=place,
        node_velocity=np.zeros((n, 3)),
        node_mass=np.broadcast_to(np.asarray(mass, dtype=float), n),
        node_anchored=held,
        node_load=loads,
        gravity=np.array(gravity, dtype=float),
        member_name=tuple(f"e{k}" for k in range(len(members))),
        member_class=tuple("c" for _ in members),
        connectivity=np.array([m["ends"] for m in members], dtype=np.int64),
        is_bar=column("bar", False),
        tension_only=column("tension_only", False),
        rest_length=column("rest", 1.0).astype(float),
        spring_constant=column("mu", 0.0).astype(float),
        axial_stiffness=column("axial", 0.0).astype(float),
        damping=column("damping", 0.0).astype(float),
        member_mass=column("mass", 0.0).astype(float),
        radius=np.zeros(len(members)),
        inputs=inputs,
    )


def prism(
    twist: float = 150.0, *, sides: int = 3, bar_stiffness: float = 1e5, strain: float = 0.1, **more: Any
) -> Structure:
    """Prism of unit radius and height: bars i -> i, side cables i -> i + 1, horizontal cables; angles in deg.

    The top is turned by `twist`; a prism of n bars has its self-stress at 90 + 180/n.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    top = angle + np.radians(twist)
    low = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    high = np.stack([np.cos(top), np.sin(top), np.ones(sides)], axis=1)
    position = np.vstack([low, high])

    def length(i: int, j: int) -> float:
        return float(np.linalg.norm(position[i] - position[j]))

    members = []
    for k in range(sides):
        following = (k + 1) % sides
        members.append(bar(k, sides + k, length(k, sides + k), bar_stiffness))
        for i, j in ((k, following), (sides + k, sides + following), (following, sides + k)):
            members.append(cable(i, j, (1 - strain) * length(i, j)))
    return make_structure(position, members, **more)
