"""Weights of the regulator from the scene: each quantity over the largest value that is accepted of it.

And feedback of these weights with a distribution of tensions, or model-predictive control.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    check_independent,
    check_motion,
    find_reference,
    linearise,
)
from tensegrity_codegen.control.feedback.loop.actuator_bounds import find_bounds
from tensegrity_codegen.control.feedback.loop.tension_distribution import (
    TensionDistribution,
    design_distribution,
)
from tensegrity_codegen.control.feedback.mpc import Mpc, design_mpc
from tensegrity_codegen.runtime.model.arguments import INPUT, merge_inputs
from tensegrity_codegen.runtime.model.interface import name_states, require_model, require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.checks import check_instance, check_positive
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.manifest import Manifest

HELD_TIME = 2.0  # [s], of an equilibrium
TOLERANCE = 0.05  # of the size of the structure: displacement that is accepted for a moment
EFFORT = 0.05  # of this displacement: change of a rest length
SUMMED_TIMES = 1.0  # response times for which the displacement is accepted
SHORTEST_RESPONSE, LONGEST_RESPONSE = 2.0, 0.05  # response time: samples at least, part of the motion at most
MIN_GAIN = 0.02  # of the largest static gain: outputs that actuators change less are not summed
STEP = 1e-6  # of an angle [rad], of a central difference
NO_STIFFNESS = 1e-9  # of the largest squared frequency: below it a motion has no stiffness


@dataclass(frozen=True, eq=False)
class Scales:
    """Lengths and times of a structure, for weights with consistent units."""

    size: float  # [m]: longest side of the box around the nodes
    lever: FloatArray  # (n_coordinates,) [m/rad or 1]: the most that a unit of each coordinate moves a node
    is_angle: BoolArray  # (n_coordinates,): which coordinates are angles
    frequency: float  # [rad/s]: lowest natural frequency, without damping; 0 if no motion has stiffness
    # (n_coordinates, n_actuators) [m/m]: by how much a unit of each actuator's input moves each coordinate at
    # rest, times its lever
    static_gain: FloatArray

    def __post_init__(self) -> None:
        freeze_fields(self)


def find_scales(model: CompiledModel, motion: Motion, arguments: Mapping[str, Any]) -> Scales:
    """Return lengths at the start of a motion, and times at its end."""
    q = motion.coordinate[0]
    n = len(q)
    position = place_nodes(model, q, arguments=_without_input(arguments))
    size = float(np.ptp(position, axis=0).max(initial=0.0))
    is_angle = find_angles(model.manifest)
    lever = np.array([_compute_lever(model, q, k, arguments) if is_angle[k] else 1.0 for k in range(n)])
    lever[lever < NO_STIFFNESS * size] = size  # a coordinate that moves no node
    state_matrix, input_matrix = linearise(model, motion, motion.duration, motion.actuators, arguments)
    stiffness, push = -state_matrix[n:, :n], input_matrix[n:]
    gain = lever[:, None] * np.linalg.lstsq(stiffness, push, rcond=NO_STIFFNESS)[0]
    # Lowest frequency of q'' = -stiffness q [rad/s].
    squares = np.linalg.eigvals(stiffness).real
    positive = squares[squares > NO_STIFFNESS * np.abs(squares).max(initial=0.0)]
    frequency = float(np.sqrt(positive.min())) if len(positive) else 0.0
    return Scales(size, lever, is_angle, frequency, gain)


def find_angles(manifest: Manifest) -> BoolArray:
    """Return which coordinates are angles, (n_coordinates,): those of bodies whose name ends in no axis."""
    if manifest.coordinate_node_axis:
        return np.zeros(len(manifest.coordinate_name), dtype=bool)
    return np.array([name.rpartition("_")[2] not in ("x", "y", "z") for name in manifest.coordinate_name])


def _compute_lever(model: CompiledModel, q: FloatArray, k: int, arguments: Mapping[str, Any]) -> float:
    ends = []
    for step in (STEP, -STEP):
        moved = q.copy()
        moved[k] += step
        ends.append(place_nodes(model, moved, arguments=_without_input(arguments)))
    return float(np.linalg.norm(ends[0] - ends[1], axis=1).max(initial=0.0)) / (2 * STEP)


def _without_input(arguments: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in arguments.items() if name != INPUT}


@dataclass(frozen=True, eq=False)
class Tuning:
    """Weights of `design_lqr`, and the values from which they were chosen.

    Attributes
    ----------
    Q : ndarray, shape (n_states,)
        Diagonal weights of coordinates, velocities, sums.
    R : ndarray, shape (n_actuators,)
        Diagonal weights of the actuators' inputs.
    integral_action : tuple of str, or ndarray, shape (n_integrals, n_x)
        As `design_lqr` takes it: names of coordinates, or outputs.
    tolerance : float [m]
        Displacement of a node that is accepted for a moment.
    effort : ndarray, shape (n_actuators,) [m]
        Change of each actuator's input that is accepted for it.
    response_time : float [s]
        Time in which a displacement may change by as much.
    sample : float [s]
        Time between two commands.
    scales : Scales
        Lengths and times of the structure.
    """

    Q: FloatArray
    R: FloatArray
    integral_action: tuple[str, ...] | FloatArray
    tolerance: float
    effort: FloatArray
    response_time: float
    sample: float
    scales: Scales

    def __post_init__(self) -> None:
        freeze_fields(self)


def choose_weights(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    *,
    sample: float = 0.005,
    tolerance: float | None = None,
    effort: float | None = None,
    response_time: float | None = None,
    integral_action: Sequence[str] | None = None,
    arguments: Mapping[str, Any] | None = None,
) -> Tuning:
    """Return weights of the linear-quadratic regulator by Bryson's rule.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene.
    motion : Motion or Equilibrium
        The motion, or the equilibrium to hold for 2 s.
    sample : float [s]
        Time between two commands.
    tolerance : float, optional [m]
        Displacement d of a node that is accepted for a moment; by default a twentieth of the longest side of
        the box around the nodes.
    effort : float, optional [m]
        Change of a rest length that is accepted for it; by default the least of d / 20, of what the rate of
        the actuator permits in the response time, and of half its range.
    response_time : float, optional [s]
        T; by default 1 over the lowest natural frequency [rad/s], at least two samples and at most a
        twentieth of the motion.
    integral_action : sequence of str, optional
        Names of coordinates whose errors are summed, none for an empty one; by default all coordinates, or
        where the actuators cannot move all of them at rest, the displacements that they move most.
    arguments : mapping, optional
        Run-time parameters if they differ from the scene.

    Returns
    -------
    Tuning
        Weights, and the values from which they were chosen.

    Raises
    ------
    InvalidValueError, NonFiniteError
        A value out of range, a motion of another model, weights that are not finite.
    FormulationError
        Coordinates depend on each other.

    Notes
    -----
    Each weight is 1 over the square of the largest value that is accepted (A. E. Bryson, Y.-C. Ho, Applied
    Optimal Control, 1975, section 5.2). A coordinate whose unit moves a node by at most c [m] has the largest
    values d / c, its velocity d / (c T), the sum of its errors d T / (c h) over samples of h seconds.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import EquilibriumPath, choose_weights, compile_scene, time_motion
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("time_motion", "control"))
    >>> motion = time_motion(model, EquilibriumPath([[0.0], [-0.1]]), duration=2.0)
    >>> tuning = choose_weights(model, motion, tolerance=0.01, sample=0.02)
    >>> (tuning.Q**-0.5).round(4).tolist()[0], (tuning.R**-0.5).round(4).tolist(), tuning.integral_action
    (0.01, [0.0005], ('n2.z',))
    """
    require_model(model)
    check_independent(model)
    motion = find_reference(model, motion, HELD_TIME, arguments)
    check_motion(model, motion)
    require_quantities(model, ("state_jacobian", "input_jacobian"), "the design of feedback needs")
    step = check_positive(sample, "sample", "[s]")
    # The largest values that are accepted, by default from lengths and times of the structure.
    scales = find_scales(model, motion, merge_inputs(model.manifest, arguments))
    d = _read_positive(tolerance, "tolerance", "m") or TOLERANCE * scales.size
    period = 1.0 / scales.frequency if scales.frequency > 0.0 else np.inf
    usual = float(max(min(period, LONGEST_RESPONSE * motion.duration), SHORTEST_RESPONSE * step))
    time = _read_positive(response_time, "response_time", "s") or usual
    inputs = _compute_efforts(model, motion, _read_positive(effort, "effort", "m"), d, time)
    outputs, reach = _choose_outputs(model, scales, inputs, integral_action)
    # Each weight is 1 over the square of such a value.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        weight = (scales.lever / d) ** 2
        summed = (step * reach / (SUMMED_TIMES * d * time)) ** 2
        squares, costs = np.concatenate([weight, weight * (time * time), summed]), inputs**-2.0
    if not (np.isfinite(squares).all() and np.isfinite(costs).all()):
        raise NonFiniteError(
            "the weights are not finite",
            where="tolerance",
            given=f"tolerance {d:g} m, effort {inputs.min():g} m, response time {time:g} s",
            allowed="lengths and times nearer to those of the structure",
        )
    return Tuning(
        Q=squares,
        R=costs,
        integral_action=outputs,
        tolerance=d,
        effort=inputs,
        response_time=time,
        sample=step,
        scales=scales,
    )


def _read_positive(value: float | None, where: str, unit: str) -> float | None:
    if value is None:
        return None
    return check_positive(value, where, f"[{unit}]")


def _compute_efforts(
    model: CompiledModel, motion: Motion, effort: float | None, tolerance: float, time: float
) -> FloatArray:
    """Return the changes of the actuators' inputs that are accepted, (n_actuators,) [m]."""
    bounds = find_bounds(model, motion)
    if effort is not None:
        return np.full(len(bounds.names), effort)
    half = 0.5 * (bounds.most - bounds.least)
    return np.minimum(np.minimum(EFFORT * tolerance, bounds.rate * time), half)


def _choose_outputs(
    model: CompiledModel, scales: Scales, effort: FloatArray, names: Sequence[str] | None
) -> tuple[tuple[str, ...] | FloatArray, FloatArray]:
    """Return the outputs whose errors are summed, and how many metres a unit of each one is."""
    coordinates = name_states(model.manifest)[: len(scales.lever)]
    if names is not None:
        check_instance(names, (list, tuple), "integral_action", "a list of names of coordinates")
        chosen = tuple(str(name) for name in names)
        columns = [
            coordinates.index(name) for name in chosen if name in coordinates
        ]  # design_lqr refuses others
        return chosen, scales.lever[columns]
    moved = scales.static_gain * effort
    directions, size, _ = np.linalg.svd(moved)
    rank = int((size > MIN_GAIN * size[0]).sum()) if len(size) and size[0] > 0.0 else 0
    if rank == len(coordinates):
        return coordinates, scales.lever
    rows = directions[:, :rank].T * scales.lever
    return np.hstack([rows, np.zeros_like(rows)]), np.ones(rank)


# Feedback that keeps least tensions, as options state it.


def read_least_tension(text: str | None) -> float | None:
    """Return the least tension [N] of an option, None for that of the scene; raises InvalidValueError."""
    if text is None or text == "scene":
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < 0.0:
        raise InvalidValueError(
            "not a least tension", where="least_tension", given=text, allowed="a number >= 0 [N], or scene"
        )
    return value


def design_limited(
    model: CompiledModel,
    motion: Motion,
    tuning: Tuning,
    gains: Gains,
    *,
    least_tension: str | None,
    mpc: bool,
    horizon: int,
    arguments: Mapping[str, Any] | None = None,
) -> tuple[Gains | Mpc, TensionDistribution | None]:
    """Return the gains with a distribution of tensions, or model-predictive control of the same weights."""
    tension = read_least_tension(least_tension)
    if mpc:
        return design_mpc(
            model, motion, tuning.Q, tuning.R, sample=gains.sample, horizon=horizon,
            integral_action=tuning.integral_action, least_tension=tension, arguments=arguments,
        ), None  # fmt: skip
    if least_tension is None:
        return gains, None
    return gains, design_distribution(model, motion, least_tension=tension, arguments=arguments)
