"""The problem of a load path: equilibria g(q, lambda) = 0, and functions to watch along them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from tensegrity_codegen.system.arrays import FloatArray

# Motions that cost no force, as orthonormal columns (n, k), at coordinates q where the stiffness is K.
NeutralMotions = Callable[[FloatArray, Any], FloatArray]


class PathProblem(Protocol):
    """Equilibria g(q, lambda) = -dU/dq = 0 under a growing load; all values exact, none by differences.

    Any of the three may raise NonFiniteError: the step is then taken again, shorter.
    """

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return g, (n,)."""
        ...

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return K = -dg/dq, symmetric (n, n), dense or sparse."""
        ...

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return f = dg/dlambda, (n,)."""
        ...


@dataclass(frozen=True)
class Watch:
    """Functions of the configuration whose zeros are events of the path.

    falling, rising: kind of the event where a value falls or rises through zero; "" is no event. names: one
    for each value. values: (q, lambda) -> (len(names),), continuous. is_kink: the stiffness jumps there, so
    the path is cut and taken up anew. stops: falling through zero ends the path.
    """

    falling: str
    names: tuple[str, ...]
    values: Callable[[FloatArray, float], FloatArray]
    rising: str = ""
    is_kink: bool = False
    stops: bool = False
