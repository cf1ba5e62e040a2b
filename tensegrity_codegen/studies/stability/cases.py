"""The cases: what a scene becomes at its extremes, as run-time values of one compiled model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure import Structure

__all__ = ["Case", "as_springs", "generate_cases"]

FloatArray = NDArray[np.float64]

RTOL = 1e-6
STIFFNESS_RATIOS = tuple(10.0**k for k in range(1, 13))
MASS_RATIOS = (1e3, 1e6, 1e9)
DAMPING_RATIOS = (0.0, 0.1, 1.0, 10.0, 1e3)
TOLERANCES = (1e-14, 1e-9, 1e-3, 1.0, 1e3)
GAPS = (1e-3, 1e-9, 0.0)  # between the first two joined nodes, over their distance
SPEEDS = (1e1, 1e3, 1e6)  # of an impact, mean lengths a second
OFFSET = 1e9  # [m]


@dataclass(frozen=True)
class Case:
    """One extreme. group: what it is about; t_end [s]; rtol: the tolerance asked for.

    structure: the scene changed accordingly, every member a spring by its constant; only positions,
    velocities, rest lengths, spring constants, damping and masses differ from the scene's, so that one
    compiled model serves all cases. expects_refusal: whether only a named error or status is right.
    """

    group: str
    name: str
    structure: Structure
    t_end: float
    rtol: float = RTOL
    expects_refusal: bool = False


def generate_cases(structure: Structure, t_end: float) -> Iterator[Case]:
    """Yield all cases of a structure without rigid bars."""
    structure = as_springs(structure)
    yield Case("as it is", "the scene", structure, t_end)
    yield from _stiffness(structure, t_end)
    yield from _masses(structure, t_end)
    yield from _damping(structure, t_end)
    for rtol in TOLERANCES:
        yield Case("tolerance", f"rtol {rtol:.0e}", structure, t_end, rtol)
    yield from _coincident(structure, t_end)
    slack = structure.with_changes(rest_length=np.where(_cables(structure), 1.5, 1.0) * structure.rest_length)
    yield Case("slack", "every cable slack", slack, t_end)
    yield from _impact(structure, t_end)
    moved = structure.with_changes(node_position=structure.node_position + _along(structure, OFFSET))
    yield Case("offset", f"all of it {OFFSET:.0e} m away", moved, t_end)
    yield from _bad_numbers(structure, t_end)


def as_springs(structure: Structure) -> Structure:
    """Return the structure with spring constants mu = k + EA / l0 in place of axial stiffnesses."""
    return structure.with_changes(
        spring_constant=_springs(structure), axial_stiffness=np.zeros(structure.n_members)
    )


def _cables(structure: Structure) -> NDArray[np.bool_]:
    chosen: NDArray[np.bool_] = ~structure.is_bar
    return chosen


def _along(structure: Structure, size: float) -> FloatArray:
    return np.where(np.isin(np.arange(3), structure.axes), size, 0.0)


def _springs(structure: Structure) -> FloatArray:
    mu: FloatArray = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    return mu


def _stiffness(structure: Structure, t_end: float) -> Iterator[Case]:
    """Bars 10 to 10^12 times as stiff as the median cable, with the tension that they have."""
    mu, bar = _springs(structure), structure.is_bar
    if not bar.any() or bar.all():
        return
    soft, length = float(np.median(mu[~bar])), structure.member_length()
    for ratio in STIFFNESS_RATIOS:
        stiff = soft * ratio
        # l0 such that k (l - l0) is the tension of the scene; a spring of that constant throughout.
        rest = length - structure.static_tension() / stiff
        if (rest[bar] <= 0).any():
            continue
        changed = structure.with_changes(
            spring_constant=np.where(bar, stiff, structure.spring_constant),
            rest_length=np.where(bar, rest, structure.rest_length),
        )
        yield Case("stiffness ratio", f"{ratio:.0e}", changed, t_end)


def _masses(structure: Structure, t_end: float) -> Iterator[Case]:
    heavy = np.flatnonzero(structure.node_mass > 0)
    if not heavy.size:
        return
    for ratio in MASS_RATIOS:
        mass = structure.node_mass.copy()
        mass[heavy[0]] *= ratio
        changed = structure.with_changes(node_mass=mass)
        yield Case("mass ratio", f"one node {ratio:.0e} times as heavy", changed, t_end)


def _damping(structure: Structure, t_end: float) -> Iterator[Case]:
    """Cables damped from not at all to far beyond critical: c = 2 zeta sqrt(mu m), m the mean node mass."""
    mass = max(float(structure.node_mass.mean() + structure.member_mass.sum() / structure.n_nodes), 1e-300)
    for ratio in DAMPING_RATIOS:
        c = np.where(_cables(structure), 2.0 * ratio * np.sqrt(_springs(structure) * mass), 0.0)
        yield Case("damping", f"{ratio:g} of critical", structure.with_changes(damping=c), t_end)


def _coincident(structure: Structure, t_end: float) -> Iterator[Case]:
    i, j = structure.connectivity[int(np.argmax(_cables(structure)))]
    if structure.node_anchored[j].any():
        i, j = j, i
    for gap in GAPS:
        position = structure.node_position.copy()
        position[j] = position[i] + gap * (position[j] - position[i])
        moved = structure.with_changes(node_position=position)
        name = f"two joined nodes at {gap:.0e} of their distance" if gap else "two joined nodes in one place"
        yield Case("coincident nodes", name, moved, t_end, expects_refusal=gap == 0.0)


def _impact(structure: Structure, t_end: float) -> Iterator[Case]:
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    node = int(np.argmax(free.any(axis=1)))
    length = float(structure.member_length().mean())
    for speed in SPEEDS:
        velocity = structure.node_velocity.copy()
        velocity[node, int(np.argmax(free[node]))] += speed * length
        hit = structure.with_changes(node_velocity=velocity)
        yield Case("impact", f"one node at {speed:.0e} lengths a second", hit, t_end)


def _bad_numbers(structure: Structure, t_end: float) -> Iterator[Case]:
    for value, refused in ((np.nan, True), (np.inf, True), (5e-324, False)):
        position = structure.node_position.copy()
        free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
        node = int(np.argmax(free.any(axis=1)))
        position[node, int(np.argmax(free[node]))] = value
        changed = structure.with_changes(node_position=position)
        word = "denormal" if np.isfinite(value) else str(value)
        yield Case("bad numbers", f"a coordinate that is {word}", changed, t_end, expects_refusal=refused)
