"""Linear models along a motion, sampled exactly: x[k+1] = A[k] x[k] + B[k] u[k] for constant inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from tensegrity_codegen.errors import FormulationError, InvalidValueError
from tensegrity_codegen.formulations import find_formulation
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.model.interface import Described
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT, merge_inputs
from tensegrity_codegen.runtime.model.require import require_double, require_quantities

__all__ = ["LINEAR_QUANTITIES", "LinearSamples", "build_sample_time", "compute_hold", "sample_linear_models"]

FloatArray = NDArray[np.float64]

LINEAR_QUANTITIES = ("state_jacobian", "input_jacobian")
MOST_SAMPLES = 100_000
SAME = 1e-9  # of a sample, by which rounding may have the duration exceed whole samples


@dataclass(frozen=True)
class LinearSamples:
    """Linear models at sample times, of x = (q, q') and the actuators' inputs u minus those of the motion.

    Attributes
    ----------
    time : ndarray, shape (n_t,) [s]
        Sample times; the last one is the end of the motion or just after it.
    sample : float [s]
        Sample time.
    A, B : ndarray, shape (n_t, n_states, n_states) and (n_t, n_states, n_actuators)
        Transition over the sample that starts there, for inputs held constant.
    rate, gain : ndarray, same shapes
        Continuous-time matrices x' = rate x + gain u.
    """

    time: FloatArray
    sample: float
    A: FloatArray
    B: FloatArray
    rate: FloatArray
    gain: FloatArray


def sample_linear_models(
    model: CompiledModel,
    motion: Motion,
    sample: float,
    actuators: Sequence[str],
    arguments: Mapping[str, Any] | None = None,
) -> LinearSamples:
    """Return the sampled linear models along a motion.

    Parameters
    ----------
    model : CompiledModel
        With LINEAR_QUANTITIES.
    motion : Motion
        The motion.
    sample : float [s]
        Sample time.
    actuators : sequence of str
        Names of the inputs that feedback changes.
    arguments : mapping, optional
        Run-time parameters where they differ from the scene.

    Returns
    -------
    LinearSamples
        One model at each sample time.

    Raises
    ------
    InvalidValueError
        The sample time is out of range, or the motion has other coordinates than the model.
    FormulationError
        Coordinates depend on each other, or the model lacks a quantity.

    Notes
    -----
    expm([[A, B], [0, 0]] h) = [[A_h, B_h], [0, 1]] (Van Loan, IEEE Transactions on Automatic Control 23,
    1978), A and B at the state, inputs and time of the start of the sample.
    """
    require_double(model.manifest, "the design of feedback")
    check_independent(model)
    require_quantities(model, LINEAR_QUANTITIES, "the design of feedback needs")
    check_motion(model, motion)
    time = build_sample_time(motion, sample)
    place = [model.manifest.input_name.index(name) for name in actuators]
    given = merge_inputs(model.manifest, arguments)
    rates, gains = [], []
    for now in time.tolist():
        point = motion.at(now)
        at = {**given, "coordinate": point.coordinate, "velocity": point.velocity, INPUT: point.input}
        rates.append(model.compute("state_jacobian", **at).toarray())
        gains.append(model.compute("input_jacobian", **at).toarray()[:, place])
    rate, gain = np.array(rates), np.array(gains)
    hold = [compute_hold(a, b, sample) for a, b in zip(rate, gain, strict=True)]
    return LinearSamples(
        time, sample, np.array([a for a, _ in hold]), np.array([b for _, b in hold]), rate, gain
    )


def compute_hold(rate: FloatArray, gain: FloatArray, sample: float) -> tuple[FloatArray, FloatArray]:
    """Return the transition over one sample for a constant input.

    Parameters
    ----------
    rate, gain : ndarray, shape (n, n) and (n, m)
        x' = rate x + gain u.
    sample : float [s]
        Sample time.

    Returns
    -------
    A, B : ndarray
        x[k+1] = A x[k] + B u[k], same shapes.
    """
    n, m = gain.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = rate, gain
    whole = expm(sample * block)
    return whole[:n, :n], whole[:n, n:]


def build_sample_time(motion: Motion, sample: float) -> FloatArray:
    """Return the sample times of a motion, (n_t,) [s]; the last is at its end or just after.

    Raises InvalidValueError for a sample that is no time, or of which too many make the motion.
    """
    if isinstance(sample, bool) or not np.isfinite(sample) or sample <= 0.0:
        raise InvalidValueError(
            "out of range", where="sample", given=sample, allowed="a finite number > 0 [s]"
        )
    count = motion.duration / sample
    if count > MOST_SAMPLES or count < 1.0 - SAME:
        raise InvalidValueError(
            "the sample time does not fit the motion",
            where="sample",
            given=f"{sample!r} s, motion of {motion.duration:g} s",
            allowed=f"{motion.duration / MOST_SAMPLES:.3g} to {motion.duration:g} s",
        )
    return sample * np.arange(int(np.ceil(count - SAME)) + 1, dtype=float)


def check_independent(model: Described) -> None:
    """Raise FormulationError for a model whose coordinates depend on each other."""
    formulation = find_formulation(model.manifest.formulation)
    in_nodes = formulation.in_nodes and not formulation.has_rigid_bars
    if not (formulation.of_bodies or in_nodes):
        raise FormulationError(
            "feedback needs coordinates that are independent of each other",
            where=model.manifest.name,
            given=f"formulation {model.manifest.formulation!r}",
            allowed='"bodies" or "node_position"',
            hint="state the bars as [bodies], or give them a stiffness",
        )


def check_motion(model: Described, motion: Motion) -> None:
    """Raise InvalidValueError for a motion of another model."""
    n, m = len(model.manifest.coordinate_name), len(model.manifest.input_name)
    names = ", ".join(motion.input_name) or "none"
    if motion.coordinate.shape[1] != n or motion.input_name != model.manifest.input_name:
        raise InvalidValueError(
            "the motion belongs to another model",
            where="motion",
            given=f"{motion.coordinate.shape[1]} coordinates, inputs {names}",
            allowed=f"{n} coordinates and the {m} inputs of {model.manifest.name}",
        )
