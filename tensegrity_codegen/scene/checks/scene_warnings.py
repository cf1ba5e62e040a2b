"""Warnings of allowed values that look like a mistake, in short sentences."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.checks.check_members import find_fully_anchored
from tensegrity_codegen.scene.checks.plausible_sizes import (
    warn_of_forces,
    warn_of_sizes,
    warn_of_strong_gravity,
    warn_of_unstressed_bars,
    warn_of_upward_gravity,
)
from tensegrity_codegen.scene.checks.plausible_start import (
    LARGE_STRAIN,
    warn_of_crossing,
    warn_of_ground,
    warn_of_members,
    warn_of_outliers,
    warn_of_sag,
    warn_of_slack,
    warn_of_units,
)
from tensegrity_codegen.scene.names import describe_pieces
from tensegrity_codegen.structure.bodies import BodySystem, FixedBody
from tensegrity_codegen.structure.outline import compute_bar_distance, hide_bodies, outline_tendons
from tensegrity_codegen.structure.pieces import find_pieces
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import name_list

# Warnings of ranges of actuators that exclude the start, of clearances, and of limits without effect.


ROUNDING = 1e-9  # relative excess that is no warning
MAX_PAIRS = 200_000  # of bars whose distances are compared
WITHIN_BODY = "members between points of one rigid body never change their length"


def warn_of_ranges(subject: Structure | BodySystem) -> list[str]:
    """Return a warning for actuators whose range does not contain the rest lengths of the scene."""
    outside = []
    for actuator in subject.actuators:
        for e in actuator.members:
            rest_length = float(subject.rest_length[e])
            excess = max(actuator.range[0] - rest_length, rest_length - actuator.range[1])
            if excess > ROUNDING * rest_length:
                outside.append(
                    f"{actuator.name} ({subject.member_name[e]}: {rest_length:.6g} m, by {excess:.3g} m)"
                )
    problem = "the range of actuators does not contain the rest length of the scene"
    return [f"{problem}: {name_list(outside)}"] if outside else []


def warn_of_limits(subject: Structure | BodySystem) -> list[str]:
    """Return warnings for bars nearer than the clearance, and for members that a limit cannot reach."""
    sentences = (_warn_of_clearance(subject), _without_section(outline_tendons(subject)))
    return [sentence for sentence in sentences if sentence]


def _warn_of_clearance(subject: Structure | BodySystem) -> str:
    """Return which bars are nearer to each other than the clearance."""
    clearance = subject.limits.clearance
    if not math.isfinite(clearance) or not 0 < subject.n_bar_pairs <= MAX_PAIRS:
        return ""
    pairs, distance = compute_bar_distance(subject)
    shown = [
        f"{pairs[k][0]} and {pairs[k][1]} ({distance[k]:.4g} m, by {clearance - distance[k]:.3g} m)"
        for k in np.argsort(distance).tolist()
        if distance[k] < clearance - ROUNDING * max(clearance, 1e-3)
    ]
    problem = f"bars start nearer to each other than the clearance of {clearance:g} m"
    return f"{problem}: {name_list(shown, most=3)}" if shown else ""


def _without_section(structure: Structure) -> str:
    """Return bars or cables without a radius, where others of their kind have a limit of the stress."""
    limited = np.isfinite(structure.limits.yield_stress)
    bare = structure.radius == 0
    for kind in (structure.is_bar, ~structure.is_bar):
        if (limited & kind).any() and (bare & kind).any():
            names = [structure.member_name[e] for e in np.flatnonzero(bare & kind)]
            return f"no yield stress applies to members without a radius: {name_list(names)}"
    return ""


# Whether a structure lies on its side: made for y up, and used with z up.


MIN_SUPPORT_NODES = 3  # nodes that a structure stands on
# Extent along y over the largest, below which the structure stands upright in a plane.
MAX_FLAT_EXTENT_RATIO = 0.05
HEIGHT_TOLERANCE = 1e-6  # of the structure's size


def warn_of_side(structure: Structure) -> list[str]:
    """Return a warning if gravity acts along z, and the structure stands on y = least, and not on z.

    It stands on y where three nodes or more have the least y and do not lie on a line, all that are anchored
    (if any) are among them, and less than three have the least z.
    """
    if len(structure.axes) < 3 or int(np.argmax(np.abs(structure.gravity))) != 2:
        return []
    if not structure.gravity[2] or not structure.n_nodes:
        return []
    feet_y, feet_z = (_find_feet(structure.node_position, axis) for axis in (1, 2))
    extent = np.ptp(structure.node_position, axis=0)
    if (
        extent[1] < MAX_FLAT_EXTENT_RATIO * extent.max()
        or feet_y.sum() < MIN_SUPPORT_NODES
        or feet_z.sum() >= MIN_SUPPORT_NODES
    ):
        return []
    points = structure.node_position[feet_y]
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] <= HEIGHT_TOLERANCE * spread[0]:  # the feet lie on a line
        return []
    held = structure.node_anchored.any(axis=1)
    if held.any() and (held & ~feet_y).any():
        return []
    names = [name for name, foot in zip(structure.node_name, feet_y, strict=True) if foot]
    return [
        f"the structure seems to lie on its side: {len(names)} nodes ({name_list(names, 3)}) are "
        f"lowest in y and {int(feet_z.sum())} in z, but gravity acts along z; if y is up, use gravity = "
        f"[0, {structure.gravity[2]:g}, 0], or import with --up y, which turns the structure upright"
    ]


def _find_feet(position: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    """Return which nodes lie lowest along an axis, (n_nodes,)."""
    size = float(np.ptp(position, axis=0).max())
    feet: NDArray[np.bool_] = position[:, axis] <= position[:, axis].min() + HEIGHT_TOLERANCE * size
    return feet


def find_scene_warnings(
    subject: Structure | BodySystem, *, settles: bool = False, sags: bool = True
) -> tuple[str, ...]:
    """Return the warnings of a structure or body system.

    settles: the equilibrium is found first; sags: what is computed depends on the sag of cables.
    """
    with np.errstate(all="ignore"):  # numbers of any size are scenes
        if isinstance(subject, BodySystem):
            return find_body_warnings(subject)
        idle = (warn_of_unstressed_bars, warn_of_members) * settles + (warn_of_sag,) * (not sags)
        left_out = [sentence for warn in idle for sentence in warn(subject)]
        return tuple(sentence for sentence in find_warnings(subject) if sentence not in left_out)


def find_warnings(structure: Structure) -> tuple[str, ...]:
    """Return one short sentence for each kind of warning, naming the first few members or nodes.

    Doubts: extension above 50 % at the start and other units, loads and force inputs that only push on
    anchors, members between anchored nodes or on one body, damping of rigid bars, unconnected pieces;
    sizes and forces (see plausible_sizes), ranges and limits, a structure on its
    side, and a start without prestress, with bars that cross or buckle (see plausible_start). Corners and
    edges of bodies are no nodes and bars there. The structure is taken as sound (see `check_structure`).
    """
    check_instance(structure, Structure, "structure", "a Structure")
    whole, structure = structure, hide_bodies(structure)
    held = find_fully_anchored(structure.node_anchored, structure.axes)
    between_anchors = _find_spanning(structure, np.all(held[structure.strands.ends], axis=1))
    body = np.arange(whole.n_nodes)
    for place in whole.body_places:
        body[list(place.point)] = place.corner[0]
    start, stop = body[structure.strands.ends].T
    within_body = _find_spanning(structure, start == stop)
    pushed = held & (np.abs(structure.node_load).sum(axis=1) > 0)
    damped = structure.is_rigid & (structure.damping > 0)
    idle = [
        force.name for force in structure.inputs if force.kind == "force" and held[list(force.targets)].all()
    ]
    sentences = [
        *structure.notes,
        _strain_warning(structure) if structure.n_members else "",
        *warn_of_units(structure),
        _sentence(pushed, structure.node_name, "a load on a fully anchored node moves nothing"),
        _sentence(
            between_anchors, structure.member_name, "members between two fully anchored nodes never move"
        ),
        _sentence(within_body, structure.member_name, WITHIN_BODY),
        _sentence(damped, structure.member_name, "the damping of rigid bars has no effect"),
        f"force inputs on fully anchored nodes move nothing: {name_list(idle)}" if idle else "",
        _pieces_warning(whole),
        *warn_of_sizes(structure),
        *warn_of_forces(whole),
        *warn_of_side(structure),
        *warn_of_slack(structure),
        *warn_of_outliers(structure),
        *warn_of_sag(structure),
        *warn_of_crossing(structure),
        *warn_of_ranges(structure),
        *warn_of_limits(structure),
        *warn_of_ground(whole),
        *warn_of_members(structure),
    ]
    return tuple(sentence for sentence in sentences if sentence)


def find_body_warnings(system: BodySystem) -> tuple[str, ...]:
    """Return one short sentence for each kind of warning about a body system, as `find_warnings` does.

    Doubts: extension above 50 % at the start, loads on fixed points, tendons between fixed points, bodies
    without any tendon, gravity that points upward or is not that of the Earth by far.
    """
    structure = outline_tendons(system)
    held, ends = structure.node_anchored[:, 0], structure.connectivity
    pushed = held & (np.abs(system.node_load).sum(axis=1) > 0)
    between = held[ends[:, 0]] & held[ends[:, 1]]
    start, stop = system.node_body[ends].T
    joined = {*start.tolist(), *stop.tolist()}
    lonely = [body not in joined and not isinstance(b, FixedBody) for body, b in enumerate(system.bodies)]
    sentences = [
        _strain_warning(structure) if structure.n_members else "",
        *warn_of_units(structure),
        _sentence(pushed, system.node_name, "a load on a fixed point moves nothing"),
        _sentence(between, system.member_name, "tendons between two fixed points never move"),
        _sentence((start == stop) & ~between, system.member_name, WITHIN_BODY),
        _sentence(np.array(lonely), [b.name for b in system.bodies], "no tendon joins these bodies"),
        *warn_of_upward_gravity(system.gravity, system.axes),
        *warn_of_strong_gravity(system.gravity),
        *warn_of_crossing(system),
        *warn_of_ranges(system),
        *warn_of_limits(system),
        *warn_of_ground(system),
        *warn_of_members(system),
    ]
    return tuple(sentence for sentence in sentences if sentence)


def _find_spanning(structure: Structure, which: BoolArray) -> BoolArray:
    """Return the members all of whose strands are among `which` (n_strands,)."""
    found = np.ones(structure.n_members, dtype=np.bool_)
    np.logical_and.at(found, structure.strands.member, which)
    return found


def _sentence(which: BoolArray, names: Sequence[str], text: str) -> str:
    rows = np.flatnonzero(which).tolist()
    return f"{text}: {name_list([names[row] for row in rows])}" if rows else ""


def _strain_warning(structure: Structure) -> str:
    strain = structure.member_length() / structure.rest_length - 1
    large = np.where(structure.is_bar, np.abs(strain), strain) > LARGE_STRAIN
    worst = f"{100 * np.abs(strain[large]).max():.3g} %" if large.any() else ""
    problem = (
        f"members start with an extension above {100 * LARGE_STRAIN:.0f} % (up to {worst}; wrong units?)"
    )
    return _sentence(large & ~structure.is_rigid, structure.member_name, problem)


def _pieces_warning(structure: Structure) -> str:
    """Return a warning when members fall apart into pieces that share no node."""
    count, label = find_pieces(structure.n_nodes, *structure.joined.T)
    if count < 2:
        return ""
    _, start = np.unique(label, return_index=True)
    return describe_pieces([structure.node_label[node] for node in np.sort(start)])
