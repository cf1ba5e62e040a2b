"""Names of the methods that find an equilibrium, and how far they have come."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, get_args

__all__ = ["METHODS", "Method", "follow_residual"]

Method = Literal["auto", "newton", "relaxation"]
METHODS: tuple[str, ...] = get_args(Method)

Progress = Callable[[int, float], None]


def follow_residual(move: Callable[[float], None], tolerance: float, also: Progress | None) -> Progress:
    """Return the progress function of a search.

    Parameters
    ----------
    move : callable
        Called with the fraction of the search that is done, 0 to 1: the decades by which the residual has
        fallen, of those from the first residual to `tolerance` times it.
    tolerance : float
        Of the search.
    also : callable, optional
        Called with the iteration and the largest node residual [N].

    Returns
    -------
    callable
        To be called with the iteration and the largest node residual [N].
    """
    first: list[float] = []
    decades = -math.log(max(min(tolerance, 0.1), 1e-16))

    def progress(iteration: int, residual: float) -> None:
        if also is not None:
            also(iteration, residual)
        if not residual > 0.0 or math.isinf(residual):
            return
        first[:] = first or [residual]
        move(max(math.log(first[0] / residual) / decades, 0.0))

    return progress
