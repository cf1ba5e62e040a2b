"""Redundant coordinates: is a state one that nodes can be in?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.runtime.interface import Model

__all__ = ["check_consistent"]

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-9  # of the largest entry


def check_consistent(model: Model, coordinate: FloatArray, velocity: FloatArray) -> None:
    """Raise InvalidValueError if coordinates or velocities (n_coordinates,) contradict each other.

    A model without constraints between its coordinates has nothing to check.
    """
    for name, value in (("coordinate", coordinate), ("velocity", velocity)):
        quantity = f"consistent_{name}"
        if not model.has(quantity):
            continue
        consistent = model.compute(quantity, **{name: value})
        apart = np.abs(consistent - value)
        worst = int(np.argmax(apart))
        if apart[worst] > TOLERANCE * np.max(np.abs(value)):
            raise InvalidValueError(
                f"the initial {name} is none that nodes can have: the differences around a cycle of pairs do "
                "not add up",
                where=f"simulate: {model.manifest.coordinate_name[worst]}",
                given=float(value[worst]),
                allowed=f"{consistent[worst]:.9g}, the sum of the others on its cycle",
                hint="start from differences of node positions",
            )
