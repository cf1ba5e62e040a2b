"""A start that looks like a mistake: cables without tension, bars that cross, sag, nodes below the ground."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.checks.plausible_sizes import warn_of_sizes
from tensegrity_codegen.structure.bodies import Bar, BodySystem
from tensegrity_codegen.structure.contact_estimates import (
    Subject,
    compute_gap,
    estimate_contacts,
    find_position,
)
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.structure.outline import compute_bar_distance, outline_tendons
from tensegrity_codegen.structure.pieces import find_chains
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import name_list

MIN_CABLES = 3  # of which one should be in tension
SAME_LENGTH = 1e-9  # of the length: difference from the rest length that counts as none
ASSUMED_RADIUS_RATIO = 5e-4  # radius over length that is taken for bars without one
OVERLAP = 1e-9  # of the structure's size
MAX_PAIRS = 200_000  # of bars whose distances are compared
FACTOR = 1000.0  # between neighbours
LARGE_STRAIN = 0.5  # above which the units are doubted
LONG_RATIO = 10.0  # of the rest length of a slack cable over the distance of its ends
LEAST_MODULUS = 5e5  # [Pa], below that of rubber bands, above that of steel in MPa
LEAST_YIELD_STRESS = 1e4  # [Pa], below that of rubber, above that of steel in MPa


def warn_of_slack(structure: Structure) -> list[str]:
    """Return a warning if none of several cables is in tension."""
    cables, tension = ~structure.is_bar, structure.static_tension()
    count = int(cables.sum())
    hangs = cables.all() and (structure.gravity.any() or structure.node_load.any())  # its loads pull it taut
    if count < MIN_CABLES or (tension[cables] > 0).any() or hangs:
        return []
    shorter = structure.rest_length - structure.member_length() > SAME_LENGTH * structure.rest_length
    slack = int((cables & shorter).sum())
    state = f"{slack} are slack" if slack else "all start at their rest length"
    return [
        f"none of the {count} cables starts in tension ({state}): there is no prestress; `analyse SCENE "
        "--prestress FORCE --scene-out FILE` finds one with all cables in tension, if there is any"
    ]


def warn_of_units(structure: Structure) -> list[str]:
    """Return warnings for lengths that seem to be in mm, and stresses in MPa."""
    with np.errstate(divide="ignore", invalid="ignore"):
        times = structure.rest_length / structure.member_length()
        modulus = structure.axial_stiffness / structure.section_area
    is_long = ~structure.is_bar & np.isfinite(times) & (times > LONG_RATIO)
    is_soft = (modulus > 0) & (modulus < LEAST_MODULUS)
    is_soft &= not (is_soft.any() and warn_of_sizes(structure))
    stress = structure.limits.yield_stress
    checked = (
        (is_long, "the rest length is many times the distance of the ends (in mm?)", times, "times"),
        (is_soft, "Young's modulus EA / A is below that of rubber (in MPa?)", modulus, "Pa"),
        (stress < LEAST_YIELD_STRESS, "the yield stress is below that of any solid (in MPa?)", stress, "Pa"),
    )
    sentences = []
    for flagged, problem, value, unit in checked:
        shown = [f"{structure.member_name[e]} ({value[e]:.6g} {unit})" for e in np.flatnonzero(flagged)]
        sentences += [f"{problem}: {name_list(shown, most=3)}"] if shown else []
    return sentences


def warn_of_crossing(subject: Structure | BodySystem) -> list[str]:
    """Return a warning for bars in space that overlap; without a radius, with 1/2,000 of their length."""
    if isinstance(subject, Structure):
        if len(subject.axes) < 3 and subject.interference is None:
            return []
        thin = np.where(subject.is_bar, ASSUMED_RADIUS_RATIO * subject.member_length(), 0.0)
        subject = subject.with_changes(radius=np.maximum(subject.radius, thin), inner_radius=None)
    if not 0 < subject.n_bar_pairs <= MAX_PAIRS:
        return []
    size = float(np.ptp(outline_tendons(subject).node_position, axis=0).max())
    pairs, distance = compute_bar_distance(subject)
    shown = [" and ".join(pairs[k]) for k in np.argsort(distance).tolist() if distance[k] < -OVERLAP * size]
    problem = "bars cross or overlap at the start, and nothing keeps them apart in a motion"
    return [f"{problem}: {name_list(shown, most=3)}"] if shown else []


def warn_of_members(subject: Structure | BodySystem) -> list[str]:
    """Return warnings for members beyond their limits, buckled or strained at rest; not of rigid bars."""
    structure = outline_tendons(subject)
    tension = np.where(structure.is_rigid, np.nan, structure.static_tension())
    report = check_members(structure, tension, structure.member_length())
    new = [entry for entry in report.doubtful if entry.limit != "strain" or abs(entry.value) <= LARGE_STRAIN]
    return [f"at the start {sentence}" for sentence in replace(report, doubtful=tuple(new)).describe()]


def warn_of_outliers(structure: Structure) -> list[str]:
    """Return a warning for masses and stiffnesses FACTOR times off the mean of their neighbours.

    Neighbours of a node are the nodes that members join to it, those of a member the members of its kind at
    its nodes, or all of its kind where there is none. Means are geometric.
    """
    start, stop = structure.connectivity.T
    mass = structure.node_mass.copy()
    for end in (start, stop):
        np.add.at(mass, end, structure.member_mass / 2)
    free = ~structure.node_anchored.all(axis=1) & (mass > 0)
    log = np.log(np.where(free, mass, 1.0))
    total, count = np.zeros(len(mass)), np.zeros(len(mass))
    for node, neighbour in ((start, stop), (stop, start)):
        np.add.at(total, node, log[neighbour])
        np.add.at(count, node, free[neighbour])
    sentences = [_describe("masses", "kg", structure.node_name, mass, log, total, count, free)]
    elastic = structure.mu * structure.rest_length
    for kind, name in ((structure.is_bar, "bars"), (~structure.is_bar, "cables")):
        chosen = kind & (elastic > 0)
        log = np.log(np.where(chosen, elastic, 1.0))
        at_node, number = np.zeros(len(mass)), np.zeros(len(mass))
        for end in (start, stop):
            np.add.at(at_node, end, log)
            np.add.at(number, end, chosen)
        total, count = (
            x[start] + x[stop] - 2 * own_value for x, own_value in ((at_node, log), (number, chosen))
        )
        alone = count == 0
        total, count = np.where(alone, log.sum() - log, total), np.where(alone, chosen.sum() - 1, count)
        sentences.append(
            _describe(f"EA of {name}", "N", structure.member_name, elastic, log, total, count, chosen)
        )
    return [sentence for sentence in sentences if sentence]


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
    has_neighbours = chosen & (count > 0)
    mean = total / np.where(has_neighbours, count, 1.0)
    rows = np.flatnonzero(has_neighbours & (np.abs(log - mean) > np.log(FACTOR)))
    if not rows.size:
        return ""
    rows = rows[np.argsort(-np.abs(log[rows] - np.median(log[chosen])), kind="stable")]
    shown = [f"{names[k]} ({value[k]:.3g} {unit} against {np.exp(mean[k]):.3g} {unit})" for k in rows]
    return (
        f"{what} are more than {FACTOR:,.0f} times off those of their neighbours: {name_list(shown, most=3)}"
    )


MAX_SAG_LOSS = 5e-2  # w^2 L^2 EA / (12 T^3), by which a sagging cable is softer than a straight one


def warn_of_sag(structure: Structure) -> list[str]:
    """Return a warning for cables with mass in one piece whose sag matters at their tension at the start.

    Ernst (1965): EA / (1 + w^2 L^2 EA / (12 T^3)), with the weight w for each metre of rest length and the
    horizontal length L; a slack cable has no stiffness left.
    """
    size = float(np.linalg.norm(structure.gravity))
    alone = ~structure.is_bar & (structure.member_mass > 0)
    alone[[e for rows in find_chains(structure).values() for e in rows]] = False
    if not alone.any() or not size:
        return []
    chord = np.diff(structure.node_position[structure.connectivity], axis=1)[:, 0]
    level = np.linalg.norm(np.cross(chord, structure.gravity / size), axis=1)
    weight = structure.member_mass * size / structure.rest_length
    with np.errstate(divide="ignore", invalid="ignore"):
        cube = 12 * structure.static_tension() ** 3
        loss = (weight * level) ** 2 * structure.mu * structure.rest_length / cube
    rows = np.flatnonzero(alone & (level > 0) & ~(loss <= MAX_SAG_LOSS))
    told = [
        f"{structure.member_name[e]} ({loss[e]:.3g}, so {1 / (1 + loss[e]):.4g} of its stiffness)"
        if np.isfinite(loss[e])
        else f"{structure.member_name[e]} (slack as a straight line)"
        for e in rows[np.argsort(-loss[rows], kind="stable")].tolist()
    ]
    problem = f"the sag of cables with mass matters, w^2 L^2 EA / (12 T^3) is above {MAX_SAG_LOSS:g} (Ernst)"
    todo = "add segments = 8 to them or their class, or tighten them"
    return [f"{problem}: {name_list(told)}: {todo}"] if told else []


ROUNDING = 1e-9  # of the structure's size
STIFFNESS_RATIOS = (0.1, 10.0)  # of tangential over normal stiffness
MAX_MASS_RATIO = 100.0  # mean over least mass of the contacts
SAMPLES_OF_A_PERIOD = 2.0  # below which samples do not show a vibration


def warn_of_ground(subject: Subject) -> list[str]:
    """Return a sentence for each fact about the ground that may surprise; none without a ground."""
    ground = subject.ground
    if ground is None:
        return []
    at_rest, gap = estimate_contacts(subject, ground), compute_gap(subject, ground)
    size = float(np.ptp(find_position(subject), axis=0).max())
    ratio = ground.stick_stiffness / at_rest.stiffness if at_rest.stiffness else 1.0
    is_rough = ground.friction > 0
    sentences = []
    deep = np.flatnonzero(-gap > at_rest.largest_penetration * (1 + ROUNDING) + ROUNDING * size)
    if deep.size:
        deep = deep[np.argsort(gap[deep], kind="stable")]
        shown = [f"{subject.node_name[ground.node[k]]} ({-gap[k]:.4g} m)" for k in deep]
        sentences.append(
            f"nodes start below the ground: {name_list(shown)}; the weight alone presses a contact at "
            f"most {at_rest.largest_penetration:.3g} m into the ground, which throws them up"
        )
    if at_rest.weight == 0 and subject.gravity.any():
        sentences.append("gravity does not act into the ground: the structure does not rest on it")
    if is_rough and not STIFFNESS_RATIOS[0] <= ratio <= STIFFNESS_RATIOS[1]:
        sentences.append(
            f"the tangential stiffness of the ground is {ratio:.3g} times the normal one "
            f"({ground.stick_stiffness:.4g} against {at_rest.stiffness:.4g} N/m); usual are "
            f"{STIFFNESS_RATIOS[0]:g} to {STIFFNESS_RATIOS[1]:g}"
        )
    if not is_rough and ground.velocity.any():
        sentences.append("the velocity of the ground has no effect without friction")
    mass, light = at_rest.mass, int(np.argmin(at_rest.mass))
    if mass.mean() > MAX_MASS_RATIO * mass[light]:
        sentences.append(
            f"contact {subject.node_name[ground.node[light]]} has {mass[light]:.3g} kg, contacts in the "
            f"mean {mass.mean():.3g} kg: alone it vibrates on the ground at {at_rest.frequency:.4g} Hz, "
            "which takes small steps"
        )
    lying = _find_lying_bars(subject, gap, size) if is_rough else []
    if lying:
        sentences.append(
            f"bars lie on the ground with both ends: {name_list(lying)}; bars have no spin, so that they "
            "slide where a round bar would roll; bodies of kind rigid roll"
        )
    return sentences


def warn_of_sampled_contacts(subject: Subject, interval: float) -> list[str]:
    """Return a sentence if samples, `interval` [s] apart, do not show single contacts with the ground."""
    if subject.ground is None:
        return []
    with np.errstate(all="ignore"):
        frequency = estimate_contacts(subject, subject.ground).frequency
    if frequency * interval * SAMPLES_OF_A_PERIOD <= 1.0:
        return []
    return [
        f"contacts with the ground vibrate at up to {frequency:.4g} Hz (period {1 / frequency:.3g} s) and "
        f"samples are {interval:.3g} s apart: they do not show single contacts"
    ]


def _find_lying_bars(subject: Subject, gap: FloatArray, size: float) -> list[str]:
    """Return the names of the bars whose two end balls touch the ground at the start."""
    ground = subject.ground
    if ground is None:
        return []
    touches = np.zeros(subject.n_nodes, dtype=np.bool_)
    touches[ground.node[gap <= ROUNDING * size]] = True
    if isinstance(subject, Structure):
        lying = subject.is_bar & touches[subject.connectivity].all(axis=1)
        return [subject.member_name[e] for e in np.flatnonzero(lying)]
    bars = [(k, body) for k, body in enumerate(subject.bodies) if isinstance(body, Bar)]
    return [body.name for k, body in bars if touches[list(subject.bar_ends(k))].all()]
