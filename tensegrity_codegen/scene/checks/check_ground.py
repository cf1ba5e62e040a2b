"""Checks of a ground together with the structure or body system that stands on it."""

from collections.abc import Mapping

import numpy as np

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.structure.contact_estimates import (
    ALONG,
    Subject,
    compute_contact_mass,
    find_movable,
    find_position,
)
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, name_list

DEPTH_TOLERANCE = 1e-9  # of the structure's size


def check_indices(indices: tuple[int, ...], size: int, place: str) -> None:
    """Raise InvalidValueError for no index at all, or one that is not from 0 to size - 1."""
    if not indices or min(indices) < 0 or max(indices) >= size:
        problem = "empty, or an index out of range"
        raise InvalidValueError(problem, where=place, given=indices, allowed=f"0 to {size - 1}")


def check_ground(structure: Structure, where: str) -> None:
    """Raise unless the ground of a structure is None, or sound: see check_normal and check_contacts."""
    ground = structure.ground
    if ground is None:
        return
    check_instance(ground, Ground, key_path(where, "ground"), "None, or a Ground")
    check_indices(tuple(ground.node.tolist()), structure.n_nodes, key_path(where, "ground", "node"))
    check_normal(ground.normal, structure.axes, where)
    names = dict(enumerate(structure.node_name))
    check_contacts(structure, ground.normal, ground.offset, ground.node, names, where)


def check_normal(normal: FloatArray, axes: tuple[int, ...], where: str) -> None:
    """Raise StructureError for a normal (3,) that leaves the axes of the scene."""
    outside = [axis for axis in range(3) if axis not in axes and abs(normal[axis]) > ALONG]
    if outside:
        letter = "xyz"[outside[0]]
        problem = f"the ground has a normal along {letter}, an axis that the scene does not model"
        location = key_path(where, "ground", "normal")
        raise StructureError(problem, where=location, given=normal.tolist(), allowed=f"0 along {letter}")


@np.errstate(all="ignore")
def check_contacts(
    subject: Subject, normal: FloatArray, offset: float, node: IntArray, names: Mapping[int, str], where: str
) -> None:
    """Raise StructureError for contacts that cannot move along the normal or have no mass, and for nodes that
    are anchored below the ground.

    normal: (3,); offset: of the plane [m]; node: (n_contacts,) indices; names: of nodes, for messages.
    """
    movable = find_movable(subject, normal)

    def report(is_bad: BoolArray, problem: str, allowed: str, hint: str) -> None:
        bad = [names[int(k)] for k in node[is_bad]]
        if bad:
            message, location = f"{problem}: {name_list(bad)}", key_path(where, "ground", "contacts")
            raise StructureError(message, where=location, given=bad[0], allowed=allowed, hint=hint)

    allowed, hint = "nodes that can move along the normal of the ground", "remove them from the list"
    report(~movable[node], "anchored nodes cannot be contacts", allowed, hint)
    allowed = "nodes with a mass [kg], or at which a bar with a mass ends"
    hint = "give the nodes a mass, or list the contacts without them"
    report(compute_contact_mass(subject, node) == 0, "contacts without mass", allowed, hint)
    position = find_position(subject)
    height = position @ normal - offset
    min_height = -DEPTH_TOLERANCE * max(float(np.ptp(position, axis=0).max()), abs(offset))
    buried = [
        f"{names[int(k)]} ({-height[k]:.4g} m deep)" for k in np.flatnonzero(~movable & (height < min_height))
    ]
    if buried:
        problem = f"anchored nodes are below the ground: {name_list(buried)}"
        allowed = f"at most {float((height[~movable] + offset).min()):.9g} m with these anchors"
        location, hint = (
            key_path(where, "ground", "offset"),
            "lower the ground by offset, or move the anchors up",
        )
        raise StructureError(problem, where=location, given=offset, allowed=allowed, hint=hint)
