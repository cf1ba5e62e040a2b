"""A rigid structure that touches the ground turns about its feet until its load acts between them.

About one foot, then about the line of two, as a body falls slowly. A point at v from the pivot turns by an
angle s about the axis a to v_a + (v - v_a) cos s + (a x v) sin s, v_a = (a . v) a (Rodrigues), so that the
angle at which it reaches a height, or at which the moment of the loads vanishes, is an arc cosine.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.contacts.judge_stand import find_pressure_centre
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
        # Up to the first contact that reaches the ground, unless the moment vanishes before.
        arm, rise = center - center[pivot], ground.radius - ground.radius[pivot]
        touch = _find_touch(arm, axis, ground.normal, rise, STRAIGHT * size)
        angle = min(touch, _find_balance(position - center[pivot], load, axis))
        along, across, turned = _split(position - center[pivot], axis)
        position = center[pivot] + along + across * np.cos(angle) + turned * np.sin(angle)
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
    meets = find_pressure_centre(normal, lowest[foot], position, load)
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


def _split(arm: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parts of vectors (n, 3) along an axis and across it, the latter turned by 90 degrees too."""
    along = np.outer(arm @ axis, axis)
    return along, arm - along, np.cross(axis, arm)


def _find_touch(
    arm: FloatArray, axis: FloatArray, normal: FloatArray, height: FloatArray, least: float
) -> float:
    """Return the angle [rad] at which the first of points sinks to its height [m] above the pivot, or inf."""
    level, cosine, sine = (vector @ normal for vector in _split(arm, axis))
    radius = np.hypot(cosine, sine)
    reaches = (radius > least) & (np.abs(height - level) <= radius)
    fall = np.arccos((height - level)[reaches] / radius[reaches])
    angle = np.arctan2(sine[reaches], cosine[reaches]) + fall
    return float((angle % (2 * np.pi)).min(initial=np.inf))


def _find_balance(arm: FloatArray, load: FloatArray, axis: FloatArray) -> float:
    """Return the angle [rad] at which the moment of the loads about the axis falls to zero."""
    _, across, turned = _split(arm, axis)
    cosine, sine = (float(np.cross(vector, load).sum(axis=0) @ axis) for vector in (across, turned))
    return float((np.arctan2(sine, cosine) + np.pi / 2) % (2 * np.pi))
