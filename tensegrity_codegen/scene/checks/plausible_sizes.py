"""Sizes that look like a wrong unit, and forces at the start that look like a slip."""

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.pieces import find_pieces
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import name_list
from tensegrity_codegen.system.summaries import describe_count

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
    """Return a warning if half of the members are longer than LONG."""
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
    position = structure.node_position
    distance = np.linalg.norm(position - compute_median(position), axis=1)
    usual = float(compute_median(distance))
    if usual == 0:
        usual = float(distance[distance > 0].min(initial=np.inf))
    distant = np.flatnonzero(distance > MAX_DISTANCE_RATIO * usual)
    if not distant.size:
        return []
    node = int(distant[0])
    count_text = f" (and {distant.size - 1} more)" if distant.size > 1 else ""
    return [
        f"node {structure.node_name[node]}{count_text} is {distance[node]:.4g} m from the middle of the "
        f"structure, {distance[node] / usual:,.0f} times as far as half of the nodes: is its "
        "position, or its unit, wrong?"
    ]


def warn_of_radii(structure: Structure) -> list[str]:
    """Return a warning for members whose radius is more than MAX_RADIUS_RATIO of their length."""
    length = structure.member_length()
    thick = np.flatnonzero(structure.radius > MAX_RADIUS_RATIO * length)
    if not thick.size:
        return []
    member = int(thick[0])
    return [
        f"{_count(thick, 'member')} nearly as thick as long: {structure.member_name[member]} has a radius of "
        f"{structure.radius[member]:.4g} m and a length of {length[member]:.4g} m: a radius in mm?"
    ]


def warn_of_densities(structure: Structure) -> list[str]:
    """Return a warning for members whose mass over volume no solid has."""
    with np.errstate(divide="ignore", invalid="ignore"):
        density = structure.member_mass / (np.pi * structure.radius**2 * structure.member_length())
    is_known = np.asarray(structure.radius > 0) & (structure.member_mass > 0)

    def solids(unit: float) -> NDArray[np.int64]:
        scaled = density / unit
        return np.flatnonzero(is_known & (scaled >= 1000 * LIGHT[0]) & (scaled <= 1000 * LIGHT[1]))

    small = () if warn_of_lengths(structure) else MILLIMETRES
    heavy = np.flatnonzero(is_known & (density > SUSPICIOUS_DENSITY) & np.isfinite(density))
    sentences = []
    for rows, question in (
        (solids(1e-3), "a density in g/cm3? Write it in kg/m3: 1,000 times as much"),
        *((solids(unit), f"a density in {name}, or lengths in mm? Use kg/m3 and m") for name, unit in small),
        (heavy, "more than any solid: a mass in g, a radius in cm, or a density in g/m3?"),
    ):
        if rows.size:
            member = int(rows[0])
            kinds = {"bar" if is_bar else "cable" for is_bar in structure.is_bar[rows]}
            kind = kinds.pop() if len(kinds) == 1 else "member"
            sentences.append(
                f"{_count(rows, kind)} of mass over volume (pi radius^2 length) {density[member]:.4g} "
                f"kg/m3: {structure.member_name[member]}; {question}"
            )
    return sentences


def _count(which: NDArray[np.int64], word: str) -> str:
    """Return "1 bar is" or "7 bars are"."""
    return f"1 {word} is" if which.size == 1 else f"{which.size} {word}s are"


def compute_median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median over the first axis; np.median imports numpy.ma first, which takes 10 ms."""
    if len(values) == 0:
        return np.full(values.shape[1:], np.nan)
    ordered, end = np.sort(values, axis=0), len(values) - 1
    return np.asarray(0.5 * (ordered[end // 2] + ordered[(end + 1) // 2]))


EARTH = 9.81  # [m/s2]
ROUNDING = 64 * float(np.finfo(float).eps)  # of lengths, over them
MAX_GRAVITY = 200.0  # [m/s2]
MIN_BAR_TENSION_RATIO = 1e-3  # tension of a bar over the largest of a cable
BALANCE_TOLERANCE = 1e-9  # sum of loads over the sum of their sizes
IMBALANCE_RATIO = 1.5  # unbalanced force of a node over all weights and loads; a fall has 1
FREE_STIFFNESS_RATIO = 1e-9  # part of a node's largest stiffness below which a direction counts as free


def warn_of_forces(structure: Structure) -> list[str]:
    """Return a sentence for each kind of force that looks wrong, with the first culprit's name."""
    if not structure.n_members:
        return []
    shown = hide_bodies(structure)
    return [
        *warn_of_upward_gravity(structure.gravity, structure.axes),
        *warn_of_strong_gravity(structure.gravity),
        *warn_of_falling_pieces(structure),
        *warn_of_unstressed_bars(shown),
        *warn_of_jump(structure),
    ]


def warn_of_upward_gravity(gravity: FloatArray, axes: tuple[int, ...]) -> list[str]:
    """Return a warning if gravity points mostly along +z, or along +y."""
    axis = int(np.argmax(np.abs(gravity)))
    if axis == 0 or not gravity[axis] > 0:
        return []
    letter = "xyz"[axis]
    down = [0.0, 0.0, 0.0]
    down[axis] = -float(gravity[axis])
    shown = [f"{value:g}" for value in down]
    return [
        f"gravity points upward, {gravity[axis]:g} m/s2 along +{letter}: if {letter} is up, write "
        f"gravity = [{', '.join(shown[k] for k in axes)}]"
    ]


def warn_of_strong_gravity(gravity: FloatArray) -> list[str]:
    """Return a warning if gravity is more than MAX_GRAVITY: that of the Earth in mm/s2 or cm/s2."""
    size = float(np.linalg.norm(gravity))
    if not size > MAX_GRAVITY:
        return []
    return [
        f"gravity of {size:.4g} m/s2 is {size / EARTH:,.0f} times that of the Earth: a unit other than "
        "the metre? Check gravity, positions, stiffness and mass"
    ]


def warn_of_falling_pieces(structure: Structure) -> list[str]:
    """Return a warning for pieces that gravity or loads push along an axis on which nothing holds them."""
    _, piece = find_pieces(structure.n_nodes, *structure.joined.T)
    count = int(piece.max()) + 1
    sentences = []
    for axis in structure.axes:
        pull, held = float(structure.gravity[axis]), structure.node_anchored[:, axis]
        rests = _find_resting(structure, pull)
        load, size = np.zeros(count), np.zeros(count)
        np.add.at(load, piece, structure.node_load[:, axis])
        np.add.at(size, piece, np.abs(structure.node_load[:, axis]))
        pushed = np.full(count, pull != 0) | (np.abs(load) > BALANCE_TOLERANCE * size)
        pushed[piece[held | rests]] = False
        loose = np.flatnonzero(pushed)
        if not loose.size:
            continue
        start_nodes = [structure.node_label[int(np.argmax(piece == number))] for number in loose[:6]]
        names = name_list(start_nodes + [""] * (len(loose) - len(start_nodes)))
        is_all = len(loose) == count
        pieces = describe_count(len(loose), "piece")
        subject = "no node is" if is_all else f"no node of {pieces} (beginning at {names}) is"
        cause, effect = (
            f"gravity of {abs(pull):g} m/s2 acts",
            f"falls, {abs(pull) / 2:.3g} m in the first second",
        )
        if pull == 0:
            cause, effect = f"loads add up to {load[loose[0]]:.4g} N", "slides"
        sentences.append(
            f"{cause} along {'xyz'[axis]} and {subject} anchored along it: everything "
            f"{'' if is_all else 'there '}{effect}; anchor nodes, or omit "
            f"{'gravity' if pull else 'the loads'}"
        )
    return sentences


def _find_resting(structure: Structure, pull: float) -> BoolArray:
    """Return which nodes the ground keeps from falling, friction from sliding without a pull, (n_nodes,)."""
    rests, ground = np.zeros(structure.n_nodes, dtype=np.bool_), structure.ground
    if ground is not None and structure.gravity @ ground.normal < 0 and (pull or ground.friction):
        rests[ground.node] = True
    return rests


def warn_of_unstressed_bars(structure: Structure) -> list[str]:
    """Return a warning if free nodes' cables are tight and no bar that could give carries anything."""
    tension = structure.static_tension()
    free = np.asarray(~structure.node_anchored[:, list(structure.axes)].all(axis=1))
    moving = free[structure.connectivity].any(axis=1)
    rounding = ROUNDING * structure.mu * structure.member_length()
    tight = moving & ~structure.is_bar & (tension > rounding)
    bars = moving & structure.is_bar
    largest = float(tension[tight].max(initial=0.0))
    if not tight.any() or not bars.any() or structure.is_rigid[bars].any():
        return []
    if np.abs(tension[bars]).max() > MIN_BAR_TENSION_RATIO * largest:
        return []
    cable = structure.member_name[int(np.argmax(np.where(tight, tension, 0.0)))]
    bar = structure.member_name[int(np.flatnonzero(bars)[0])]
    return [
        f"cables start with up to {largest:.4g} N ({cable}) and no bar with any force (first: {bar}): the "
        "nodes are out of balance and jump when a motion starts; settle first "
        "(start from the equilibrium), or give the bars a prestress below 0"
    ]


def warn_of_imbalance(structure: Structure) -> list[str]:
    """Return warnings, for `check` only, of nodes that nothing holds or that start far from balance."""
    if not structure.n_members or structure.ground is not None:
        return []
    force = np.linalg.norm(find_unbalanced(structure), axis=1)
    total = float(structure.lumped_mass.sum() * np.linalg.norm(structure.gravity))
    total += float(np.linalg.norm(structure.node_load, axis=1).sum())
    tension, sentences = structure.static_tension(), []
    ends = np.bincount(structure.strands.ends.ravel(), minlength=structure.n_nodes)
    bare = (
        (ends == 1)
        & ~structure.is_attached
        & (structure.lumped_mass == 0.0)
        & ~structure.node_load.any(axis=1)
    )
    for node in np.flatnonzero(bare & (force > BALANCE_TOLERANCE * np.abs(tension).max())):
        member = int(np.flatnonzero((structure.connectivity == node).any(axis=1))[0])
        sentences.append(
            f"node {structure.node_name[node]} is held by member {structure.member_name[member]} alone, that "
            f"starts with {tension[member]:.4g} N: anchor it (anchored = true), or join it to another member"
        )
    force[bare] = 0.0
    worst = int(force.argmax())
    if total > 0.0 and force[worst] > IMBALANCE_RATIO * total:
        joins = (structure.connectivity == worst).any(axis=1)
        pulls = [structure.member_name[e] for e in np.flatnonzero(joins & structure.is_bar & (tension > 0))]
        at = "node" if structure.node_label[worst] == structure.node_name[worst] else "body"
        cause = f"; bars that pull there: {name_list(pulls)} (a bar that pushes has a prestress below 0)"
        sentences.append(
            f"the start is out of balance by {force[worst]:.4g} N at {at} {structure.node_label[worst]}, "
            f"{force[worst] / total:.3g} times all weights and loads{cause if pulls else ''}; `equilibrium` "
            "finds the shape in balance"
        )
    return sentences


def warn_of_jump(structure: Structure) -> list[str]:
    """Return a warning if a node's unbalanced force would move it, alone, by more than the structure.

    The node moves by K^-1 f with all other nodes held: f the unbalanced force without what rigid bars can
    take, K the stiffness of its members, 3 by 3. Directions without stiffness do not count: a pendulum may
    swing.
    """
    size = float(np.ptp(structure.node_position, axis=0).max())
    with np.errstate(all="ignore"):
        force, stiffness = find_unbalanced(structure), _find_stiffness(structure)
        if not (np.isfinite(force).all() and np.isfinite(stiffness).all()):
            return []
        value, vector = np.linalg.eigh(stiffness)
        along = np.einsum("nij,ni->nj", vector, force)
        holds = value > FREE_STIFFNESS_RATIO * value[:, -1:]
        step = np.where(holds & (value > 0), along / np.where(value > 0, value, 1.0), 0.0)
    way = np.linalg.norm(step, axis=1)
    worst = int(np.argmax(way))
    if not way[worst] > size:
        return []
    pull = float(np.linalg.norm(force[worst]))
    return [
        f"node {structure.node_name[worst]} starts with an unbalanced force of {pull:.4g} N, which its "
        f"members would balance only {way[worst]:.4g} m away; the structure is {size:.4g} m large: check the "
        "units of stiffness, mass, load and rest length"
    ]


def find_unbalanced(structure: Structure) -> FloatArray:
    """Return the force that nothing balances at each node (n_nodes, 3) [N], zero if it is held.

    That on a body is at its first corner.
    """
    unit, _ = structure.strands.directions(structure.node_position)
    strands = structure.strands
    pull = strands.spread(structure.static_tension())[:, None] * unit
    mass = structure.node_mass.copy()
    force = structure.node_load.copy()
    for side, sign in ((0, -1.0), (1, 1.0)):
        np.add.at(mass, structure.connectivity[:, side], structure.member_mass / 2)
        np.add.at(force, strands.ends[:, side], sign * pull)
    force += mass[:, None] * structure.gravity
    for body in structure.body_places:
        body.gather(force)
    free = np.zeros(force.shape, dtype=bool)
    free[:, list(structure.axes)] = structure.has_coordinate[:, list(structure.axes)]
    force[~free] = 0.0
    rigid = np.flatnonzero(structure.is_rigid)
    if not rigid.size:
        return force
    rows = 3 * structure.connectivity[rigid][:, :, None] + np.arange(3)  # (n_rigid, 2, 3)
    along = unit[np.isin(strands.member, rigid)]
    data = np.stack([along, -along], axis=1) * free.ravel()[rows]
    column = np.broadcast_to(np.arange(len(rigid))[:, None, None], rows.shape)
    matrix = scipy.sparse.csr_array(
        (data.ravel(), (rows.ravel(), column.ravel())), shape=(force.size, len(rigid))
    )
    bar_force = scipy.sparse.linalg.lsmr(matrix, force.ravel(), atol=1e-9, btol=1e-9)[0]
    unbalanced = np.asarray(force.ravel() - matrix @ bar_force).reshape(force.shape)
    for body in structure.body_places:
        unbalanced[body.corner[0]] = unbalanced[list(body.corner)].sum(axis=0)
        unbalanced[list(body.corner[1:])] = 0.0
    return unbalanced


def _find_stiffness(structure: Structure) -> FloatArray:
    """Return each node's stiffness with the others held, (n_nodes, 3, 3) [N/m]: of bars and tight cables."""
    unit, length = structure.strands.directions(structure.node_position)
    tension, strands = structure.static_tension(), structure.strands
    slack = structure.tension_only & (structure.member_length() <= structure.rest_length)
    mu, tension = (strands.spread(values) for values in (np.where(slack, 0.0, structure.mu), tension))
    outer = unit[:, :, None] * unit[:, None, :]
    across = np.maximum(tension, 0.0) / length
    member = mu[:, None, None] * outer + across[:, None, None] * (np.eye(3) - outer)
    total = np.zeros((structure.n_nodes, 3, 3))
    for side in (0, 1):
        np.add.at(total, strands.ends[:, side], member)
    return total
