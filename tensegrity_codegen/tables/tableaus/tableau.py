"""The record of one explicit Runge-Kutta method."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

Row = Mapping[int, float]


@dataclass(frozen=True)
class Tableau:
    """One explicit Runge-Kutta method: coefficients, error estimates, dense output, and its properties.

    title, source: the name of the method, and the source of its coefficients.
    order: order of the step.
    rows: row i gives the state x + h sum_j row[j] k_j whose derivative is k_(i+1); k_0 is the derivative at
        the start of the step. The last row is the step itself: its derivative is the first of the next step.
    errors: up to two error estimates, coefficients of k_j. With two of them, e5 and e3, the error is h e5^2 /
        sqrt(e5^2 + e3^2 / 100). With none, steps have a fixed length.
    error_order: power of h with which the estimate goes.
    dense_order: order of dense output; 5 is that of quintic Hermite interpolation.
    dense_rows: further stages, for dense output alone.
    dense: coefficients d of the highest terms of dense output, see below; none: quintic Hermite
        interpolation.
    noise_share: part of the rounding noise of velocities that shows in the error estimate of a step.
    vibration_loss: c and p: a step of length h changes a vibration of angular frequency w by about c (h w)^p,
        for h w of 1 to 4, within a factor of 3 (stability polynomial on the imaginary axis).

    Dense output at fraction s of the step, with r = 1 - s (Hairer, Norsett, Wanner 1993, II.6):
    x + s (D0 + r (D1 + s (D2 + r (D3 + ...)))), D0 the change of the state, D1 = h k_0 - D0,
    D2 = 2 D0 - h (k_0 + k_end), and D3 on h sum_j d[j] k_j for each row d of `dense`.
    """

    title: str
    source: str
    order: int
    rows: tuple[Row, ...]
    errors: tuple[Row, ...] = ()
    error_order: int = 0
    dense_order: int = 5
    dense_rows: tuple[Row, ...] = ()
    dense: tuple[Row, ...] = ()
    noise_share: float = 0.0
    vibration_loss: tuple[float, int] = (0.0, 0)

    @property
    def nodes(self) -> tuple[float, ...]:
        """Time of the state of each row, over the step."""
        return tuple(round(math.fsum(row.values()), 15) for row in self.rows)

    @property
    def dense_nodes(self) -> tuple[float, ...]:
        """Time of the state of each row of `dense_rows`, over the step."""
        return tuple(round(math.fsum(row.values()), 15) for row in self.dense_rows)

    @property
    def stages(self) -> int:
        """Number of evaluations that a step takes."""
        return len(self.rows)

    @property
    def ends_late(self) -> bool:
        """Whether the error estimates do without the derivative at the end: rejected steps spare it."""
        return not any(self.stages in row for row in self.errors)

    @property
    def rates(self) -> int:
        """Number of derivatives that are kept, those for dense output too."""
        return 1 + len(self.rows) + len(self.dense_rows)
