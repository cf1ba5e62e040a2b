"""The linear closed loop at the end of a motion: stability, covariance of its errors by noise."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    compute_delayed_hold,
    linearise,
    split_delays,
)
from tensegrity_codegen.control.feedback.kalman import (
    DISTURBED_PART,
    MOST_KNOTS,
    design_kalman,
    find_usual_forces,
    linearise_estimate,
)
from tensegrity_codegen.control.feedback.study.stated_errors import find_default_times
from tensegrity_codegen.control.feedback.study.tuning import Scales
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray

MOST_ERROR = 0.005  # of the size of the structure: standard deviation of a displacement that is predicted
ERROR_MARGIN = 4.0  # where this is exceeded: by which the deviation is to be smaller, for errors beside noise
MOST_REDUCTIONS = 3
WORTHWHILE_PART = 0.8  # of the displacements by noise in the loop: less left is worth a slower estimate
SETTLING_CONSTANTS = 5.0  # time constants of the estimate, up to the time from which errors are compared


@dataclass(frozen=True, eq=False)
class LinearLoop:
    """A linear closed loop about the end of a motion.

    state_matrix, input_matrix (n_x, n_x) and (n_x, n_actuators): x' = state_matrix x + input_matrix u,
        x = (q, q').
    gains: feedback, of which the last gains count.
    delay (n_actuators,) [s]: delays of the actuators, which an estimator knows.
    estimate_rate, slope, correction (n_e, n_e), (n_y, n_e) and (n_e, n_y): model, measurements and last
        gains of an estimator; n_e = 0 without one.
    noise (n_y,): standard deviations of the measurements.
    """

    state_matrix: FloatArray
    input_matrix: FloatArray
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

        more_delay [s]: of all actuators, which neither gains nor estimator know.
        factor: of the effect of all actuators, likewise.
        Returns F, G (n, n) and (n, n_y): s[k+1] = F s[k] + G v[k], s: state x, commands on their way,
            predicted estimate, sums of errors.
        """
        whole, size, _, _ = self._build(more_delay, factor)
        return whole[:, :size], whole[:, size:]

    def open_at_inputs(self) -> tuple[FloatArray, list[FloatArray], FloatArray]:
        """Return the loop with another input d [m] beside the commands of the actuators.

        Returns F, D, C: s[k+1] = F s[k] + D[0] d[k] + D[1] d[k-1] + ..., with the commands C s, F (n, n),
            D each (n, m) and C (m, n); the plant receives C s + d. The sensitivity at its inputs is
            1 + C (z - F)^-1 (D[0] + D[1] / z + ...).
        """
        whole, size, command, push = self._build(0.0, 1.0)
        rest = np.zeros((size - len(push[0]), len(self.delay)))
        return whole[:, :size], [np.vstack([part, rest]) for part in push], command[:, :size]

    def _build(
        self, more_delay: float, factor: float
    ) -> tuple[FloatArray, int, FloatArray, list[FloatArray]]:
        """Return derivatives by states and noise of the next states, their number, those of the commands.

        And the effect of the commands on x in the sample that begins with them, and in each later one.
        """
        sample, n, m = self.gains.sample, len(self.state_matrix), len(self.delay)
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
        a, b, p = compute_delayed_hold(self.state_matrix, self.input_matrix, sample, late)
        late_push = _by_depth(p, counts[0], depth)
        rows = [a @ x + factor * (b @ command + late_push @ past)]
        push = [b, *(late_push[:, k::depth] for k in range(depth))]
        for u in range(m if depth else 0):
            rows += [command[u : u + 1], past[u * depth : (u + 1) * depth - 1]]
        if n_e:
            padded = np.vstack([self.input_matrix, np.zeros((n_e - n, m))])
            a, b, p = compute_delayed_hold(self.estimate_rate, padded, sample, self.delay)
            rows.append(a @ known + b @ command + _by_depth(p, counts[1], depth) @ past)
        whole = np.vstack([*rows, sums + self.gains.integral_action @ known[:n]])
        return whole, int(sizes[-2]), command, push

    def radius(self, more_delay: float = 0.0, factor: float = 1.0) -> float:
        """Return the largest modulus of an eigenvalue of the transition, below 1 for a stable loop."""
        return float(np.abs(np.linalg.eigvals(self.step(more_delay, factor)[0])).max(initial=0.0))

    def covariance(self) -> FloatArray:
        """Return the covariance that noise gives the coordinates, (n_x / 2, n_x / 2); infinite if unstable.

        The covariance P of a stable loop satisfies Lyapunov's equation P = F P F^T + G V G^T.
        """
        n = len(self.state_matrix) // 2
        if not self.radius() < 1.0:
            return np.full((n, n), np.inf)
        f, g = self.step()
        covariance = np.asarray(solve_discrete_lyapunov(f, (g * self.noise**2) @ g.T), dtype=np.float64)
        return covariance[:n, :n]

    def deviation(self) -> FloatArray:
        """Return the standard deviation that noise gives each coordinate, (n_x / 2,); or infinity."""
        return np.sqrt(np.maximum(np.diag(self.covariance()), 0.0))


def build_linear_loop(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    delay: FloatArray,
    estimator: Estimator | None,
    arguments: Mapping[str, Any],
) -> LinearLoop:
    """Return the linear loop at the end of a motion.

    model: compiled for ``"control"``.
    gains: feedback.
    delay (n_actuators,) [s]: delays of the actuators.
    estimator: None: feedback of the true state.
    arguments: run-time parameters where they differ from the scene; inputs as one array.
    """
    state_matrix, input_matrix = linearise(model, motion, motion.duration, gains.actuators, arguments)
    estimate, slope, correction, noise = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
    if estimator is not None:
        estimate, slope = linearise_estimate(
            model, motion, motion.duration, arguments, estimator.sensing, estimator.disturbed
        )
        correction, noise = estimator.L[-1], estimator.sensing.noise
    return LinearLoop(state_matrix, input_matrix, gains, delay, estimate, slope, correction, noise)


def _by_depth(columns: FloatArray, count: NDArray[np.int64], depth: int) -> FloatArray:
    """Return columns of so many commands of each actuator among those of `depth` commands of each."""
    found = np.zeros((len(columns), len(count), depth))
    place = np.arange(depth) < count[:, None]
    found[:, place] = columns
    return found.reshape(len(columns), -1)


# Estimators whose disturbance forces are as large as noise of the sensors permits.


def design_slow_estimator(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    scales: Scales,
    *,
    only_observable: bool = False,
    arguments: Mapping[str, Any] | None = None,
) -> tuple[Estimator, str | None]:
    """Return an estimator with the largest disturbance forces that noise permits, and a warning.

    Disturbances are those of `design_kalman` by default, with which the filter may predict errors of
    displacements up to 1/200 of the size; else they are divided by 10 until these are below 1/800: where few
    sensors share many disturbance forces, the filter lets noise move the estimate so far that the model is
    not linear any more. They are divided by 10 further where noise then moves the nodes of the linear loop
    by a fifth less at least (Lyapunov's equation), if the estimate still settles before errors are compared;
    three times at most in all. The warning is None where they are the default.
    """
    given = merge_inputs(model.manifest, arguments)
    usual = DISTURBED_PART * find_usual_forces(model, motion, given)
    settling = find_default_times(motion)[1] / SETTLING_CONSTANTS

    def design(count: int, knots: int = MOST_KNOTS) -> Estimator:
        return design_kalman(
            model, motion, sample=gains.sample, disturbance=usual / 10.0**count if count else None,
            only_observable=only_observable, knots=knots if motion.velocity.any() else 2,
            arguments=arguments,
        )  # fmt: skip

    def move(estimator: Estimator) -> float:
        """Return by how much noise moves the nodes of the loop [m], infinite where it settles too late."""
        loop = build_linear_loop(model, motion, gains, gains.delay, estimator, given)
        is_slow = np.abs(estimator.E).max() > np.exp(-gains.sample / settling)
        return np.inf if is_slow else float((loop.deviation() * scales.lever).max(initial=0.0))

    # Smaller forces while noise moves the estimate too far, or the loop by a fifth less.
    found = [design(0)]
    first, most = predict_displacement(found[0], scales), MOST_ERROR * scales.size
    bound = most if first <= most else most / ERROR_MARGIN
    while len(found) <= MOST_REDUCTIONS:
        count = len(found)
        is_loud = predict_displacement(found[-1], scales) > bound
        if not is_loud and not move(design(count, 2)) < WORTHWHILE_PART * move(found[-1]):
            break
        found.append(design(count))
    if len(found) == 1:
        return found[0], None
    # What changed, in words.
    divisor = 10 ** (len(found) - 1)
    before, after = (predict_displacement(item, scales) for item in (found[0], found[-1]))
    reason = f"more than {_show_length(most)}"
    if first <= most:
        before, after = move(found[0]), move(found[-1])
        reason = "in the linear loop"
    return found[-1], (
        "estimator: with disturbance forces of the default size, noise would move its nodes by "
        f"{_show_length(before)} (predicted standard deviation), {reason}. "
        f"Divided by {divisor:,}, to at most {usual.max() / divisor:.3g} N or N m in 1 s, "
        f"by {_show_length(after)}. More sensors permit larger forces; `disturbance` states others"
    )


def predict_displacement(estimator: Estimator, scales: Scales) -> float:
    """Return the largest standard deviation of a node's displacement that the filter predicts [m].

    Each coordinate alone: the root of its variance, times the most that its unit moves a node.
    """
    n = len(scales.lever)
    variance = np.diagonal(estimator.P, axis1=1, axis2=2)[:, :n]
    return float((np.sqrt(np.maximum(variance, 0.0)) * scales.lever).max(initial=0.0))


def _show_length(length: float) -> str:
    return f"{1000 * length:.3g} mm"
