"""A rigid structure that touches the ground turns about its feet until its load acts between them.

About one foot, then about the line of two, as a body falls slowly. A point at v from the pivot turns by an
angle s about the axis a to v_a + (v - v_a) cos s + (a x v) sin s, v_a = (a . v) a (Rodrigues), so that the
angle at which it reaches a height, or at which the moment of the loads vanishes, is an arc cosine.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.arrays import FloatArray

MAX_ROLLS = 50  # turns, each onto a further foot
TOUCH = 1e-9  # of the structure's size: gap of a foot that touches, and reach of a load between feet
STRAIGHT = 1e-12  # of the size: distance from the axis of a point that does not move


def roll_onto_feet(ground: Ground, position: FloatArray, load: FloatArray) -> FloatArray:
    """Return the node positions [m] of a rigid structure turned until its load meets the ground between feet.

    position: (n_nodes, 3) [m], a structure whose deepest contact just touches; load: (n_nodes, 3) [N], which
    presses it onto the ground. Where no further contact stops a turn it ends at the last one.
    """
    size = float(np.ptp(position, axis=0).max())
    for _ in range(MAX_ROLLS):
        center = position[ground.node]
        feet = np.flatnonzero(-ground.compute_depth(position) <= TOUCH * size)
        pivot, axis = _find_turn(ground, center, feet, position, load, TOUCH * size)
        if axis is None:
            break
        # The first of the contacts that reaches the ground, unless the moment vanishes before.
        angles = [_find_balance(position - center[pivot], load, axis)]
        for k in range(len(center)):
            rise = float(ground.radius[k] - ground.radius[pivot])
            angle = _find_touch(center[k] - center[pivot], axis, ground.normal, rise, STRAIGHT * size)
            if angle is not None:
                angles.append(angle)
        position = center[pivot] + _turn(position - center[pivot], axis, min(angles))
    return position


def _find_turn(
    ground: Ground,
    center: FloatArray,
    feet: NDArray[np.intp],
    position: FloatArray,
    load: FloatArray,
    reach: float,
) -> tuple[int, FloatArray | None]:
    """Return a foot about which a structure turns, and the axis (3,): None if its load acts between feet."""
    normal, foot = ground.normal, int(feet[0])
    lowest = center - ground.radius[:, None] * normal
    total = load.sum(axis=0)
    moment = np.cross(position - lowest[foot], load).sum(axis=0)
    meets = lowest[foot] + np.cross(normal, moment) / (total @ normal)  # where the load meets the ground
    # The nearest point of the feet's hull: on a foot, or on the line of two.
    distance, nearest, pivot, partner = np.inf, meets, foot, foot
    for i, j in itertools.combinations_with_replacement(feet.tolist(), 2):
        along = lowest[j] - lowest[i]
        span = float(along @ along)
        fraction = float(np.clip((meets - lowest[i]) @ along / span, 0.0, 1.0)) if span > reach**2 else 0.0
        point = lowest[i] + fraction * along
        if (away := float(np.linalg.norm(meets - point))) < distance - reach:
            ends = (i, j) if 0.0 < fraction < 1.0 else ((i, i) if fraction == 0.0 else (j, j))
            distance, nearest, (pivot, partner) = away, point, ends
    outward = meets - nearest
    is_between = distance <= reach or bool(np.any((lowest[feet] - nearest) @ outward > reach * distance))
    if is_between:
        return pivot, None
    axis = np.cross(normal, outward)
    if partner != pivot:  # the line of two centres, which balls of different sizes incline
        line = center[partner] - center[pivot]
        axis = line * np.sign(line @ axis)
    return pivot, axis / np.linalg.norm(axis)


def _turn(arm: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """Return vectors (n, 3) from the pivot turned about the axis by an angle [rad]."""
    along = np.outer(arm @ axis, axis)
    turned: FloatArray = along + (arm - along) * np.cos(angle) + np.cross(axis, arm) * np.sin(angle)
    return turned


def _find_touch(
    arm: FloatArray, axis: FloatArray, normal: FloatArray, height: float, least: float
) -> float | None:
    """Return the angle [rad] at which a point sinks to a height [m] above the pivot; None: never."""
    along = (axis @ arm) * axis
    cosine, sine = float((arm - along) @ normal), float(np.cross(axis, arm) @ normal)
    radius = float(np.hypot(cosine, sine))
    if radius <= least or abs(height - along @ normal) > radius:
        return None
    angle = np.arctan2(sine, cosine) + np.arccos((height - along @ normal) / radius)
    return float(angle % (2 * np.pi))


def _find_balance(arm: FloatArray, load: FloatArray, axis: FloatArray) -> float:
    """Return the angle [rad] at which the moment of the loads about the axis falls to zero."""
    along = np.outer(arm @ axis, axis)
    cosine = float(np.cross(arm - along, load).sum(axis=0) @ axis)
    sine = float(np.cross(np.cross(axis, arm), load).sum(axis=0) @ axis)
    return float((np.arctan2(sine, cosine) + np.pi / 2) % (2 * np.pi))
