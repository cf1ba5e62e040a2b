"""Warnings of ranges of actuators that exclude the start, of clearances, and of limits without effect."""

import math

import numpy as np

from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.structure.bar_distance import compute_bar_distance
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_tendons
from tensegrity_codegen.structure.structure import Structure

ROUNDING = 1e-9  # relative excess that is no warning
MOST_PAIRS = 200_000  # of bars whose distances are compared


def warn_of_ranges(subject: Structure | BodySystem) -> list[str]:
    """Return a warning for actuators whose range does not contain the rest lengths of the scene."""
    outside = []
    for item in subject.actuators:
        for e in item.members:
            rest = float(subject.rest_length[e])
            excess = max(item.range[0] - rest, rest - item.range[1])
            if excess > ROUNDING * rest:
                outside.append(f"{item.name} ({subject.member_name[e]}: {rest:.6g} m, by {excess:.3g} m)")
    text = "the range of actuators does not contain the rest length of the scene"
    return [f"{text}: {name_list(outside)}"] if outside else []


def warn_of_limits(subject: Structure | BodySystem) -> list[str]:
    """Return warnings for bars nearer than the clearance, and for members that a limit cannot reach."""
    found = (_warn_of_clearance(subject), _without_section(outline_tendons(subject)))
    return [text for text in found if text]


def _warn_of_clearance(subject: Structure | BodySystem) -> str:
    """Return which bars are nearer to each other than the clearance."""
    clearance = subject.limits.clearance
    if not math.isfinite(clearance) or not 0 < subject.n_bar_pairs <= MOST_PAIRS:
        return ""
    pairs, distance = compute_bar_distance(subject)
    shown = [
        f"{pairs[k][0]} and {pairs[k][1]} ({distance[k]:.4g} m, by {clearance - distance[k]:.3g} m)"
        for k in np.argsort(distance).tolist()
        if distance[k] < clearance - ROUNDING * max(clearance, 1e-3)
    ]
    text = f"bars start nearer to each other than the clearance of {clearance:g} m"
    return f"{text}: {name_list(shown, most=3)}" if shown else ""


def _without_section(structure: Structure) -> str:
    """Return bars or cables without a radius, where others of their kind have a limit of the stress."""
    limited = np.isfinite(structure.limits.yield_stress)
    bare = structure.radius == 0
    for kind in (structure.is_bar, ~structure.is_bar):
        if (limited & kind).any() and (bare & kind).any():
            names = [structure.member_name[e] for e in np.flatnonzero(bare & kind)]
            return f"no yield stress applies to members without a radius: {name_list(names)}"
    return ""
