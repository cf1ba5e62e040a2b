"""Sizes that look like a wrong unit: lengths, radii, densities, and one node far from all others."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure

SUSPICIOUS_LENGTH = 50.0  # [m], median member length from which on millimetres are suspected
MAX_DISTANCE_RATIO = 100.0  # distance of a node from the middle over the median of all nodes
MAX_RADIUS_RATIO = 0.25  # radius over length of a member
# Mass over volume [kg/m3]: values of solids in g/cm3, and more than any solid has.
LIGHT = (0.7, 25.0)
SUSPICIOUS_DENSITY = 25_000.0
MILLIMETRES = (("kg/mm3", 1e-9), ("t/mm3", 1e-12))  # their values for 1 kg/m3


def warn_of_sizes(structure: Structure) -> list[str]:
    """Return a sentence for each kind of size that looks wrong, with the first culprit's name."""
    if not structure.n_members:
        return []
    return [
        *warn_of_lengths(structure),
        *warn_of_far_nodes(structure),
        *warn_of_radii(structure),
        *warn_of_densities(structure),
    ]


def warn_of_lengths(structure: Structure) -> list[str]:
    """Return a warning where half of the members are longer than LONG."""
    length = structure.member_length()
    middle = float(compute_median(length))
    if middle < SUSPICIOUS_LENGTH or structure.is_large:
        return []
    longest = int(np.argmax(length))
    return [
        f"half of the members are longer than {middle:.4g} m (the longest, {structure.member_name[longest]}: "
        f"{length[longest]:.4g} m): lengths in mm? A scene is in metres: divide positions and rest lengths "
        "by 1,000, or import with --scale 0.001; large = true in the scene says that they are meant"
    ]


def warn_of_far_nodes(structure: Structure) -> list[str]:
    """Return a warning for nodes much farther from the middle than half of all nodes are."""
    if structure.n_nodes < 3:
        return []
    place = structure.node_position
    distance = np.linalg.norm(place - compute_median(place), axis=1)
    usual = float(compute_median(distance))
    if usual == 0:
        usual = float(distance[distance > 0].min(initial=np.inf))
    far = np.flatnonzero(distance > MAX_DISTANCE_RATIO * usual)
    if not far.size:
        return []
    first = int(far[0])
    others = f" (and {far.size - 1} more)" if far.size > 1 else ""
    return [
        f"node {structure.node_name[first]}{others} is {distance[first]:.4g} m from the middle of the "
        f"structure, {distance[first] / usual:,.0f} times as far as half of the nodes: is its "
        "position, or its unit, wrong?"
    ]


def warn_of_radii(structure: Structure) -> list[str]:
    """Return a warning for members whose radius is more than MAX_RADIUS_RATIO of their length."""
    length = structure.member_length()
    thick = np.flatnonzero(structure.radius > MAX_RADIUS_RATIO * length)
    if not thick.size:
        return []
    first = int(thick[0])
    return [
        f"{_count(thick, 'member')} nearly as thick as long: {structure.member_name[first]} has a radius of "
        f"{structure.radius[first]:.4g} m and a length of {length[first]:.4g} m: a radius in mm?"
    ]


def warn_of_densities(structure: Structure) -> list[str]:
    """Return a warning for bars whose mass over volume no solid has."""
    with np.errstate(divide="ignore", invalid="ignore"):
        density = structure.member_mass / (np.pi * structure.radius**2 * structure.member_length())
    known = np.asarray(structure.radius > 0) & (structure.member_mass > 0)

    def solids(unit: float) -> NDArray[np.int64]:
        scaled = density / unit
        return np.flatnonzero(known & (scaled >= 1000 * LIGHT[0]) & (scaled <= 1000 * LIGHT[1]))

    small = () if warn_of_lengths(structure) else MILLIMETRES
    heavy = np.flatnonzero(known & (density > SUSPICIOUS_DENSITY) & np.isfinite(density))
    found = []
    for which, question in (
        (solids(1e-3), "a density in g/cm3? Write it in kg/m3: 1,000 times as much"),
        *((solids(unit), f"a density in {name}, or lengths in mm? Use kg/m3 and m") for name, unit in small),
        (heavy, "more than any solid: a mass in g, a radius in cm, or a density in g/m3?"),
    ):
        if which.size:
            first = int(which[0])
            found.append(
                f"{_count(which, 'bar')} of mass over volume (pi radius^2 length) {density[first]:.4g} "
                f"kg/m3: {structure.member_name[first]}; {question}"
            )
    return found


def _count(which: NDArray[np.int64], word: str) -> str:
    """Return "1 bar is" or "7 bars are"."""
    return f"1 {word} is" if which.size == 1 else f"{which.size} {word}s are"


def compute_median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median over the first axis; np.median imports numpy.ma first, which takes 10 ms."""
    if len(values) == 0:
        return np.full(values.shape[1:], np.nan)
    ordered, last = np.sort(values, axis=0), len(values) - 1
    return np.asarray(0.5 * (ordered[last // 2] + ordered[(last + 1) // 2]))
