"""The cases of a study: a scene at its extremes, as run-time values of a few compiled models."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.work_precision.measure import without_stretch
from tensegrity_codegen.system.arrays import FloatArray

USUAL_RATIO = 1e3  # stiffness of bars that had none, over that of the median cable


def as_springs(structure: Structure) -> Structure:
    """Return the structure with spring constants in place of axial stiffnesses; rigid bars stay rigid."""
    return structure.with_changes(spring_constant=structure.mu, axial_stiffness=np.zeros(structure.n_members))


def with_springs(structure: Structure) -> Structure:
    """Return the structure with springs for all members; rigid bars get 1,000 times the median cable's."""
    mu, rigid = structure.mu, structure.is_rigid
    soft = float(np.median(mu[~structure.is_bar])) if (~structure.is_bar).any() else 1.0
    return structure.with_changes(
        spring_constant=np.where(rigid, USUAL_RATIO * soft, mu), axial_stiffness=np.zeros(structure.n_members)
    )


def stiffen_bars(structure: Structure, stiff: float) -> Structure:
    """Return the structure of springs, its bars with one spring constant [N/m] at their tensions.

    l0 = l - t / mu, which is not positive where a bar is too soft for its tension.
    """
    bar = structure.is_bar
    rest_length = structure.member_length() - structure.static_tension() / stiff
    return structure.with_changes(
        spring_constant=np.where(bar, stiff, structure.spring_constant),
        rest_length=np.where(bar, rest_length, structure.rest_length),
    )


def put_at_ratio(structure: Structure, ratio: float) -> Structure | None:
    """Return the structure of springs with bars `ratio` times as stiff as the median cable, if it exists."""
    bar = structure.is_bar
    changed = stiffen_bars(structure, ratio * float(np.median(structure.spring_constant[~bar])))
    return None if (changed.rest_length[bar] <= 0).any() else changed


def with_rigid_bars(structure: Structure) -> Structure:
    """Return the structure with all bars rigid, as long as they are, and without damping."""
    bar = structure.is_bar
    return settle_bars(
        structure.with_changes(
            **{
                name: np.where(bar, 0.0, getattr(structure, name))
                for name in ("spring_constant", "axial_stiffness", "damping")
            }
        )
    )


def settle_bars(structure: Structure) -> Structure:
    """Return the structure with rigid bars as long as their nodes are apart, at speeds that stretch none."""
    rigid = np.flatnonzero(structure.is_rigid)
    if not rigid.size or not np.isfinite(structure.node_position).all():
        return structure
    rest_length = structure.rest_length.copy()
    rest_length[rigid] = structure.member_length()[rigid]
    velocity = without_stretch(structure, structure.node_velocity, rigid)
    return structure.with_changes(rest_length=rest_length, node_velocity=velocity)


def move_node(structure: Structure, node: int, place: FloatArray, *, refit: bool = False) -> Structure:
    """Return the structure with one node elsewhere; refit: its bars keep their tension, not their length."""
    position = structure.node_position.copy()
    position[node] = place
    moved = structure.with_changes(node_position=position)
    if refit:
        stretch = structure.member_length() - structure.rest_length
        rest_length = np.where(structure.is_bar, moved.member_length() - stretch, moved.rest_length)
        moved = moved.with_changes(rest_length=rest_length)
    return settle_bars(moved)


MIN_HEIGHT = 1e-2  # off its neighbours, over the mean member length


def find_snap(structure: Structure) -> tuple[int, FloatArray] | None:
    """Return a free node and its height (3,) [m] over the plane of its neighbours, None if all lie in it.

    The plane, in a planar scene the line, is that of least squares; the node is the first off it.
    """
    axes = list(structure.axes)
    min_height = MIN_HEIGHT * float(structure.member_length().mean())
    for node in np.flatnonzero(~structure.node_anchored[:, axes].any(axis=1)):
        touching = structure.connectivity[(structure.connectivity == node).any(axis=1)]
        neighbours = structure.node_position[np.setdiff1d(touching, node)][:, axes]
        if not len(neighbours):
            continue
        centre = neighbours.mean(axis=0)
        _, _, directions = np.linalg.svd(neighbours - centre)
        normal = directions[-1]
        height = np.zeros(3)
        height[axes] = normal * (normal @ (structure.node_position[node, axes] - centre))
        if np.linalg.norm(height) > min_height:
            return int(node), height
    return None


RTOL = 1e-6
STIFFNESS_RATIOS = tuple(10.0**k for k in range(1, 13))
MASS_RATIOS = (1e3, 1e6, 1e9)
DAMPING_RATIOS = (0.0, 0.1, 1.0, 10.0, 1e3)
TOLERANCES = (1e-300, 1e-14, 1e-9, 1e-3, 1.0, 1e3)
STEPS = (1e-300, 1e-6, 1e-4, 1e-2, 1.0, 1e300)  # of the time span
GAPS = (1e-3, 1e-9, 0.0)  # between the first two joined nodes, over their distance
TWO_RATIOS = (1e3, 1e6)  # of every other bar
GROUND_STIFFNESSES = (1e-2, 1e2, 1e4)  # over that of the scene
FRICTIONS = (0.0, 0.05, 1.0)
SPEEDS = (1e1, 1e3, 1e6)  # of an impact, mean lengths a second
OFFSET = 1e9  # [m]
SNAPS = ((1e-6, "to where it is about to snap through"), (-1.0, "to the far side of its neighbours"))


# Cases that every integrator meets: group -> names of cases, all if none.
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
    yield from _ground(structure, t_end)
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
    stiff, soft = (put_at_ratio(springs, ratio) for ratio in TWO_RATIOS)
    if stiff is not None and soft is not None and np.count_nonzero(bar) > 1:
        second = np.cumsum(bar) % 2 == 0
        values = {
            name: np.where(second, getattr(soft, name), getattr(stiff, name))
            for name in ("spring_constant", "rest_length")
        }
        yield Case("two stiff groups", "1e+03 and 1e+06 in turns", stiff.with_changes(**values), t_end)
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
    separation = structure.node_position[j] - structure.node_position[i]
    for gap in GAPS:
        moved = move_node(structure, j, structure.node_position[i] + gap * separation)
        name = f"two joined nodes at {gap:.0e} of their distance" if gap else "two joined nodes in one place"
        refused = gap == 0.0 and not structure.tension_only[cables[0]]
        yield Case("coincident nodes", name, moved, t_end, expects_refusal=refused)


def _snap_through(structure: Structure, t_end: float) -> Iterator[Case]:
    """One node moved along the normal of its neighbours; its bars are as long as that makes them."""
    snap = find_snap(structure)
    if snap is None:
        return
    node, height = snap
    for fraction, name in SNAPS:
        position = structure.node_position[node] + (fraction - 1.0) * height
        yield Case(
            "snap-through", f"one node {name}", move_node(structure, node, position, refit=True), t_end
        )


def _impact(structure: Structure, t_end: float) -> Iterator[Case]:
    length, (node, axis) = float(structure.member_length().mean()), _first_free(structure)
    for speed in SPEEDS:
        velocity = structure.node_velocity.copy()
        velocity[node, axis] += speed * length
        hit = settle_bars(structure.with_changes(node_velocity=velocity))
        yield Case("impact", f"one node at {speed:.0e} lengths a second", hit, t_end)


def _ground(structure: Structure, t_end: float) -> Iterator[Case]:
    """Softer and stiffer ground, less and more friction, a node that touches it and moves along it."""
    ground = structure.ground
    if ground is None:
        return
    for ratio in GROUND_STIFFNESSES:
        stiffness = {key: ratio * getattr(ground, key) for key in ("stiffness", "stick_stiffness")}
        changed = structure.with_changes(ground=replace(ground, **stiffness))
        yield Case("ground", f"{ratio:g} times as stiff", changed, t_end)
    for friction in FRICTIONS:
        changed = structure.with_changes(ground=replace(ground, friction=friction, static_friction=None))
        yield Case("ground", f"friction {friction:g}", changed, t_end)
    gap = float(np.min(structure.node_position[ground.node] @ ground.normal - ground.radius)) - ground.offset
    along = np.linalg.svd(ground.normal[None])[2][1] * structure.member_length().mean()
    position = structure.node_position - gap * ground.normal
    speed = np.where(structure.node_anchored, 0.0, along)
    grazing = settle_bars(structure.with_changes(node_position=position, node_velocity=speed))
    yield Case("ground", "a node grazes it at one length a second", grazing, t_end)


def _bad_numbers(structure: Structure, t_end: float) -> Iterator[Case]:
    node, axis = _first_free(structure)
    for value, refused in ((np.nan, True), (np.inf, True), (5e-324, False)):
        position = structure.node_position[node].copy()
        position[axis] = value
        name = "denormal" if np.isfinite(value) else str(value)
        changed = move_node(structure, node, position)
        yield Case("bad numbers", f"a coordinate that is {name}", changed, t_end, expects_refusal=refused)


def _first_free(structure: Structure) -> tuple[int, int]:
    """Return node and axis of the first free coordinate."""
    node, axis = structure.coordinate_node_axis[0]
    return int(node), int(axis)
