"""What is allowed and still looks like a mistake, in short sentences."""

from collections.abc import Sequence

import numpy as np

from tensegrity_codegen.scene.checks.geometry import find_fully_anchored
from tensegrity_codegen.scene.checks.plausible_forces import (
    warn_of_forces,
    warn_of_strong_gravity,
    warn_of_unstressed_bars,
    warn_of_upward_gravity,
)
from tensegrity_codegen.scene.checks.plausible_limits import warn_of_limits, warn_of_ranges
from tensegrity_codegen.scene.checks.plausible_sizes import warn_of_sizes
from tensegrity_codegen.scene.checks.plausible_start import (
    LARGE_STRAIN,
    warn_of_crossing,
    warn_of_members,
    warn_of_outliers,
    warn_of_slack,
)
from tensegrity_codegen.scene.checks.upright import warn_of_side
from tensegrity_codegen.scene.names import describe_pieces, name_list
from tensegrity_codegen.structure.bodies import BodySystem, FixedBody
from tensegrity_codegen.structure.outline import outline_tendons
from tensegrity_codegen.structure.pieces import find_pieces
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray
from tensegrity_codegen.system.checks import check_instance


def find_scene_warnings(subject: Structure | BodySystem, *, settles: bool = False) -> tuple[str, ...]:
    """Return what `find_warnings` or `find_body_warnings` says; settles: the equilibrium is found first."""
    with np.errstate(all="ignore"):  # numbers of any size are scenes
        if isinstance(subject, BodySystem):
            return find_body_warnings(subject)
        starts = (warn_of_unstressed_bars, warn_of_members) if settles else ()
        unsettled = [sentence for warn in starts for sentence in warn(subject)]
        return tuple(sentence for sentence in find_warnings(subject) if sentence not in unsettled)


def find_warnings(structure: Structure) -> tuple[str, ...]:
    """Return one short sentence for each kind of warning, naming the first few members or nodes.

    Doubts: extension above 50 % at the start (wrong units suspected), loads and force inputs that only
    push on anchors, members between anchored nodes, damping of rigid bars, several unconnected pieces;
    sizes (see plausible_sizes), forces (see plausible_forces), ranges and limits (see plausible_limits), a
    structure on its side (see upright), and a start without prestress, with bars that cross or buckle (see
    plausible_start). The structure is taken as sound (see `check_structure`).
    """
    check_instance(structure, Structure, "structure", "a Structure")
    held = find_fully_anchored(structure.node_anchored, structure.axes)
    first, second = structure.connectivity.T
    between_anchors = held[first] & held[second]
    pushed = held & (np.abs(structure.node_load).sum(axis=1) > 0)
    damped = structure.is_rigid & (structure.damping > 0)
    found = [
        _strain_warning(structure),
        _sentence(pushed, structure.node_name, "a load on a fully anchored node moves nothing"),
        _sentence(
            between_anchors, structure.member_name, "members between two fully anchored nodes never move"
        ),
        _sentence(damped, structure.member_name, "the damping of rigid bars has no effect"),
        *_input_warnings(structure, held),
        _pieces_warning(structure, held),
        *warn_of_sizes(structure),
        *warn_of_forces(structure),
        *warn_of_side(structure),
        *warn_of_slack(structure),
        *warn_of_outliers(structure),
        *warn_of_crossing(structure),
        *warn_of_ranges(structure),
        *warn_of_limits(structure),
        *warn_of_members(structure),
    ]
    return tuple(sentence for sentence in found if sentence)


def find_body_warnings(system: BodySystem) -> tuple[str, ...]:
    """Return one short sentence for each kind of warning about a body system, as `find_warnings` does.

    Doubts: extension above 50 % at the start, loads on fixed points, tendons between fixed points, bodies
    without any tendon, gravity that points upward or is not that of the Earth by far.
    """
    structure = outline_tendons(system)
    held, ends = structure.node_anchored[:, 0], structure.connectivity
    pushed = held & (np.abs(system.node_load).sum(axis=1) > 0)
    between = held[ends[:, 0]] & held[ends[:, 1]]
    joined = {int(body) for body in system.node_body[ends.ravel()]}
    lonely = [body not in joined and not isinstance(b, FixedBody) for body, b in enumerate(system.bodies)]
    found = [
        _strain_warning(structure) if structure.n_members else "",
        _sentence(pushed, system.node_name, "a load on a fixed point moves nothing"),
        _sentence(between, system.member_name, "tendons between two fixed points never move"),
        _sentence(np.array(lonely), [b.name for b in system.bodies], "no tendon joins these bodies"),
        *warn_of_upward_gravity(system.gravity, system.axes),
        *warn_of_strong_gravity(system.gravity),
        *warn_of_crossing(system),
        *warn_of_ranges(system),
        *warn_of_limits(system),
        *warn_of_members(system),
    ]
    return tuple(sentence for sentence in found if sentence)


def _sentence(which: BoolArray, names: Sequence[str], text: str) -> str:
    rows = np.flatnonzero(which).tolist()
    return f"{text}: {name_list([names[row] for row in rows])}" if rows else ""


def _strain_warning(structure: Structure) -> str:
    strain = structure.member_length() / structure.rest_length - 1
    large = np.where(structure.is_bar, np.abs(strain), strain) > LARGE_STRAIN
    worst = f"{100 * np.abs(strain[large]).max():.3g} %" if large.any() else ""
    text = f"members start with an extension above {100 * LARGE_STRAIN:.0f} % (up to {worst}; wrong units?)"
    return _sentence(large & ~structure.is_rigid, structure.member_name, text)


def _input_warnings(structure: Structure, held: BoolArray) -> list[str]:
    idle = [item.name for item in structure.inputs if item.kind == "force" and held[list(item.targets)].all()]
    return [f"force inputs on fully anchored nodes move nothing: {name_list(idle)}"] if idle else []


def _pieces_warning(structure: Structure, held: BoolArray) -> str:
    """Return a warning when members fall apart into pieces that share no node."""
    first, second = structure.connectivity.T
    count, label = find_pieces(structure.n_nodes, first, second)
    if count < 2:
        return ""
    _, start = np.unique(label, return_index=True)
    return describe_pieces([structure.node_name[node] for node in np.sort(start)])
