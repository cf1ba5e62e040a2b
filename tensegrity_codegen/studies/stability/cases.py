"""The cases: what a scene becomes at its extremes, as run-time values of a few compiled models."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.changes import (
    as_springs,
    move_node,
    push_node,
    put_at_ratio,
    settle_bars,
    with_rigid_bars,
    with_springs,
)
from tensegrity_codegen.studies.stability.neighbours import find_snap

RTOL = 1e-6
STIFFNESS_RATIOS = tuple(10.0**k for k in range(1, 13))
MASS_RATIOS = (1e3, 1e6, 1e9)
DAMPING_RATIOS = (0.0, 0.1, 1.0, 10.0, 1e3)
TOLERANCES = (1e-300, 1e-14, 1e-9, 1e-3, 1.0, 1e3)
STEPS = (1e-300, 1e-6, 1e-4, 1e-2, 1.0, 1e300)  # of the time span
GAPS = (1e-3, 1e-9, 0.0)  # between the first two joined nodes, over their distance
SPEEDS = (1e1, 1e3, 1e6)  # of an impact, mean lengths a second
OFFSET = 1e9  # [m]
SNAPS = ((1e-6, "to where it is about to snap through"), (-1.0, "to the far side of its neighbours"))


# What every integrator meets: group -> names of cases, all if none.
ESSENTIAL: dict[str, tuple[str, ...]] = {
    "as it is": (),
    "stiffness ratio": ("1e+03", "1e+06", "1e+09", "rigid"),
    "slack": (),
    "impact": (),
    "snap-through": (),
}


@dataclass(frozen=True)
class Case:
    """One extreme. group: what it is about; t_end [s]; rtol: the tolerance asked for.

    structure: the scene changed accordingly, every member a spring by its constant or a rigid bar; only
    positions, velocities, rest lengths, spring constants, damping and masses differ between cases, so that
    one compiled model serves those of springs and another those with rigid bars. step: of methods with a
    fixed step, over the time span; these alone run a case that has one. expects_refusal: whether only a named
    error or status is right.
    """

    group: str
    name: str
    structure: Structure
    t_end: float
    rtol: float = RTOL
    step: float | None = None
    expects_refusal: bool = False

    @property
    def is_rigid(self) -> bool:
        """Whether some bars are rigid."""
        return bool(self.structure.is_rigid.any())


def is_essential(case: Case) -> bool:
    """Return whether a case is the scene, or about stiffness, slack cables, an impact or snap-through."""
    return case.group in ESSENTIAL and case.name in (ESSENTIAL[case.group] or (case.name,))


def generate_cases(structure: Structure, t_end: float) -> Iterator[Case]:
    """Yield all cases of a structure; where it has rigid bars they stay so but in the stiffness ratios."""
    structure = settle_bars(as_springs(structure))
    yield Case("as it is", "the scene", structure, t_end)
    yield from _stiffness(structure, t_end)
    yield from _masses(structure, t_end)
    yield from _damping(structure, t_end)
    for rtol in TOLERANCES:
        yield Case("tolerance", f"rtol {rtol:.0e}", structure, t_end, rtol)
    for step in STEPS:
        drift = " (a million)" if step == 1e-6 else ""
        yield Case("step", f"{step:.0e} of the time{drift}", structure, t_end, step=step)
    yield from _coincident(structure, t_end)
    slack = np.where(structure.is_bar, 1.0, 1.5) * structure.rest_length
    yield Case("slack", "every cable slack", structure.with_changes(rest_length=slack), t_end)
    yield from _snap_through(structure, t_end)
    yield from _impact(structure, t_end)
    yield Case("offset", f"all of it {OFFSET:.0e} m away", _far_away(structure), t_end)
    yield from _bad_numbers(structure, t_end)


def _far_away(structure: Structure) -> Structure:
    on_axes = np.isin(np.arange(3), structure.axes)
    return settle_bars(
        structure.with_changes(node_position=structure.node_position + np.where(on_axes, OFFSET, 0.0))
    )


def _stiffness(structure: Structure, t_end: float) -> Iterator[Case]:
    """Bars 10 to 10^12 times as stiff as the median cable, at the tension that they have, and rigid ones."""
    bar = structure.is_bar
    if not bar.any() or bar.all():
        return
    springs = with_springs(structure)
    for ratio in STIFFNESS_RATIOS:
        changed = put_at_ratio(springs, ratio)
        if changed is not None:
            yield Case("stiffness ratio", f"{ratio:.0e}", changed, t_end)
    if not structure.is_rigid.any():
        yield Case("stiffness ratio", "rigid", with_rigid_bars(structure), t_end)


def _masses(structure: Structure, t_end: float) -> Iterator[Case]:
    node = int(np.argmax(structure.node_mass)) if structure.node_mass.any() else _first_free(structure)[0]
    usual = float(structure.node_mass.max()) or float(structure.member_mass.sum() / structure.n_nodes)
    for ratio in MASS_RATIOS:
        mass = structure.node_mass.copy()
        mass[node] = usual * ratio
        changed = structure.with_changes(node_mass=mass)
        yield Case("mass ratio", f"one node {ratio:.0e} times as heavy", changed, t_end)


def _damping(structure: Structure, t_end: float) -> Iterator[Case]:
    """Cables damped from not at all to far beyond critical: c = 2 zeta sqrt(mu m), m the mean node mass."""
    mass = max(float(structure.node_mass.mean() + structure.member_mass.sum() / structure.n_nodes), 1e-300)
    for ratio in DAMPING_RATIOS:
        c = np.where(structure.is_bar, 0.0, 2.0 * ratio * np.sqrt(structure.mu * mass))
        yield Case("damping", f"{ratio:g} of critical", structure.with_changes(damping=c), t_end)


def _coincident(structure: Structure, t_end: float) -> Iterator[Case]:
    cables = np.flatnonzero(~structure.is_bar)
    if not cables.size:
        return
    i, j = (int(node) for node in structure.connectivity[cables[0]])
    if structure.node_anchored[j].any():
        i, j = j, i
    apart = structure.node_position[j] - structure.node_position[i]
    for gap in GAPS:
        moved = move_node(structure, j, structure.node_position[i] + gap * apart)
        name = f"two joined nodes at {gap:.0e} of their distance" if gap else "two joined nodes in one place"
        yield Case("coincident nodes", name, moved, t_end, expects_refusal=gap == 0.0)


def _snap_through(structure: Structure, t_end: float) -> Iterator[Case]:
    """One node moved along the normal of its neighbours; its bars are as long as that makes them."""
    found = find_snap(structure)
    if found is None:
        return
    node, height = found
    for share, name in SNAPS:
        place = structure.node_position[node] + (share - 1.0) * height
        yield Case("snap-through", f"one node {name}", move_node(structure, node, place, refit=True), t_end)


def _impact(structure: Structure, t_end: float) -> Iterator[Case]:
    length, (node, axis) = float(structure.member_length().mean()), _first_free(structure)
    for speed in SPEEDS:
        hit = push_node(structure, node, axis, speed * length)
        yield Case("impact", f"one node at {speed:.0e} lengths a second", hit, t_end)


def _bad_numbers(structure: Structure, t_end: float) -> Iterator[Case]:
    node, axis = _first_free(structure)
    for value, refused in ((np.nan, True), (np.inf, True), (5e-324, False)):
        place = structure.node_position[node].copy()
        place[axis] = value
        word = "denormal" if np.isfinite(value) else str(value)
        changed = move_node(structure, node, place)
        yield Case("bad numbers", f"a coordinate that is {word}", changed, t_end, expects_refusal=refused)


def _first_free(structure: Structure) -> tuple[int, int]:
    """Return node and axis of the first free coordinate."""
    node, axis = structure.coordinate_node_axis[0]
    return int(node), int(axis)
