"""Limits that a configuration exceeds, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.runtime.analysis.configuration import Configuration

__all__ = ["describe_limits"]

# Limits of members: what is compared, its unit, and the word of the limit.
WORDS = {
    "least_tension": ("tension", " N", "at least"),
    "most_tension": ("tension", " N", "at most"),
    "yield_stress": ("stress", " Pa", "at most"),
    "buckling": ("safety factor against buckling", "", "at least"),
}


def describe_limits(found: Analysis, at: Configuration) -> list[str]:
    """Return a sentence for each kind of limit that the present state exceeds, and for bars that buckle."""
    return [*_of_members(found), *_of_buckling(found, at), *_of_structure(found, at)]


def _of_members(found: Analysis) -> Iterator[str]:
    for limit, (word, unit, bound) in WORDS.items():
        rows = [item for item in found.members.exceeded if item.limit == limit]
        if rows:
            others = f"; {len(rows) - 1} more exceed this limit" if len(rows) > 1 else ""
            yield (
                f"{rows[0].member} has a {word} of {rows[0].value:.6g}{unit}, allowed is {bound} "
                f"{rows[0].allowed:.6g}{unit}{others}"
            )


def _of_buckling(found: Analysis, at: Configuration) -> Iterator[str]:
    """Members that buckle without having a limit."""
    factor, limit = found.members.buckling_factor, found.members.allowed["buckling"]
    buckled = np.flatnonzero((factor < 1) & (limit == 0))
    if len(buckled):
        e = int(buckled[np.argmin(factor[buckled])])
        yield (
            f"{at.manifest.member_name[e]} buckles: its compression is {-found.member_tension[e]:.6g} N, "
            f"Euler's load {found.members.buckling_load[e]:.6g} N"
        )


def _of_structure(found: Analysis, at: Configuration) -> Iterator[str]:
    """Clearance between bars, and the least stiffness."""
    limits, distance = at.structure.limits, found.bar_distance
    if distance is not None and distance.min(initial=math.inf) < limits.clearance:
        pair = int(distance.argmin())
        first, second = at.manifest.bar_pair[pair]
        yield (
            f"the bars {first} and {second} are {distance[pair]:.6g} m apart, allowed is at least "
            f"{limits.clearance:.6g} m"
        )
    if found.smallest_eigenvalue < limits.least_stiffness:
        yield (
            f"the smallest eigenvalue of the stiffness is {found.smallest_eigenvalue:.6g} N/m, allowed is at "
            f"least {limits.least_stiffness:.6g} N/m"
        )
