"""Feedback gains along a motion, by the names of python-control."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.records.even_knots import choose_even_knots
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.extras import CONTROL, import_extra
from tensegrity_codegen.system.summaries import Summarised

MOST_KNOTS = 25  # of stored gains


@dataclass(frozen=True, eq=False, repr=False)
class Gains(Summarised):
    """Feedback gains along a motion: u = u_motion - K (x - x_motion), as of python-control's `dlqr`.

    The state x is (q, q'), then z, the sums of the outputs' errors: z[k+1] = z[k] + C (x[k] - x_motion[k]),
    then the commands on their way minus those of the motion, of each actuator the latest first.

    Attributes
    ----------
    time : ndarray, shape (n_t,) [s]
        Sample times, or knots among them; after the last one its gains hold.
    K : ndarray, shape (n_t, n_actuators, n_states + n_past)
        Gains; n_past commands are on their way where actuators have delays.
    S : ndarray, shape (n_t, n_states, n_states)
        Solutions of the Riccati recursion, of (x, z); the last one is the stationary solution.
    E : ndarray of complex, shape (n_states + n_past,)
        Eigenvalues of the closed loop at the end point.
    A, B : ndarray, shape (n_x, n_x) and (n_x, n_actuators)
        Sampled linear model at the end point, x = (q, q').
    integral_action : ndarray, shape (n_integrals, n_x)
        C.
    delay : ndarray, shape (n_actuators,) [s]
        Delays of the actuators that the gains predict.
    sample : float [s]
        Sample time.
    residual : float
        Residual of the stationary Riccati equation over the largest entry of its solution.
    actuators, state_name, integral_name : tuple of str
        Names of actuators, of the states (q, q'), and of the sums.
    """

    time: FloatArray
    K: FloatArray
    S: FloatArray
    E: NDArray[np.complex128]
    A: FloatArray
    B: FloatArray
    integral_action: FloatArray
    delay: FloatArray
    sample: float
    residual: float
    actuators: tuple[str, ...]
    state_name: tuple[str, ...]
    integral_name: tuple[str, ...]

    def __post_init__(self) -> None:
        freeze_fields(self)

    def at(self, step: int) -> FloatArray:
        """Return the gains of a sample, (n_actuators, n_states); after the motion those of its end.

        Between knots gains are interpolated linearly in time.
        """
        time = step * self.sample
        if len(self.K) == 1 or time >= self.time[-1]:
            last: FloatArray = self.K[-1]
            return last
        k = max(int(np.searchsorted(self.time, time, side="right")) - 1, 0)
        share = max(time - float(self.time[k]), 0.0) / float(self.time[k + 1] - self.time[k])
        found: FloatArray = (1.0 - share) * self.K[k] + share * self.K[k + 1]
        return found

    def at_knots(self, count: int = MOST_KNOTS) -> "Gains":
        """Return the gains of some of the sample times, between which they are interpolated.

        Parameters
        ----------
        count : int
            Largest number of knots; evenly distributed samples, the first and the last among them.

        Returns
        -------
        Gains
            The same design with fewer gains; all of them where there are no more than `count`.

        Raises
        ------
        InvalidValueError
            Fewer than two knots.
        """
        rows = choose_even_knots(len(self.time), count)
        if rows is None:
            return self
        return replace(self, time=self.time[rows], K=self.K[rows], S=self.S[rows])

    def state_space(self) -> Any:
        """Return the sampled linear model at the end point.

        Returns
        -------
        control.StateSpace
            x[k+1] = A x[k] + B u[k], y = x, of the deviations from the motion.

        Raises
        ------
        MissingExtraError
            python-control is not installed.
        """
        control = import_extra("control", CONTROL)
        n, m = self.B.shape
        return control.ss(
            self.A,
            self.B,
            np.eye(n),
            np.zeros((n, m)),
            self.sample,
            inputs=list(self.actuators),
            states=list(self.state_name),
            outputs=[f"{name} measured" for name in self.state_name],
        )
