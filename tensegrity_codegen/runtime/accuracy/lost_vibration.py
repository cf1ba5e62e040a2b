"""Fast vibrations that steps of an explicit method take away unseen: loose runs lose them alike, and agree.

A step over an angle a = w h of a vibration changes its size and phase by a part e(a). Each step may keep the
tolerance while all of them together take the vibration away, in a run and in one that is compared with it.
How large it is shows in a short run with tight steps from the same start.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.tableaus import TABLEAUS

KEPT = 0.01  # change of the whole vibration, from which on two runs may agree on it
DOUBTED = 3.0  # times that change: steps are not all of the same length
SPACING = 2.0  # rad of the fastest vibration between the samples of the short run
COUNT = 26  # of these samples
SHARPER = 1e-2  # tolerance of its steps


@dataclass(frozen=True)
class LostVibration:
    """What runs of a motion lose.

    find_frequency: returns the fastest frequency [rad/s]; integrate: does one run; tableau: name of the
    explicit method whose steps lose as much.
    """

    motion: Motion
    options: RunOptions
    find_frequency: Callable[[], float]
    integrate: Callable[[Motion, RunOptions], RawTrajectory]
    tableau: str

    def estimate(self, run: RawTrajectory, tolerance: Tolerance) -> float:
        """Return the error over the tolerance by vibrations that a run has lost, 0 where it shows them."""
        frequency, last = self.find_frequency(), float(run.time[-1])
        factor, power = TABLEAUS[self.tableau].vibration_loss
        angle = frequency * last / max(run.n_steps, 1)
        changed = run.n_steps * factor * angle**power
        if changed <= KEPT:
            return 0.0
        speed = min(2.0, DOUBTED * changed) * self._amplitude(frequency, last, tolerance)
        allowed = tolerance.allowed(run.state[1:])
        return float(np.max(np.concatenate([speed / frequency, speed]) / allowed, initial=0.0))

    def _amplitude(self, frequency: float, last: float, tolerance: Tolerance) -> FloatArray:
        """Return the speed [m/s] with which each node vibrates at the start, (n_groups,)."""
        times = np.linspace(0.0, min(last, (COUNT - 1) * SPACING / frequency), COUNT)
        motion = replace(self.motion, sample_time=times, progress=None, watch=Watch())
        rtol, atol = (SHARPER * value for value in (self.options.rtol, self.options.absolute))
        run = self.integrate(motion, self.options.within(rtol, atol))
        found = np.zeros(len(tolerance.first))
        for lag in (1, 2):  # second differences of a vibration, 2 (1 - cos) times its size
            if len(run.state) > 2 * lag:
                state = run.state
                bend = state[2 * lag :] - 2.0 * state[lag:-lag] + state[: -2 * lag]
                speeds = tolerance.lengths(bend)[:, len(tolerance.first) :]
                found = np.maximum(found, speeds.max(axis=0) / 2.0)
        return found
