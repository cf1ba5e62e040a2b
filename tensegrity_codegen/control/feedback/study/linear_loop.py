"""The linear closed loop at the end of a motion: stability, margins, covariance of its errors by noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur, solve_discrete_lyapunov, solve_triangular

from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    compute_delayed_hold,
    linearise,
    split_delays,
)
from tensegrity_codegen.control.feedback.kalman import (
    DISTURBED_PART,
    MAX_KNOTS,
    design_kalman,
    find_usual_forces,
    linearise_estimate,
)
from tensegrity_codegen.control.feedback.study.stated_errors import find_default_times
from tensegrity_codegen.control.feedback.study.tuning import Scales
from tensegrity_codegen.runtime.model.arguments import merge_inputs
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray

MAX_ERROR = 0.005  # of the size of the structure: standard deviation of a displacement that is predicted
ERROR_MARGIN = 4.0  # where this is exceeded: by which the deviation is to be smaller, for errors beside noise
MAX_REDUCTIONS = 3
WORTHWHILE_PART = 0.8  # of the displacements by noise in the loop: less left is worth a slower estimate
SETTLING_CONSTANTS = 5.0  # time constants of the estimate, up to the time from which errors are compared

MAX_SAMPLES = 10  # of more delay that are tried
FACTORS = tuple(1.5**k for k in range(1, 7))  # of the actuators' effect that are tried
STIFFNESS_PARTS = (0.02, 0.04, 0.06, 0.08, 0.1)  # by which all stiffnesses are off that are tried
HALVINGS = 6
FREQUENCIES = 200  # at which a loop is looked at, besides those of its eigenvalues
LOWEST = 1e-4  # of the highest frequency
OFFSETS = (-1.0, -0.5, 0.0, 0.5, 1.0)  # frequencies about an eigenvalue's, in multiples of its decay
REFINED = 21  # frequencies between the neighbours of the worst one
STEP = 1e-6  # of differences; coordinates are lengths of structures of a metre, or angles


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
        """Return F, G of s[k+1] = F s[k] + G v[k]: the transition of a sample, the effect of its noise."""
        # s: state, commands on their way, predicted estimate, sums of errors. Neither gains nor estimator
        # know `more_delay` [s] and `factor` of all actuators.
        derivatives, size, _, _ = self._build(more_delay, factor)
        return derivatives[:, :size], derivatives[:, size:]

    def open_at_inputs(self) -> tuple[FloatArray, list[FloatArray], FloatArray]:
        """Return the loop with another input d [m] beside the commands of the actuators.

        Returns F, D, C: s[k+1] = F s[k] + D[0] d[k] + D[1] d[k-1] + ..., with the commands C s, F (n, n),
            D each (n, m) and C (m, n); the plant receives C s + d. The sensitivity at its inputs is
            1 + C (z - F)^-1 (D[0] + D[1] / z + ...).
        """
        derivatives, size, command, push = self._build(0.0, 1.0)
        zeros = np.zeros((size - len(push[0]), len(self.delay)))
        return derivatives[:, :size], [np.vstack([effect, zeros]) for effect in push], command[:, :size]

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
        estimate = x
        if n_e:
            estimate = expected + self.correction @ (self.slope[:, :n] @ x + noise - self.slope @ expected)
        gains = self.gains.K[-1]
        command = -gains[:, :n] @ estimate[:n] - gains[:, n : n + n_z] @ sums
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
            rows.append(a @ estimate + b @ command + _by_depth(p, counts[1], depth) @ past)
        derivatives = np.vstack([*rows, sums + self.gains.integral_action @ estimate[:n]])
        return derivatives, int(sizes[-2]), command, push

    def radius(self, more_delay: float = 0.0, factor: float = 1.0) -> float:
        """Return the largest modulus of an eigenvalue of the transition, below 1 for a stable loop."""
        return float(np.abs(np.linalg.eigvals(self.step(more_delay, factor)[0])).max(initial=0.0))

    def with_stiffness(self, factor: float) -> "LinearLoop":
        """Return the loop whose forces by displacements are larger by a factor, unknown to the controller."""
        n, matrix = len(self.state_matrix) // 2, self.state_matrix.copy()
        matrix[n:, :n] *= factor
        return replace(self, state_matrix=matrix)

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
    """Return the linear loop at the end of a motion."""
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
    columns_by_depth = np.zeros((len(columns), len(count), depth))
    is_used = np.arange(depth) < count[:, None]
    columns_by_depth[:, is_used] = columns
    return columns_by_depth.reshape(len(columns), -1)


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
    three times at most in all. The warning is None if they are the default.
    """
    parameters = merge_inputs(model.manifest, arguments)
    usual = DISTURBED_PART * find_usual_forces(model, motion, parameters)
    settling = find_default_times(motion)[1] / SETTLING_CONSTANTS

    def design(count: int, knots: int = MAX_KNOTS) -> Estimator:
        return design_kalman(
            model, motion, sample=gains.sample, disturbance=usual / 10.0**count if count else None,
            only_observable=only_observable, knots=knots if motion.velocity.any() else 2,
            arguments=arguments,
        )  # fmt: skip

    def move(estimator: Estimator) -> float:
        """Return by how much noise moves the nodes of the loop [m], infinite if it settles too late."""
        loop = build_linear_loop(model, motion, gains, gains.delay, estimator, parameters)
        is_slow = np.abs(estimator.E).max() > np.exp(-gains.sample / settling)
        return np.inf if is_slow else float((loop.deviation() * scales.lever).max(initial=0.0))

    # Smaller forces while noise moves the estimate too far, or the loop by a fifth less.
    designs = [design(0)]
    default_displacement, tolerance = predict_displacement(designs[0], scales), MAX_ERROR * scales.size
    bound = tolerance if default_displacement <= tolerance else tolerance / ERROR_MARGIN
    while len(designs) <= MAX_REDUCTIONS:
        count = len(designs)
        is_loud = predict_displacement(designs[-1], scales) > bound
        if not is_loud and not move(design(count, 2)) < WORTHWHILE_PART * move(designs[-1]):
            break
        designs.append(design(count))
    if len(designs) == 1:
        return designs[0], None
    # The changes, in words.
    divisor = 10 ** (len(designs) - 1)
    before, after = (predict_displacement(each, scales) for each in (designs[0], designs[-1]))
    reason = f"more than {_show_length(tolerance)}"
    if default_displacement <= tolerance:
        before, after = move(designs[0]), move(designs[-1])
        reason = "in the linear loop"
    return designs[-1], (
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


# Margins of a linear loop.


@dataclass(frozen=True, eq=False)
class Margins:
    """The margins of a linear loop before it becomes unstable.

    is_stable: whether the loop itself is stable.
    delay [s]: largest further delay of all actuators, found to 1/64 of a sample; infinite if ten samples
        more are not too many.
    gain: largest factor of the effect of all actuators, infinite if 11 is not too much.
    stiffness: largest part by which all stiffnesses may be higher or lower, infinite if a tenth is not too
        much.
    radius: largest modulus of an eigenvalue of the transition of one sample, below 1 for a stable loop.
    disk: disk margin where the effects of all actuators change at once, each by its own factor: at least
        this.
    actuator_disk (n_actuators,): disk margin where the effect of this actuator alone changes.

    With a disk margin d the loop stands each factor f = (2 + e) / (2 - e) of the effect of the actuators, e
    any complex number with abs(e) < d: gains from (2 - d) / (2 + d) to (2 + d) / (2 - d) or phases of up to
    2 arctan(d / 2), and both at the same time where f stays in the disk (P. Seiler, A. Packard, P. Gahinet,
    An introduction to disk margins, IEEE Control Systems Magazine 40, 2020).
    """

    is_stable: bool
    delay: float
    gain: float
    stiffness: float
    radius: float
    disk: float
    actuator_disk: FloatArray

    def __post_init__(self) -> None:
        freeze_fields(self)


def find_gain_range(disk: float) -> tuple[float, float]:
    """Return the least and the largest factor of the actuators' effect in a disk; infinite from 2 on."""
    return max((2.0 - disk) / (2.0 + disk), 0.0), (2.0 + disk) / (2.0 - disk) if disk < 2.0 else np.inf


def find_phase(disk: float) -> float:
    """Return the phase by which the actuators may lag in a disk [rad]."""
    return 2.0 * float(np.arctan(0.5 * disk))


def find_margins(loop: LinearLoop) -> Margins:
    """Return the margins of a loop: delay, gain, stiffness to about 1 %, disks at its worst frequencies."""
    radius = loop.radius()
    if not radius < 1.0:
        return Margins(False, 0.0, 1.0, 0.0, radius, 0.0, np.zeros(len(loop.delay)))
    sample = loop.gains.sample
    delays = [sample * count for count in range(1, MAX_SAMPLES + 1)]
    return Margins(
        True,
        _find_first(lambda more: loop.radius(more_delay=more), 0.0, delays),
        _find_first(lambda factor: loop.radius(factor=factor), 1.0, FACTORS),
        _find_first(
            lambda part: max(loop.with_stiffness(1.0 + sign * part).radius() for sign in (-1.0, 1.0)),
            0.0,
            STIFFNESS_PARTS,
        ),
        radius,
        *find_disks(loop),
    )


def _find_first(radius: Callable[[float], float], stable: float, values: Sequence[float]) -> float:
    """Return the largest value below which loops are stable, infinite if all values are."""
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


# Disk margins: the loop is broken where the commands enter the plant.


def find_disks(loop: LinearLoop) -> tuple[float, FloatArray]:
    """Return the disk margins of all actuators at once (at least), and of each one alone (n_actuators,).

    With S the sensitivity at the inputs of the plant, the disk of one actuator is 1 over the largest modulus
    of its diagonal entry of S - 1/2, that of all together at least 1 over the largest singular value.
    """
    transition, push, command = loop.open_at_inputs()
    triangle, vectors = schur(transition, output="complex")
    right, m = vectors.conj().T, len(loop.delay)

    def measure(angle: float) -> FloatArray:
        """Return the size of S - 1/2 at an angle of z [rad]: of each actuator alone, and of all."""
        z = np.exp(1j * angle)
        effect = sum((z ** (-k) * matrix for k, matrix in enumerate(push)), np.zeros(push[0].shape))
        states = solve_triangular(z * np.eye(len(triangle)) - triangle, right @ effect)
        sensitivity = 0.5 * np.eye(m) + (command @ vectors) @ states
        return np.append(np.abs(np.diag(sensitivity)), np.linalg.norm(sensitivity, 2))

    # Frequencies: a grid, those of all eigenvalues, then between the neighbours of the worst ones.
    values = np.diag(triangle)
    values = values[np.abs(values) > LOWEST]
    about_eigenvalues = [
        np.abs(np.angle(values)) + offset * np.abs(np.log(np.abs(values))) for offset in OFFSETS
    ]
    grid = np.geomspace(LOWEST, 1.0, FREQUENCIES) * np.pi
    angles = np.unique(np.clip(np.concatenate([grid, *about_eigenvalues]), 0.0, np.pi))
    sizes = np.array([measure(angle) for angle in angles])
    for k in np.unique(sizes.argmax(axis=0)):
        low, high = angles[max(k - 1, 0)], angles[min(k + 1, len(angles) - 1)]
        between = [measure(angle) for angle in np.linspace(low, high, REFINED)]
        sizes = np.vstack([sizes, between])
    largest = sizes.max(axis=0)
    return float(1.0 / largest[-1]), 1.0 / largest[:-1]


# Errors that noise causes, before anything is simulated.


def predict_errors(loop: LinearLoop, model: CompiledModel, coordinate: FloatArray) -> dict[str, float]:
    """Return the distance of each node from its place that noise of the sensors causes, by its name [m].

    Root of its mean square in the stationary loop, infinite if the loop is unstable; 0 without an
    estimator.
    """
    covariance, names = loop.covariance(), model.manifest.node_name
    if not np.isfinite(covariance).all():
        return dict.fromkeys(names, float("inf"))
    steps = STEP * np.eye(len(coordinate))
    ends = [(place_nodes(model, coordinate + step), place_nodes(model, coordinate - step)) for step in steps]
    slope = np.array([(plus - minus) / (2.0 * STEP) for plus, minus in ends])
    squares = np.maximum(np.einsum("aix,ab,bix->i", slope, covariance, slope), 0.0)
    return dict(zip(names, np.sqrt(squares).tolist(), strict=True))
