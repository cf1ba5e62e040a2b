"""Structures whose cables go slack and taut all the time, for the tests of integrators."""

from typing import Any

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import bar, cable, make_structure, spring

CORNERS = [[0, 0, 0], [3, 0, 0], [1.3, 0, 2.5], [1.7, 0, -2.2], [1.45, 0, 0.1]]
CABLES = ((0, 1.5, 40.0), (1, 1.6, 60.0), (2, 2.5, 30.0), (3, 2.4, 50.0))  # corner, rest length, stiffness


def net(damping: float = 0.0, rod: float | None = None, **more: Any) -> Structure:
    """A mass in a plane that flies about between four cables, all slack in the middle.

    rod: stiffness of a bar from it to another mass.
    """
    members = [cable(k, 4, rest, mu, damping=damping) for k, rest, mu in CABLES]
    members += [bar(4, 5, 0.5, rod)] if rod is not None else []
    place = CORNERS if rod is None else [*CORNERS, [1.75, 0, 0.5]]
    held = dict.fromkeys(range(4), "xyz")
    structure = make_structure(place, members, anchored=held, axes="xz", **({"mass": 0.3} | more))
    velocity = np.zeros((len(place), 3))
    velocity[4:] = (1.0, 0.0, 0.7)
    return structure.with_changes(node_velocity=velocity)


def swinging() -> Structure:
    """x = 0.2 cos(20 t) + 1 on a spring, and a weak cable that is taut at the tops if 1.2 m is longer."""
    members = [spring(0, 1, 1.0, 40.0), cable(0, 1, 1.19, 1e-9)]
    return make_structure([[0, 0, 0], [0.8, 0, 0]], members, anchored={0: "xyz"}, mass=0.1, axes="x")


def crossing_bars() -> Structure:
    """A bar flies through another: their surfaces meet at t = 0.45 s and part at 0.55 s."""
    position = [[0, -0.5, 0], [0, 0.5, 0], [-0.5, 0, 1], [0.5, 0, 1]]
    structure = make_structure(position, [bar(0, 1, 1.0), bar(2, 3, 1.0)])
    velocity = np.array([[0.0] * 3] * 2 + [[0.0, 0.0, -2.0]] * 2)
    return structure.with_changes(radius=np.full(2, 0.05), node_velocity=velocity)
