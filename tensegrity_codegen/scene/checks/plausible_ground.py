"""Facts about a ground that may surprise: nodes below it at the start, stiffness, frequencies, lying bars."""

import numpy as np

from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.structure.bodies import Bar
from tensegrity_codegen.structure.contact_estimates import (
    Subject,
    compute_gap,
    estimate_contacts,
    find_position,
)
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

ROUNDING = 1e-9  # of the structure's size
STIFFNESS_RATIOS = (0.1, 10.0)  # of tangential over normal stiffness
MAX_MASS_RATIO = 100.0  # mean over least mass of the contacts
SAMPLES_OF_A_PERIOD = 2.0  # below which samples do not show a vibration


def warn_of_ground(subject: Subject) -> list[str]:
    """Return a sentence for each fact about the ground that may surprise; none without a ground."""
    ground = subject.ground
    if ground is None:
        return []
    rest, gap = estimate_contacts(subject, ground), compute_gap(subject, ground)
    size = float(np.ptp(find_position(subject), axis=0).max())
    ratio = ground.stick_stiffness / rest.stiffness if rest.stiffness else 1.0
    is_rough = ground.friction > 0
    found = []
    deep = np.flatnonzero(-gap > rest.largest_penetration * (1 + ROUNDING) + ROUNDING * size)
    if deep.size:
        deep = deep[np.argsort(gap[deep], kind="stable")]
        shown = [f"{subject.node_name[ground.node[k]]} ({-gap[k]:.4g} m)" for k in deep]
        found.append(
            f"nodes start below the ground: {name_list(shown)}; the weight alone presses a contact at "
            f"most {rest.largest_penetration:.3g} m into the ground, which throws them up"
        )
    if rest.weight == 0 and subject.gravity.any():
        found.append("gravity does not act into the ground: the structure does not rest on it")
    if is_rough and not STIFFNESS_RATIOS[0] <= ratio <= STIFFNESS_RATIOS[1]:
        found.append(
            f"the tangential stiffness of the ground is {ratio:.3g} times the normal one "
            f"({ground.stick_stiffness:.4g} against {rest.stiffness:.4g} N/m); usual are "
            f"{STIFFNESS_RATIOS[0]:g} to {STIFFNESS_RATIOS[1]:g}"
        )
    if not is_rough and ground.velocity.any():
        found.append("the velocity of the ground has no effect without friction")
    light = int(np.argmin(rest.mass))
    if rest.mass.mean() > MAX_MASS_RATIO * rest.mass[light]:
        found.append(
            f"contact {subject.node_name[ground.node[light]]} has {rest.mass[light]:.3g} kg, contacts in the "
            f"mean {rest.mass.mean():.3g} kg: alone it vibrates on the ground at {rest.frequency:.4g} Hz, "
            "which takes small steps"
        )
    lying = _find_lying_bars(subject, gap, size) if is_rough else []
    if lying:
        found.append(
            f"bars lie on the ground with both ends: {name_list(lying)}; bars have no spin, so that they "
            "slide where a round bar would roll"
        )
    return found


def warn_of_sampled_contacts(subject: Subject, interval: float) -> list[str]:
    """Return a sentence where samples, `interval` [s] apart, do not show single contacts with the ground."""
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
