"""What rounding makes of velocities: positions x are held to eps |x|, which stiff members turn into forces.

A force that is off by mu eps |x| in a step, at random, drives a vibration of the frequency w to w eps |x| in
about one period, and on with the root of the number of steps. No tolerance of steps makes it smaller.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray

EPS = float(np.finfo(np.float64).eps)
SPREAD = 3.0  # measured: up to 1.5 times the root of the number of steps


@dataclass(frozen=True)
class Rounding:
    """The effect of rounding on a run.

    find_frequency: returns the fastest frequency [rad/s]; is_centre (n_coordinates,): coordinates that no
    force of a member depends on, see Manifest: far from the origin they are large, and make no vibration.
    """

    find_frequency: Callable[[], float]
    is_centre: NDArray[np.bool_]

    def least(self, run: RawTrajectory) -> float:
        """Return the error of velocities [m/s] that rounding leaves in any run."""
        return self.find_frequency() * EPS * self._largest(run)

    def noise(self, run: RawTrajectory) -> FloatArray:
        """Return what it comes to at most by the end of a run, [m] and [m/s]."""
        steps = SPREAD * np.sqrt(max(run.n_steps, 1))
        return np.asarray(
            steps * EPS * np.array([_farthest(run), self._largest(run) * self.find_frequency()])
        )

    def words(self, run: RawTrajectory, bound: float) -> str:
        """Return the words for a bound of velocities [m/s]."""
        rounded = EPS / 2 * self._largest(run)
        return (
            f"velocities may be wrong by up to {bound:.2g} m/s, since positions have rounding errors of "
            f"{rounded:.1g} m"
        )

    def _largest(self, run: RawTrajectory) -> float:
        """Return the largest coordinate that forces depend on."""
        n = run.state.shape[1] // 2
        return float(np.abs(run.state[:, :n][:, ~self.is_centre]).max(initial=0.0))


def _farthest(run: RawTrajectory) -> float:
    n = run.state.shape[1] // 2
    return float(np.abs(run.state[:, :n]).max(initial=0.0))
