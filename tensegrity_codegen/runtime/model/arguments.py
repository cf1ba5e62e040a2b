"""Values of arguments at run time: those that no scene has are refused; loads and ground that follow."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.named_inputs import check_argument_names
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.quantities.arguments import ABOVE_ZERO, FROM_ZERO, GROUND_FROM_ZERO

LOAD = "node_load"


def check_arguments(manifest: Manifest, arguments: Mapping[str, Any]) -> None:
    """Raise for a word that is no argument of the model at run time, or a value that no scene has.

    See `check_argument_names` and `check_parameter_values`. A value None is not checked.
    """
    check_argument_names(manifest, arguments)
    check_parameter_values(manifest, arguments)


def check_parameter_values(manifest: Manifest, arguments: Mapping[str, Any]) -> None:
    """Raise InvalidValueError for run-time parameters with values that no scene can have.

    Rest lengths and stiffnesses are above zero, dampings, masses, friction and dissipation not negative. A
    stiffness that is zero in the scene, since the member has the other kind, may stay zero. `compute`
    evaluates at any values.
    """
    for name in (*ABOVE_ZERO, *FROM_ZERO):
        spec = next((item for item in manifest.arguments if item.name == name), None)
        if spec is None or arguments.get(name) is None:
            continue
        try:
            value = np.asarray(arguments[name], dtype=np.float64)
        except (TypeError, ValueError):  # no array of numbers: refused where shapes are checked
            continue
        wrong = value < 0
        if name in ABOVE_ZERO and value.shape[value.ndim - len(spec.shape) :] == spec.shape:
            is_above = ~np.isin(spec.over, GROUND_FROM_ZERO) if name == "ground" else True
            wrong = wrong | ((value == 0) & (np.reshape(spec.nominal, spec.shape) > 0) & is_above)
        if wrong.any():
            at = tuple(int(k) for k in np.argwhere(wrong)[0])
            element = spec.over[at[-1]] if spec.over and len(spec.over) == value.shape[-1] else str(list(at))
            raise InvalidValueError(
                "no structure has such a value",
                where=f"arguments.{name}: {element}",
                given=float(value[at]),
                allowed="above 0" if name in ABOVE_ZERO and element not in GROUND_FROM_ZERO else "0 or more",
            )


def apply_ground(model: Model, arguments: Mapping[str, Any]) -> Ground | None:
    """Return the ground of a model under run-time arguments, None where it has none."""
    ground: Ground | None = getattr(getattr(model, "structure", None), "ground", None)
    given = arguments.get("ground")
    if ground is None or given is None:
        return ground
    names = model.manifest.argument("ground").over
    return replace(ground, **dict(zip(names, np.ravel(given).tolist(), strict=True)))


def apply_loads(model: Model, *values: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """Return the loads under run-time arguments, one row of each of `values`, (n_t, n_nodes, 3) [N].

    None where they are those of the scene: the model takes no loads, or its structure is not known. Inputs
    that are forces are not part of it.
    """
    spec = next((item for item in model.manifest.arguments if item.name == LOAD), None)
    structure = getattr(model, "structure", None)
    if spec is None or structure is None:
        return None
    rows = [model.manifest.node_name.index(name) for name in spec.over]
    load: NDArray[np.float64] = np.tile(
        np.asarray(structure.node_load, dtype=np.float64), (len(values), 1, 1)
    )
    for k, given in enumerate(values):
        if given.get(LOAD) is not None:
            load[k][np.ix_(rows, list(model.manifest.axes))] = np.reshape(given[LOAD], spec.shape)
    return load
