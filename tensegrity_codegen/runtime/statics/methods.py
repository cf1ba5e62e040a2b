"""Names of the methods that find an equilibrium, and how far they have come."""

from collections.abc import Callable
from typing import Literal, get_args

from tensegrity_codegen.system.progress import SETTLING, describe_pass

Method = Literal["auto", "newton", "relaxation"]
METHODS: tuple[str, ...] = get_args(Method)

Progress = Callable[[int, float], None]


def follow_residual(also: Progress | None) -> Progress:
    """Return the progress function of a search, which says at which iteration it is, and how far off.

    Parameters
    ----------
    also : callable, optional
        Called with the iteration and the largest node residual [N].

    Returns
    -------
    callable
        To be called with the iteration and the largest node residual [N].
    """

    def progress(iteration: int, residual: float) -> None:
        if also is not None:
            also(iteration, residual)
        describe_pass(f"{SETTLING}: iteration {iteration:,}, residual {residual:.3g} N")

    return progress
