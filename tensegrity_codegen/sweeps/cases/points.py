"""Points that are no grid: what samples and tables have in common."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Points(Protocol):
    """Rows of values of some keys, computed on demand."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Paths of the numbers in the scene."""
        ...

    @property
    def count(self) -> int:
        """Number of rows."""
        ...

    @property
    def method(self) -> str:
        """One of ``"random"``, ``"latin_hypercube"``, ``"sobol"``, ``"saltelli"``, ``"table"``."""
        ...

    @property
    def seed(self) -> int | None:
        """Seed of a sample; None for a table."""
        ...

    def values(self, first: int, last: int) -> NDArray[np.float64]:
        """Return rows first to last - 1, (last - first, n_keys): the same however they are divided."""
        ...

    def describe(self) -> dict[str, Any]:
        """Return all that the rows follow from, as plain values."""
        ...
