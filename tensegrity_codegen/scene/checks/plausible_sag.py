"""Sag of cables with mass in one piece: where it takes stiffness from them, by the modulus of Ernst."""

import numpy as np

from tensegrity_codegen.structure.segments import find_chains
from tensegrity_codegen.structure.structure import Structure

MAX_SAG_LOSS = 1e-2  # w^2 L^2 EA / (12 T^3), by which a sagging cable is softer than a straight one
MOST_SHOWN = 3


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
    up = structure.gravity / size
    ends = structure.node_position[structure.connectivity]
    chord = ends[:, 1] - ends[:, 0]
    level = np.linalg.norm(chord - (chord @ up)[:, None] * up, axis=1)
    weight = structure.member_mass * size / structure.rest_length
    tension = structure.static_tension()
    with np.errstate(divide="ignore", invalid="ignore"):
        loss = (weight * level) ** 2 * structure.mu * structure.rest_length / (12 * tension**3)
    rows = np.flatnonzero(alone & (level > 0) & ~(loss <= MAX_SAG_LOSS))
    if not rows.size:
        return []
    worst = rows[np.argsort(-loss[rows], kind="stable")]
    told = [
        f"{structure.member_name[e]} {loss[e]:.3g}, so {1 / (1 + loss[e]):.4g} of its stiffness"
        if tension[e] > 0
        else f"{structure.member_name[e]}, which is slack as a straight line"
        for e in worst[:MOST_SHOWN].tolist()
    ]
    more = f" and {rows.size - MOST_SHOWN} more" if rows.size > MOST_SHOWN else ""
    return [
        f"the sag of cables with mass matters, w^2 L^2 EA / (12 T^3) is above {MAX_SAG_LOSS:g} (Ernst): "
        f"{'; '.join(told)}{more}: add segments = 8 to the cable or its class, or tighten it"
    ]
