"""The estimator at work: predictions of the full model, corrected by measurements."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray

GATE = 6.0  # standard deviations, up to which measurements may differ from their predictions
START, DECAY = 100.0, 0.7  # of the recent largest difference, which is not known at the start
DOUBLINGS = 30  # of what is accepted after outliers, at most


class Filter:
    """An estimator that runs from the start of a motion on.

    Parameters
    ----------
    model : CompiledModel
        The model that the estimator knows.
    estimator : Estimator
        Its gains.
    motion : Motion
        Whose start is the first prediction, without disturbances.
    arguments : mapping
        Run-time parameters where they differ from the scene.

    Attributes
    ----------
    is_outlier : bool
        Whether the last measurements were too far from their predictions, and were not used: further than six
        standard deviations, or twice what was accepted lately, or twice as far again after each outlier.
    """

    def __init__(
        self, model: CompiledModel, estimator: Estimator, motion: Motion, arguments: Mapping[str, Any]
    ) -> None:
        self.model, self.estimator, self.arguments = model, estimator, dict(arguments)
        start = motion.at(0.0)
        self.n = len(start.coordinate)
        self.state = np.concatenate([start.coordinate, start.velocity, np.zeros(len(estimator.disturbed))])
        self.is_outlier, self.n_outliers, self.innovation = False, 0, START

    @property
    def disturbance(self) -> FloatArray:
        """Estimated disturbance force on each coordinate, (n_coordinates,)."""
        found = np.zeros(self.n)
        found[self.estimator.disturbed] = self.state[2 * self.n :]
        return found

    def correct(self, time: float, measured: FloatArray, value: FloatArray) -> FloatArray:
        """Return the state (q, q') after a measurement, of which outliers are not used.

        Parameters
        ----------
        time : float [s]
            Time of the measurement.
        measured : ndarray, shape (n_y,)
            Measured numbers.
        value : ndarray, shape (n_inputs,)
            Inputs of the model then.
        """
        off = measured - self.estimator.sensing.measure(self._at(self.state, value))
        most = float(np.abs(off * self.estimator.weight(time)).max(initial=0.0))
        self.is_outlier = most > max(GATE, 2.0 * self.innovation) * 2.0**self.n_outliers
        if self.is_outlier:
            self.n_outliers = min(self.n_outliers + 1, DOUBLINGS)
        else:
            self.innovation, self.n_outliers = max(most, DECAY * self.innovation), 0
            self.state = self.state + self.estimator.at(time) @ off
        return self.state[: 2 * self.n].copy()

    def predict(self, span: float, value: FloatArray) -> None:
        """Move the state over a time span [s] with inputs (n_inputs,), by Runge-Kutta steps of order 4."""
        share = span / self.estimator.sample
        count = max(1, int(np.ceil(self.estimator.substeps * share - 1e-9)))
        step, x = span / count, self.state[: 2 * self.n]
        for _ in range(count):
            mass = self.model.compute("mass_matrix", **self._at(x, value))
            dense = mass.toarray() if hasattr(mass, "toarray") else np.asarray(mass)
            push = np.linalg.solve(dense, self.disturbance)
            k1 = self._rate(x, value, push)
            k2 = self._rate(x + 0.5 * step * k1, value, push)
            k3 = self._rate(x + 0.5 * step * k2, value, push)
            k4 = self._rate(x + step * k3, value, push)
            x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        self.state = np.concatenate([x, self.state[2 * self.n :]])

    def _rate(self, x: FloatArray, value: FloatArray, push: FloatArray) -> FloatArray:
        moved = np.asarray(self.model.compute("acceleration", **self._at(x, value)))
        return np.concatenate([x[self.n :], moved + push])

    def _at(self, state: FloatArray, value: FloatArray) -> dict[str, Any]:
        n = self.n
        return {
            **self.arguments,
            "coordinate": state[:n].copy(),
            "velocity": state[n : 2 * n].copy(),
            INPUT: value,
        }
