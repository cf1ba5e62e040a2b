"""One axis of a grid: a key of the scene, and the values that it takes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of a grid.

    Attributes
    ----------
    key : str
        Path of the number in the scene, as ``"classes.cable.spring_constant"``.
    values : ndarray, shape (n_values,)
        Its values, in order; read-only.
    """

    key: str
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.float64).reshape(-1)
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.values)
