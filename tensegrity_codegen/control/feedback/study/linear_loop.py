"""The linear closed loop at the end of a motion: stability, margins, covariance of its errors by noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from tensegrity_codegen.control.feedback.design.delays import hold_delayed, split_delays
from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.linear_samples import linearise
from tensegrity_codegen.control.feedback.kalman import linearise_estimate
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray

MOST_SAMPLES = 10  # of more delay that are tried
FACTORS = tuple(1.5**k for k in range(1, 7))  # of the actuators' effect that are tried
HALVINGS = 6


@dataclass(frozen=True)
class Margins:
    """What a linear loop stands before it becomes unstable.

    Attributes
    ----------
    is_stable : bool
        Whether the loop itself is stable.
    delay : float [s]
        Largest further delay of all actuators, infinite where ten samples more are not too many.
    gain : float
        Largest factor of the effect of all actuators, infinite where 11 is not too much.
    """

    is_stable: bool
    delay: float
    gain: float


@dataclass(frozen=True, eq=False)
class LinearLoop:
    """A linear closed loop about the end of a motion.

    Attributes
    ----------
    rate, gain : ndarray, shape (n_x, n_x) and (n_x, n_actuators)
        x' = rate x + gain u, x = (q, q').
    gains : Gains
        Feedback, of which the last gains count.
    delay : ndarray, shape (n_actuators,) [s]
        Delays of the actuators, which an estimator knows.
    estimate_rate, slope, correction : ndarray, shape (n_e, n_e), (n_y, n_e) and (n_e, n_y)
        Model, measurements and last gains of an estimator; n_e = 0 without one.
    noise : ndarray, shape (n_y,)
        Standard deviations of the measurements.
    """

    rate: FloatArray
    gain: FloatArray
    gains: Gains
    delay: FloatArray
    estimate_rate: FloatArray
    slope: FloatArray
    correction: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        freeze_fields(self)

    def step(self, more_delay: float = 0.0, factor: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Return the transition of one sample, and the effect of the noise of its measurements.

        Parameters
        ----------
        more_delay : float [s]
            Of all actuators, which neither gains nor estimator know.
        factor : float
            Of the effect of all actuators, likewise.

        Returns
        -------
        F, G : ndarray, shape (n, n) and (n, n_y)
            s[k+1] = F s[k] + G v[k], s: state x, commands on their way, predicted estimate, sums of errors.
        """
        sample, n, m = self.gains.sample, len(self.rate), len(self.delay)
        n_e, n_z, late = len(self.estimate_rate), len(self.gains.integral_action), self.delay + more_delay
        counts = [split_delays(delay, sample)[2] for delay in (late, self.delay, self.gains.delay)]
        depth = int(max(count.max(initial=0) for count in counts))
        sizes = np.cumsum([n, m * depth, n_e, n_z, len(self.noise)])
        # Each quantity is a matrix of its derivatives by all states and the noise.
        x, past, expected, sums, noise = np.split(np.eye(sizes[-1]), sizes[:-1])
        known = x
        if n_e:
            known = expected + self.correction @ (self.slope[:, :n] @ x + noise - self.slope @ expected)
        gains = self.gains.K[-1]
        command = -gains[:, :n] @ known[:n] - gains[:, n : n + n_z] @ sums
        command -= _by_depth(gains[:, n + n_z :], counts[2], depth) @ past
        a, b, p = hold_delayed(self.rate, self.gain, sample, late)
        rows = [a @ x + factor * (b @ command + _by_depth(p, counts[0], depth) @ past)]
        for u in range(m if depth else 0):
            rows += [command[u : u + 1], past[u * depth : (u + 1) * depth - 1]]
        if n_e:
            gain = np.vstack([self.gain, np.zeros((n_e - n, m))])
            a, b, p = hold_delayed(self.estimate_rate, gain, sample, self.delay)
            rows.append(a @ known + b @ command + _by_depth(p, counts[1], depth) @ past)
        whole = np.vstack([*rows, sums + self.gains.integral_action @ known[:n]])
        return whole[:, : sizes[-2]], whole[:, sizes[-2] :]

    def radius(self, more_delay: float = 0.0, factor: float = 1.0) -> float:
        """Return the largest modulus of an eigenvalue of the transition, below 1 for a stable loop."""
        return float(np.abs(np.linalg.eigvals(self.step(more_delay, factor)[0])).max(initial=0.0))

    def deviation(self) -> FloatArray:
        """Return the standard deviation that noise gives each coordinate, (n_x / 2,); infinite if unstable.

        The covariance P of a stable loop satisfies Lyapunov's equation P = F P F^T + G V G^T.
        """
        n = len(self.rate) // 2
        if not self.radius() < 1.0:
            return np.full(n, np.inf)
        f, g = self.step()
        covariance = solve_discrete_lyapunov(f, (g * self.noise**2) @ g.T)
        return np.sqrt(np.maximum(np.diag(covariance)[:n], 0.0))


def build_linear_loop(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    delay: FloatArray,
    estimator: Estimator | None,
    arguments: Mapping[str, Any],
) -> LinearLoop:
    """Return the linear loop at the end of a motion.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``.
    motion : Motion
        The motion.
    gains : Gains
        Feedback.
    delay : ndarray, shape (n_actuators,) [s]
        Delays of the actuators.
    estimator : Estimator or None
        None: feedback of the true state.
    arguments : mapping
        Run-time parameters where they differ from the scene; inputs as one array.

    Returns
    -------
    LinearLoop
        The loop.
    """
    rate, gain = linearise(model, motion, motion.duration, gains.actuators, arguments)
    estimate, slope, correction, noise = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
    if estimator is not None:
        estimate, slope = linearise_estimate(
            model, motion, motion.duration, arguments, estimator.sensing, estimator.disturbed
        )
        correction, noise = estimator.L[-1], estimator.sensing.noise
    return LinearLoop(rate, gain, gains, delay, estimate, slope, correction, noise)


def find_margins(loop: LinearLoop) -> Margins:
    """Return by how much more delay and effect of the actuators a loop becomes unstable, to about 1 %."""
    if not loop.radius() < 1.0:
        return Margins(is_stable=False, delay=0.0, gain=1.0)
    sample = loop.gains.sample
    delays = [sample * count for count in range(1, MOST_SAMPLES + 1)]
    return Margins(
        is_stable=True,
        delay=_find_first(lambda more: loop.radius(more_delay=more), 0.0, delays),
        gain=_find_first(lambda factor: loop.radius(factor=factor), 1.0, FACTORS),
    )


def _find_first(radius: Callable[[float], float], stable: float, values: Sequence[float]) -> float:
    """Return the largest value below which loops are stable, infinite where all values are."""
    for value in values:
        if radius(value) < 1.0:
            stable = value
            continue
        above = value
        for _ in range(HALVINGS):
            middle = 0.5 * (stable + above)
            stable, above = (middle, above) if radius(middle) < 1.0 else (stable, middle)
        return stable
    return float("inf")


def _by_depth(columns: FloatArray, count: NDArray[np.int64], depth: int) -> FloatArray:
    """Return columns of so many commands of each actuator among those of `depth` commands of each."""
    found = np.zeros((len(columns), len(count), depth))
    place = np.arange(depth) < count[:, None]
    found[:, place] = columns
    return found.reshape(len(columns), -1)
