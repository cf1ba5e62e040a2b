"""From the ground of a structure or body system back to the table [ground] of a scene."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tensegrity_codegen.structure.contact_estimates import Subject, find_bar_radius, find_surface_nodes
from tensegrity_codegen.system.errors import InvalidValueError


def describe_ground(subject: Subject, name_node: Callable[[int], str]) -> dict[str, Any]:
    """Return the table [ground] with its numbers explicit, empty without a ground; name_node: names by index.

    Reading it back gives the same ground bit by bit. Raises InvalidValueError for radii that differ and are
    not those of bars, which no scene can state.
    """
    ground = subject.ground
    if ground is None:
        return {}
    is_all = np.array_equal(ground.node, find_surface_nodes(subject, ground.normal))
    table: dict[str, Any] = {
        "normal": ground.normal.tolist(),
        "offset": float(ground.offset),
        "velocity": ground.velocity.tolist() if ground.velocity.any() else None,
        "contacts": "all" if is_all else [name_node(int(node)) for node in ground.node],
        "radius": float(ground.radius[0]),
        "stiffness": float(ground.stiffness),
        "exponent": float(ground.exponent),
        "dissipation": float(ground.dissipation),
        "friction": float(ground.friction),
        "static_friction": ground.static_friction,
        "stick_stiffness": float(ground.stick_stiffness) or None,
        "stick_damping": float(ground.stick_damping) or None,
    }
    if (ground.radius != ground.radius[0]).any():
        if not np.array_equal(ground.radius, find_bar_radius(subject)[ground.node]):
            problem, location = "radii of contacts that a scene cannot state", "ground.radius"
            allowed = "one radius, or those of the bars that end at the contacts"
            raise InvalidValueError(problem, where=location, given=ground.radius.tolist(), allowed=allowed)
        table["radius"] = "bar"
    return {key: value for key, value in table.items() if value is not None}
