"""A start that looks like a mistake: no cable in tension, bars that cross, values unlike their neighbours."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.structure.bar_distance import compute_bar_distance
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.structure.outline import outline_tendons
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

FEWEST_CABLES = 3  # of which one should be in tension
SAME_LENGTH = 1e-9  # of the length: difference from the rest length that counts as none
ASSUMED_RADIUS_RATIO = 5e-4  # radius over length that is taken for bars without one
OVERLAP = 1e-9  # of the structure's size
MOST_PAIRS = 200_000  # of bars whose distances are compared
FACTOR = 1000.0  # between neighbours
LARGE_STRAIN = 0.5  # above which the units are doubted


def warn_of_slack(structure: Structure) -> list[str]:
    """Return a warning where none of several cables is in tension."""
    cables, tension = ~structure.is_bar, structure.static_tension()
    count = int(cables.sum())
    hangs = cables.all() and (structure.gravity.any() or structure.node_load.any())  # its loads pull it taut
    if count < FEWEST_CABLES or (tension[cables] > 0).any() or hangs:
        return []
    shorter = structure.rest_length - structure.member_length() > SAME_LENGTH * structure.rest_length
    slack = int((cables & shorter).sum())
    which = f"{slack} are slack" if slack else "all start at their rest length"
    return [
        f"none of the {count} cables starts in tension ({which}): there is no prestress; `analyse SCENE "
        "--prestress FORCE --scene-out FILE` finds one with all cables in tension, if there is any"
    ]


def warn_of_crossing(subject: Structure | BodySystem) -> list[str]:
    """Return a warning for bars that overlap; bars without a radius have one of 1/2,000 of their length.

    In a plane, bars cross on purpose.
    """
    if isinstance(subject, Structure):
        if len(subject.axes) < 3 and subject.interference is None:
            return []
        thin = np.where(subject.is_bar, ASSUMED_RADIUS_RATIO * subject.member_length(), 0.0)
        subject = subject.with_changes(radius=np.maximum(subject.radius, thin), inner_radius=None)
    if not 0 < subject.n_bar_pairs <= MOST_PAIRS:
        return []
    size = float(np.ptp(outline_tendons(subject).node_position, axis=0).max())
    pairs, distance = compute_bar_distance(subject)
    shown = [" and ".join(pairs[k]) for k in np.argsort(distance).tolist() if distance[k] < -OVERLAP * size]
    text = "bars cross or overlap at the start, and nothing keeps them apart in a motion"
    return [f"{text}: {name_list(shown, most=3)}"] if shown else []


def warn_of_members(subject: Structure | BodySystem) -> list[str]:
    """Return warnings for members beyond their limits, buckled or strained at the stated positions, at rest.

    Tensions follow from the lengths there, so that those of rigid bars are not known. Strains above
    LARGE_STRAIN are doubted elsewhere.
    """
    structure = outline_tendons(subject)
    tension = np.where(structure.is_rigid, np.nan, structure.static_tension())
    found = check_members(structure, tension, structure.member_length())
    new = [item for item in found.doubtful if item.limit != "strain" or abs(item.value) <= LARGE_STRAIN]
    return [f"at the start {text}" for text in replace(found, doubtful=tuple(new)).describe()]


def warn_of_outliers(structure: Structure) -> list[str]:
    """Return a warning for masses and stiffnesses FACTOR times off the mean of their neighbours.

    Neighbours of a node are the nodes that members join to it, those of a member the members of its kind at
    its nodes, or all of its kind where there is none. Means are geometric.
    """
    first, second = structure.connectivity.T
    mass = structure.node_mass.copy()
    for end in (first, second):
        np.add.at(mass, end, structure.member_mass / 2)
    free = ~structure.node_anchored.all(axis=1) & (mass > 0)
    log = np.log(np.where(free, mass, 1.0))
    total, count = np.zeros(len(mass)), np.zeros(len(mass))
    for one, other in ((first, second), (second, first)):
        np.add.at(total, one, log[other])
        np.add.at(count, one, free[other])
    found = [_describe("masses", "kg", structure.node_name, mass, log, total, count, free)]
    elastic = structure.mu * structure.rest_length
    for kind, name in ((structure.is_bar, "bars"), (~structure.is_bar, "cables")):
        chosen = kind & (elastic > 0)
        log = np.log(np.where(chosen, elastic, 1.0))
        at_node, number = np.zeros(len(mass)), np.zeros(len(mass))
        for end in (first, second):
            np.add.at(at_node, end, log)
            np.add.at(number, end, chosen)
        total, count = (x[first] + x[second] - 2 * own for x, own in ((at_node, log), (number, chosen)))
        alone = count == 0
        total, count = np.where(alone, log.sum() - log, total), np.where(alone, chosen.sum() - 1, count)
        found.append(
            _describe(f"EA of {name}", "N", structure.member_name, elastic, log, total, count, chosen)
        )
    return [text for text in found if text]


def _describe(
    what: str,
    unit: str,
    names: tuple[str, ...],
    value: FloatArray,
    log: FloatArray,
    total: FloatArray,
    count: FloatArray,
    chosen: NDArray[np.bool_],
) -> str:
    """Return which values are far from the mean of their neighbours, the farthest from all others first."""
    known = chosen & (count > 0)
    mean = total / np.where(known, count, 1.0)
    rows = np.flatnonzero(known & (np.abs(log - mean) > np.log(FACTOR)))
    if not rows.size:
        return ""
    rows = rows[np.argsort(-np.abs(log[rows] - np.median(log[chosen])), kind="stable")]
    shown = [f"{names[k]} ({value[k]:.3g} {unit} against {np.exp(mean[k]):.3g} {unit})" for k in rows]
    return (
        f"{what} are more than {FACTOR:,.0f} times off those of their neighbours: {name_list(shown, most=3)}"
    )
