"""Sag of cables with mass in one piece: where it takes stiffness from them, by the modulus of Ernst."""

import numpy as np

from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.structure.segments import find_chains
from tensegrity_codegen.structure.structure import Structure

MAX_SAG_LOSS = 1e-2  # w^2 L^2 EA / (12 T^3), by which a sagging cable is softer than a straight one


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
    text = f"the sag of cables with mass matters, w^2 L^2 EA / (12 T^3) is above {MAX_SAG_LOSS:g} (Ernst)"
    todo = "add segments = 8 to them or their class, or tighten them"
    return [f"{text}: {name_list(told)}: {todo}"] if told else []
