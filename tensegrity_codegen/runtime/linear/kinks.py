"""Cables exactly at their rest lengths: their stiffness jumps, a linear model holds on one side only."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.require import require_quantities
from tensegrity_codegen.system.arrays import FloatArray

KINK_QUANTITIES = ("member_length", "member_extension")


def find_kinks(
    model: Model,
    cables: Sequence[str],
    state: FloatArray,
    rounding: float,
    arguments: Mapping[str, Any] | None = None,
) -> dict[str, bool]:
    """Return the cables that are at their rest lengths within rounding.

    Parameters
    ----------
    model : Model
        Must have KINK_QUANTITIES.
    cables : sequence of str
        Names of the members to look at.
    state : (n_states,)
        Coordinates and velocities.
    rounding : float
        Difference of length and rest length that counts as rounding, over the largest of length, rest length
        and coordinates.
    arguments : mapping, optional
        Inputs and parameters by name, where they differ from the scene.

    Returns
    -------
    dict
        Name of the cable -> whether it counts as taut (it is longer than its rest length) or as slack.

    Raises
    ------
    FormulationError
        If the model lacks a quantity.
    """
    require_quantities(model, KINK_QUANTITIES, "the search for slack cables needs")
    coordinate = state[: len(model.manifest.coordinate_name)]
    given = {**(arguments or {}), "coordinate": coordinate}
    length = np.asarray(model.compute("member_length", **given))
    extension = np.asarray(model.compute("member_extension", **given))
    scale = np.maximum(np.maximum(length, length - extension), np.abs(coordinate).max(initial=0.0))
    place = {name: index for index, name in enumerate(model.manifest.member_name)}
    rows = [place[name] for name in cables]
    at_rest = np.abs(extension[rows]) <= rounding * scale[rows]
    return {
        name: bool(extension[row] > 0.0)
        for name, row, kink in zip(cables, rows, at_rest, strict=True)
        if kink
    }
