"""States that keep the constraints between the coordinates of a model."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.formulations import find_formulation

TOLERANCE = 1e-9  # of the largest entry
MAX_ITERATIONS = 4  # lengths that follow the tension depend on the state that they correct


def make_consistent(
    model: Model, coordinate: FloatArray, velocity: FloatArray, arguments: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Return coordinates and velocities (n_coordinates,) that contradict each other in nothing.

    Those given, where a model has no constraints between its coordinates or they keep them. Where rigid bars
    stand for stiff ones, whose lengths are not exactly what the model keeps them at, the nearest state.
    Raises InvalidValueError for any other contradiction.
    """
    if not model.has("consistent_coordinate"):
        return coordinate, velocity
    state = {"coordinate": coordinate, "velocity": velocity}
    stands_for_stiff = _stands_for_stiff_bars(model, arguments)
    for _ in range(MAX_ITERATIONS):
        corrected = dict(state)
        for name in corrected:
            corrected[name] = model.compute(f"consistent_{name}", **{**arguments, **corrected})
            if not stands_for_stiff:
                _check(model, name, state[name], corrected[name])
        if not stands_for_stiff:
            return coordinate, velocity
        state = corrected
    return state["coordinate"], state["velocity"]


def _stands_for_stiff_bars(model: Model, arguments: Mapping[str, Any]) -> bool:
    if not model.has("rigidity_error"):
        return False
    # What lengths that follow tensions leave out may vanish at the scene's start.
    structure, is_corrected = getattr(model, "structure", None), not model.manifest.rigid_bar
    has_stiff = isinstance(structure, Structure) and bool(np.any(structure.mu[structure.is_bar] > 0.0))
    return (is_corrected and has_stiff) or bool(np.any(model.compute("rigidity_error", **arguments)))


def _check(model: Model, name: str, given: FloatArray, consistent: FloatArray) -> None:
    difference = np.abs(consistent - given)
    worst = int(np.argmax(difference))
    if difference[worst] <= TOLERANCE * np.max(np.abs(given[~model.manifest.is_centre]), initial=0.0):
        return
    rigid = find_formulation(model.manifest.formulation).has_rigid_bars
    why = (
        "it changes the length of a rigid bar"
        if rigid
        else "the differences around a cycle do not add up to zero"
    )
    raise InvalidValueError(
        f"the initial {name} violates the constraints: {why}",
        where=f"simulate: {model.manifest.coordinate_name[worst]}",
        given=float(given[worst]),
        allowed=f"{consistent[worst]:.9g}, in the nearest consistent state",
        hint="start from a motion that does not change the length of rigid bars"
        if rigid
        else "start from differences of node positions",
    )
