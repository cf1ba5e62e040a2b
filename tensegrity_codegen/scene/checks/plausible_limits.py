"""Warnings about actuators and limits: a start outside of them, and limits that do not reach every member."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.structure.bar_distance import compute_bar_distance
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_tendons
from tensegrity_codegen.structure.structure import Structure

__all__ = ["warn_of_limits", "warn_of_ranges"]

ROUNDING = 1e-9  # relative excess that is no warning
MOST_PAIRS = 200_000  # of bars whose distances are compared

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


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
    """Return warnings for members that are outside their limits at the stated positions, at rest.

    Tensions follow from the lengths there, so that those of rigid bars are not known and not compared.
    """
    limits = subject.limits
    if not limits.is_stated:
        return []
    structure = outline_tendons(subject)
    tension, known = structure.static_tension(), ~structure.is_rigid
    with np.errstate(divide="ignore", invalid="ignore"):
        stress = np.abs(tension) / structure.section_area
        euler = math.pi**2 * structure.flexural_rigidity
        ratio = np.where(tension < 0, euler / structure.member_length() ** 2 / -tension, math.inf)
    compared = (
        ("below their least tension", tension, limits.least_tension, "N"),
        ("above their largest tension", -tension, -limits.most_tension, "N"),
        ("above their yield stress", -stress, -limits.yield_stress, "Pa"),
        ("below their safety factor against buckling", ratio, limits.buckling, ""),
    )
    found = [
        _sentence(structure, problem, value, least, unit, known) for problem, value, least, unit in compared
    ]
    return [text for text in (*found, _warn_of_clearance(subject), _without_section(structure)) if text]


def _sentence(
    structure: Structure, problem: str, value: FloatArray, least: FloatArray, unit: str, known: BoolArray
) -> str:
    """Return which members have a value below the least one, with both and the difference."""
    stated = np.isfinite(least) & np.isfinite(value) & (least != 0)
    rows = np.flatnonzero(known & (stated & (value < least - ROUNDING * np.abs(least)))).tolist()
    if not rows:
        return ""
    rows.sort(key=lambda e: value[e] - least[e])
    end = f" {unit}" if unit else ""
    shown = [
        f"{structure.member_name[e]} ({abs(value[e]):.4g}{end} against {abs(least[e]):.4g}{end}, "
        f"by {least[e] - value[e]:.3g}{end})"
        for e in rows
    ]
    return f"members start {problem}: {name_list(shown, most=3)}"


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
