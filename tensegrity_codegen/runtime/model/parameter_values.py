"""Values of run-time parameters that a scene would refuse: negative rest lengths, stiffnesses, masses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.manifest import Manifest
from tensegrity_codegen.quantities.arguments import ABOVE_ZERO, FROM_ZERO

__all__ = ["check_parameter_values"]


def check_parameter_values(manifest: Manifest, arguments: Mapping[str, Any]) -> None:
    """Raise InvalidValueError for run-time parameters with values that no scene can have.

    Rest lengths and stiffnesses are above zero, dampings and masses not negative. A stiffness that is zero in
    the scene, since the member has the other kind, may stay zero. `compute` evaluates at any values.
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
            wrong = wrong | ((value == 0) & (np.reshape(spec.nominal, spec.shape) > 0))
        if wrong.any():
            at = tuple(int(k) for k in np.argwhere(wrong)[0])
            element = spec.over[at[-1]] if spec.over and len(spec.over) == value.shape[-1] else str(list(at))
            raise InvalidValueError(
                "no structure has such a value",
                where=f"arguments.{name}: {element}",
                given=float(value[at]),
                allowed="above 0" if name in ABOVE_ZERO else "0 or more",
            )
