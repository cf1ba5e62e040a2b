"""The record of an estimator: gains at knots along a motion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.sensing import Sensing
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import Summarised


@dataclass(frozen=True, eq=False, repr=False)
class Estimator(Summarised):
    """An extended Kalman filter with gains stored at knots along a motion.

    The state is (q, q', d), d the disturbance forces on some coordinates. At each sample the prediction p of
    the full model is corrected by the measurements y: p + L (y - h(p)).

    Attributes
    ----------
    time : ndarray, shape (n_knots,) [s]
        Times of the knots; gains in between are interpolated, after the last one its gains hold.
    L : ndarray, shape (n_knots, n_states, n_y)
        Gains. A L is the gain of python-control's `dlqe`, with A the transition of the state.
    P : ndarray, shape (n_knots, n_states, n_states)
        Stationary covariances of the predictions.
    innovation : ndarray, shape (n_knots, n_y)
        Standard deviations of measurements minus their predictions.
    E : ndarray of complex, shape (n_states,)
        Eigenvalues of the error at the end point, from sample to sample.
    sample : float [s]
        Time between two measurements.
    residual : float
        Largest residual of the stationary Riccati equations over the largest entry of their solutions.
    substeps : int
        Runge-Kutta steps of the prediction in a sample.
    disturbed : ndarray of int, shape (n_disturbances,)
        Indices of the coordinates that have a disturbance force.
    sensing : Sensing
        What is measured, with names and noise.
    state_name : tuple of str
        Names of the states.
    """

    time: FloatArray
    L: FloatArray
    P: FloatArray
    innovation: FloatArray
    E: NDArray[np.complex128]
    sample: float
    residual: float
    substeps: int
    disturbed: NDArray[np.int64]
    sensing: Sensing
    state_name: tuple[str, ...]

    def __post_init__(self) -> None:
        freeze_fields(self)

    def at(self, time: float) -> FloatArray:
        """Return the gains at a time [s], (n_states, n_y)."""
        return self._between(self.L, time)

    def weight(self, time: float) -> FloatArray:
        """Return 1 over the standard deviations of measurements minus predictions at a time [s], (n_y,)."""
        return self._between(1.0 / self.innovation, time)

    def _between(self, rows: FloatArray, time: float) -> FloatArray:
        if len(self.time) == 1 or time >= self.time[-1]:
            last: FloatArray = rows[-1]
            return last
        k = max(int(np.searchsorted(self.time, time, side="right")) - 1, 0)
        share = max(time - float(self.time[k]), 0.0) / float(self.time[k + 1] - self.time[k])
        found: FloatArray = (1.0 - share) * rows[k] + share * rows[k + 1]
        return found
