"""Estimators: extended Kalman filters with disturbance forces, their gains stored at knots along a motion."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm, qr

from tensegrity_codegen.control.feedback.design.gains import Estimator, Sensing, find_sensing
from tensegrity_codegen.control.feedback.design.linear_samples import (
    build_sample_time,
    check_independent,
    check_motion,
    check_still_feet,
    find_allowed,
    find_reference,
    invert_mass,
    linearise,
    to_dense,
)
from tensegrity_codegen.control.feedback.design.riccati import (
    HiddenMode,
    compute_gain,
    describe_direction,
    find_stationary,
    find_unobserved,
)
from tensegrity_codegen.runtime.model.arguments import INPUT, merge_inputs
from tensegrity_codegen.runtime.model.arrays import to_each
from tensegrity_codegen.runtime.model.interface import name_moving_states, require_model, require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive, check_switch, check_whole
from tensegrity_codegen.system.errors import FormulationError

KALMAN_QUANTITIES = ("acceleration", "state_jacobian", "mass_matrix", "equilibrium_matrix")
MAX_KNOTS = 25  # of the gains along a motion, by default
ACCELERATION_NOISE = 3e-4  # of the accelerations that these forces cause: noise without disturbance states
STABLE_STEP = 1.5  # of a Runge-Kutta step: its length times the largest eigenvalue
MAX_SUBSTEPS = 1000  # Runge-Kutta steps in one sample
LARGEST_NOISE = 1e100  # noise whose square is far from the largest double
MIN_SHOWN = 0.01  # of what the best shown force adds to the measurements, in multiples of their noise
GROWTH_RATE = 1.0  # [1/s] of forces like exp(t / 1 s): `disturbance` states their change in this time
DISTURBED_PART = 0.1  # of the usual forces, by which disturbances change in a second


def design_kalman(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    sensors: Sequence[Sensor] | None = None,
    *,
    sample: float = 0.005,
    disturbance: ArrayLike | None = None,
    acceleration_noise: ArrayLike | None = None,
    only_observable: bool = False,
    knots: int = MAX_KNOTS,
    arguments: Mapping[str, Any] | None = None,
) -> Estimator:
    """Return an extended Kalman filter for a motion.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene; its coordinates are independent of each other.
    motion : Motion or Equilibrium
        The motion, or the equilibrium to hold.
    sensors : sequence of Sensor, optional
        The sensors, each with its noise; by default the sensors of the scene.
    sample : float [s]
        Time between two measurements.
    disturbance : float or array_like, shape (n_coordinates,), optional [N/sqrt(s) or N m/sqrt(s)]
        How fast the disturbance force on each coordinate changes: standard deviation of its change in 1 s.
        By default a tenth of the forces that the largest tension causes; 0: no such force is estimated.
    acceleration_noise : float or array_like, shape (n_coordinates,), optional [m/s2 or rad/s2, by sqrt(Hz)]
        White noise of the accelerations. By default 3e-4 of those that these forces cause.
    only_observable : bool
        Estimate disturbance forces on as many coordinates as the sensors tell apart, those that they show
        best, and leave out the others. By default forces that cannot be told apart are refused.
    knots : int
        Number of times at which gains are computed.
    arguments : mapping, optional
        Run-time parameters if they differ from the scene.

    Returns
    -------
    Estimator
        Gains ``L`` and covariances ``P`` at the knots.

    Raises
    ------
    InvalidValueError
        A value out of range, a sensor without noise, a motion of another model.
    StructureError
        There are no sensors.
    FormulationError
        The state cannot be observed (rank and direction are named), or coordinates depend on each other.
    ConvergenceError
        A Riccati equation is not solved.

    Notes
    -----
    q'' = a(q, q', u) + M^-1 d + w, w and d' white noise. Without d, errors of stiffness and constant loads
    become errors of the estimate. Gains are stationary at each knot: P = A (P - L C P) A^T + W,
    L = P C^T (C P C^T + V)^-1, with A and W exact for the sample (R. E. Kalman, Journal of Basic Engineering
    82, 1960; C. F. Van Loan, IEEE Transactions on Automatic Control 23, 1978).

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import compile_scene, design_kalman, find_equilibrium
    >>> text = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> text += '[[sensors]]\\nkind = "member_length"\\nmembers = "cord"\\nnoise = 1e-3\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + text)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> estimator = design_kalman(model, find_equilibrium(model), sample=0.02, knots=2)
    >>> estimator.state_name, estimator.L.shape
    (('n2.z', "n2.z'", 'force on n2.z'), (2, 3, 1))
    """
    require_model(model)
    check_independent(model)
    require_quantities(model, KALMAN_QUANTITIES, "an estimator needs")
    check_positive(sample, "sample", "[s]")
    check_switch(only_observable, "only_observable")
    reference = find_reference(model, motion, sample, arguments)
    check_motion(model, reference)
    check_still_feet(model, reference, "an estimator")
    build_sample_time(reference, sample)
    # The sensors, the disturbing forces, and how fast these change.
    sensing = find_sensing(model, sensors)
    parameters = merge_inputs(model.manifest, arguments)
    force_noise, rate_noise = _read_noise(model, reference, parameters, disturbance, acceleration_noise)
    time = np.linspace(0.0, reference.duration, check_whole(knots, "knots", 2, 10_000))
    if only_observable:
        end_model = linearise_estimate(
            model, reference, reference.duration, parameters, sensing, np.flatnonzero(force_noise)
        )
        force_noise = _keep_shown_forces(*end_model, sensing, force_noise, sample)
    disturbed = np.flatnonzero(force_noise)
    # Linear models of the estimator's state at the knots.
    models = [
        linearise_estimate(model, reference, now, parameters, sensing, disturbed) for now in time.tolist()
    ]
    spectrum = np.diag(np.concatenate([np.zeros(len(rate_noise)), rate_noise, force_noise[disturbed]]) ** 2)
    spectra = [_shape_noise(model, reference, now, parameters, spectrum) for now in time.tolist()]
    names = name_moving_states(model.manifest)
    n = len(names) // 2
    names = (*names, *(f"force on {names[k]}" for k in disturbed))
    noise = np.diag(sensing.noise**2)
    # A stationary Riccati equation at each knot, where the sensors show every state.
    gains, covariances, innovations, residuals = [], [], [], []
    for (rate, slope), spectrum in zip(models, spectra, strict=True):
        a, w = _sample_noise(rate, spectrum, sample)
        hidden = find_unobserved(a, slope)
        if hidden:
            _raise_unobservable(model.manifest.name, hidden, names, sensing)
        p, residual = find_stationary(a.T, slope.T, w, noise, f"{model.manifest.name}: design_kalman")
        gains.append(compute_gain(p, np.eye(len(p)), slope.T, noise).T)  # P C^T (C P C^T + V)^-1
        covariances.append(p)
        innovations.append(np.sqrt(np.diag(slope @ p @ slope.T + noise)))
        residuals.append(residual)
    # How errors of the estimate decay at the end of the motion.
    error = (np.eye(len(names)) - gains[-1] @ models[-1][1]) @ a
    return Estimator(
        time=time,
        L=np.array(gains),
        P=np.array(covariances),
        innovation=np.array(innovations),
        E=np.linalg.eigvals(error).astype(np.complex128),
        sample=sample,
        residual=max(residuals),
        substeps=count_substeps([rate[: 2 * n, : 2 * n] for rate, _ in models], sample),
        disturbed=disturbed.astype(np.int64),
        sensing=sensing,
        state_name=names,
    )


def linearise_estimate(
    model: CompiledModel,
    motion: Motion,
    time: float,
    given: Mapping[str, Any],
    sensing: Sensing,
    disturbed: NDArray[np.int64],
) -> tuple[FloatArray, FloatArray]:
    """Return the linear model of an estimator's state x = (q, q', d) at a time, and of its measurements."""
    point = motion.at(time)
    at = {**given, "coordinate": point.coordinate, "velocity": point.velocity, INPUT: point.input}
    inner = linearise(model, motion, time, (), given)[0]
    inverse = invert_mass(model, at)
    n = len(point.coordinate)
    rate = np.zeros((2 * n + len(disturbed), 2 * n + len(disturbed)))
    rate[: 2 * n, : 2 * n], rate[n : 2 * n, 2 * n :] = inner, inverse[:, disturbed]
    slope = np.zeros((len(sensing.noise), len(rate)))
    slope[:, : 2 * n] = sensing.slopes(at)
    return rate, slope


def _shape_noise(
    model: CompiledModel, motion: Motion, time: float, given: Mapping[str, Any], spectrum: FloatArray
) -> FloatArray:
    """Return the noise of an estimator's state that rigid bars allow at a time of a motion."""
    if not model.manifest.rigid_bar:
        return spectrum
    point, shaped = motion.at(time), np.eye(len(spectrum))
    n = 2 * len(point.coordinate)
    at = {**given, "coordinate": point.coordinate, "velocity": point.velocity}
    shaped[:n, :n] = find_allowed(model, at)[:n, :n]
    return np.asarray(shaped @ spectrum @ shaped.T)


def _keep_shown_forces(
    rate: FloatArray, slope: FloatArray, sensing: Sensing, force_noise: FloatArray, sample: float
) -> FloatArray:
    """Return `force_noise` with 0 for the forces that the sensors do not tell apart, (n_coordinates,)."""
    disturbed = np.flatnonzero(force_noise)
    if not len(disturbed):
        return force_noise
    shown = disturbed[
        find_shown_forces(expm(sample * rate), slope, sensing.noise, force_noise[disturbed], sample)
    ]
    return np.where(np.isin(np.arange(len(force_noise)), shown), force_noise, 0.0)


def _sample_noise(rate: FloatArray, spectrum: FloatArray, sample: float) -> tuple[FloatArray, FloatArray]:
    """Return the transition over a sample, and the covariance of the noise that it gathers."""
    n = len(rate)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -rate, spectrum, rate.T
    exponential = expm(sample * block)
    a = exponential[n:, n:].T
    w = a @ exponential[:n, n:]
    return a, 0.5 * (w + w.T)


def _read_noise(
    model: CompiledModel,
    motion: Motion,
    given: Mapping[str, Any],
    disturbance: ArrayLike | None,
    acceleration_noise: ArrayLike | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the noise that drives disturbance forces (force_noise) and velocities (rate_noise).

    Both (n_coordinates,): standard deviations of the change in 1 s, [N/sqrt(s)] and [m/s2 / sqrt(Hz)].
    """
    n = motion.coordinate.shape[1]
    at = {**given, "coordinate": motion.coordinate[-1], "velocity": np.zeros(n), INPUT: motion.input[-1]}
    force = find_usual_forces(model, motion, given)
    mass = np.diag(to_dense(model.compute("mass_matrix", **at)))
    force_noise = DISTURBED_PART * force if disturbance is None else _read(disturbance, n, "disturbance")
    usual = ACCELERATION_NOISE * force / mass
    rate_noise = usual if acceleration_noise is None else _read(acceleration_noise, n, "acceleration_noise")
    return force_noise, rate_noise


def _read(value: ArrayLike, n: int, where: str) -> FloatArray:
    allowed = f"a number from 0 to {LARGEST_NOISE:g}, or one for each of {n} coordinates"
    return to_each(value, n, where, lambda x: (x >= 0.0) & (x <= LARGEST_NOISE), allowed)


def count_substeps(rates: Sequence[FloatArray], sample: float) -> int:
    """Return the Runge-Kutta steps that a sample needs for a stable prediction."""
    fastest = max(float(np.abs(np.linalg.eigvals(rate)).max()) for rate in rates)
    return min(max(1, math.ceil(fastest * sample / STABLE_STEP)), MAX_SUBSTEPS)


def _raise_unobservable(
    scene: str, hidden: Sequence[HiddenMode], names: tuple[str, ...], sensing: Sensing
) -> NoReturn:
    """Raise FormulationError for states that the sensors do not show."""
    mode = hidden[0]
    shown = ", ".join(sensing.names[:3]) + ", ..." * (len(sensing.names) > 3)
    direction = describe_direction(mode.direction, names)
    raise FormulationError(
        f"the state cannot be observed from these sensors; unobservable: {direction}",
        where=f"{scene}: design_kalman",
        given=f"rank {mode.rank} of {mode.size} with {len(sensing.noise)} numbers: {shown}",
        allowed="sensors that show every motion and disturbance force that does not decay",
        hint="estimate fewer forces (`only_observable=True`) or none (`disturbance=0`), or add sensors; "
        "forces along stiff bars move nothing that sensors tell from rounding",
    )


# Which disturbance forces measurements show: on how many coordinates a filter can estimate one.


def find_shown_forces(
    a: FloatArray, slope: FloatArray, noise: FloatArray, size: FloatArray, sample: float
) -> NDArray[np.int64]:
    """Return as many forces as the measurements tell apart, those that they show best.

    Forces that grow like exp(t / 1 s) cause measurements G d, G = C (z - A)^-1 B with z = exp(sample / 1 s).
    QR decomposition of G with pivots takes one force after the other, each time the one that adds most
    to what the measurements show already; it ends where the next one adds less than MIN_SHOWN of the first.
    """
    n = len(a) - len(size)
    z = np.exp(GROWTH_RATE * sample)
    states = np.linalg.solve(z * np.eye(n) - a[:n, :n], a[:n, n:] * size)
    _, triangle, order = qr((slope[:, :n] @ states) / noise[:, None], mode="economic", pivoting=True)
    adds = np.abs(np.diag(triangle))
    return np.sort(order[: len(adds)][adds > MIN_SHOWN * adds[0]]).astype(np.int64)


# Forces that the tensions of a motion cause, from which estimators take how large disturbances are.


def find_usual_forces(model: CompiledModel, motion: Motion, given: Mapping[str, Any]) -> FloatArray:
    """Return the force of the largest tension on each coordinate, (n_coordinates,) [N or N m]."""
    n = motion.coordinate.shape[1]
    at = {**given, "coordinate": motion.coordinate[-1], "velocity": np.zeros(n), INPUT: motion.input[-1]}
    dense = to_dense(model.compute("equilibrium_matrix", **at))
    pulls = ~np.isin(model.manifest.member_name, model.manifest.rigid_bar)
    lever: FloatArray = np.linalg.norm(dense[:, pulls], axis=1)
    return float(np.abs(motion.member_tension[:, pulls]).max(initial=0.0)) * lever
