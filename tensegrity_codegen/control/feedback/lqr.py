"""Linear-quadratic feedback along a motion."""

from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    build_sample_time,
    compute_hold,
    find_reference,
    sample_linear_models,
    shift_commands,
)
from tensegrity_codegen.control.feedback.design.riccati import (
    HiddenMode,
    describe_direction,
    find_stationary,
    find_uncontrolled,
    name_free_motions,
    step_back,
)
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits, find_bounds
from tensegrity_codegen.runtime.model.arguments import merge_inputs
from tensegrity_codegen.runtime.model.arrays import check_finite, to_doubles
from tensegrity_codegen.runtime.model.interface import name_moving_states, require_model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.bodies import BodySystem, FixedBody
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice

MAX_PAST = 1000  # commands on their way
SYMMETRIC = 1e-12  # of the largest entry
SEMIDEFINITE = 1e-12  # of the largest eigenvalue
NO_EFFECT = 1e-12  # of the largest effect of any actuator


def design_lqr(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    sample: float = 0.005,
    integral_action: ArrayLike | Sequence[str] | None = None,
    delay: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
) -> Gains:
    """Return the gains of the linear-quadratic regulator along a motion.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene; its coordinates are independent of each other.
    motion : Motion or Equilibrium
        The motion, or the equilibrium to hold.
    Q : array_like, shape (n_states, n_states) or (n_states,)
        Weight of the states: coordinates, velocities, then the sums of `integral_action`; a vector is a
        diagonal. Symmetric, positive semidefinite.
    R : array_like, shape (n_actuators, n_actuators) or (n_actuators,)
        Weight of the actuators' inputs. Symmetric, positive definite.
    sample : float [s]
        Time between two commands.
    integral_action : array_like, shape (n_integrals, n_x), or sequence of str, optional
        Outputs C x whose errors are summed at each sample, x = (q, q'); names of coordinates stand for these.
    delay : float or array_like, shape (n_actuators,), optional [s]
        Delays of the actuators, by default those of the scene. The state is predicted to the arrival of each
        command with those that are on their way.
    arguments : mapping, optional
        Run-time parameters if they differ from the scene.

    Returns
    -------
    Gains
        ``K``, ``S``, ``E`` by the names of python-control's `dlqr`, along the motion.

    Raises
    ------
    InvalidValueError, NonFiniteError
        A weight of another size, not symmetric or not definite; an actuator without effect; a delay longer
        than the motion; a motion of another model.
    UnknownNameError
        An unknown coordinate.
    FormulationError
        Coordinates depend on each other, or a motion that does not decay cannot be changed by the actuators.
    ConvergenceError
        The Riccati equation is not solved.

    Notes
    -----
    Minimises the sum of x^T Q x + u^T R u over the deviations from the motion, with sampled linear models
    along it (linear_samples.py). The recursion starts at the end of the motion with the stationary solution
    there (B. D. O. Anderson, J. B. Moore, Optimal Control: Linear Quadratic Methods, 1990, chapters 2, 3).
    With delays the commands on their way are further states (K. J. Astrom, B. Wittenmark, Computer-Controlled
    Systems, 1997, section 3.2), without weight; arrivals within a sample are exact.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import compile_scene, design_lqr, find_equilibrium
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> gains = design_lqr(model, find_equilibrium(model), [100.0, 1.0], [1.0], sample=0.02)
    >>> gains.K.shape, abs(gains.E).round(3).tolist()
    ((2, 1, 2), [0.815, 0.086])
    """
    require_model(model)
    check_positive(sample, "sample", "[s]")
    reference = find_reference(model, motion, sample, arguments)
    if not reference.actuators:
        raise InvalidValueError(
            "the motion has no actuators", where="motion.actuators", allowed="at least one actuator"
        )
    # Delays, weights and summed outputs.
    build_sample_time(reference, sample)
    longest = None if isinstance(motion, Motion) else np.inf  # an equilibrium is a motion of one sample
    late = find_bounds(
        model, reference, ActuatorLimits(delay=delay), longest_delay=longest, may_lag=True
    ).delay
    _check_count(late, sample)
    names = name_moving_states(model.manifest)
    output, labels = _read_outputs(integral_action, names)
    n, k, m = len(names), len(output), len(reference.actuators)
    over = f"{n} states (q, q')" + (f" and {k} sums" if k else "")
    q = read_weight(Q, n + k, "Q", over, definite=False)
    r = read_weight(R, m, "R", f"{m} actuators", definite=True)
    # Linear models along the motion, and whether the actuators can stabilise them.
    samples = sample_linear_models(model, reference, sample, reference.actuators, arguments, late)
    check_effects(model, samples.input_matrix, reference.actuators)
    a_end, end_slope = samples.A[-1, :n, :n], samples.input_matrix[-1, :n]
    held = compute_hold(samples.state_matrix[-1, :n, :n], end_slope, sample)[1]
    hidden = find_uncontrolled(*_augment(a_end, held, np.zeros((n, 0)), output, 0.0 * late, sample))
    if hidden:
        end, parameters = reference.at(reference.duration).coordinate, merge_inputs(model.manifest, arguments)
        by_ground = samples.state_matrix[-1, n // 2 : n, : n // 2] * bool(model.manifest.contact_name)
        effect = np.hstack([end_slope[n // 2 :], by_ground])
        rigid = name_free_motions(model, end, effect, parameters)
        _refuse(model.manifest.name, hidden, rigid, (*names, *labels))
    # The stationary solution at the end, and the recursion back to the start.
    n_bristles = samples.A.shape[1] - n
    watched = np.pad(output, ((0, 0), (0, n_bristles)))
    models = [
        _augment(*matrices, watched, late, sample)
        for matrices in zip(samples.A, samples.B, samples.past, strict=True)
    ]
    controlled = np.delete(np.arange(len(models[-1][0])), np.arange(n, n + n_bristles))  # to the controller
    square = np.ix_(controlled, controlled)
    a, b = models[-1][0][square], models[-1][1][controlled]
    weight = np.zeros_like(a)
    weight[: n + k, : n + k] = q
    p, residual = find_stationary(a, b, weight, r, f"{model.manifest.name}: design_lqr")
    costs, gains = [p[: n + k, : n + k]], [step_back(p, a, b, weight, r)[1]]
    whole_p, whole_weight = (np.zeros_like(models[-1][0]) for _ in range(2))
    whole_p[square], whole_weight[square] = p, weight
    for a_k, b_k in models[-2::-1]:
        whole_p, gain = step_back(whole_p, a_k, b_k, whole_weight, r)
        costs.append(whole_p[square][: n + k, : n + k])
        gains.append(gain[:, controlled])
    return Gains(
        time=samples.time,
        K=np.array(gains[::-1]),
        S=np.array(costs[::-1]),
        E=np.linalg.eigvals(a - b @ gains[0]).astype(np.complex128),
        A=a_end,
        B=held,
        integral_action=output,
        delay=late,
        sample=sample,
        residual=residual,
        actuators=reference.actuators,
        state_name=names,
        integral_name=labels,
    )


def _check_count(delay: FloatArray, sample: float) -> None:
    """Raise InvalidValueError for delays in which too many commands are on their way."""
    count = float(np.ceil(delay / sample).sum())
    if count > MAX_PAST:
        raise InvalidValueError(
            "too many commands are on their way",
            where="delay",
            given=f"{count:.0f} of {len(delay)} actuators, in delays of up to {delay.max():g} s",
            allowed=f"at most {MAX_PAST}",
            hint=f"a longer sample than {sample:g} s",
        )


def _augment(
    a: FloatArray, b: FloatArray, past: FloatArray, output: FloatArray, delay: FloatArray, sample: float
) -> tuple[FloatArray, FloatArray]:
    """Return the model with the sums of outputs and the commands on their way as further states."""
    shift, enter = shift_commands(delay, sample)
    n, k = len(a), len(output)
    augmented = block_diag(a, np.eye(k), shift)
    augmented[n : n + k, :n], augmented[:n, n + k :] = output, past
    return augmented, np.vstack([b, np.zeros((k, b.shape[1])), enter])


def _read_outputs(
    value: ArrayLike | Sequence[str] | None, names: tuple[str, ...]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return C (n_integrals, n_x) and the names of its rows."""
    n = len(names)
    if value is None:
        return np.zeros((0, n)), ()
    requested = [value] if isinstance(value, str) else value
    if isinstance(requested, list | tuple) and all(isinstance(name, str) for name in requested):
        coordinates = names[: n // 2]
        for name in requested:
            check_choice(name, coordinates, "coordinate", "integral_action")
        chosen = [str(name) for name in requested]
        return np.eye(n)[[coordinates.index(name) for name in chosen]], tuple(
            f"sum of {name}" for name in chosen
        )
    allowed = f"shape (n_integrals, {n}), or names of coordinates"
    output = to_doubles(value, "integral_action", allowed)
    if output.ndim != 2 or output.shape[1] != n:
        raise InvalidValueError("wrong shape", where="integral_action", given=output.shape, allowed=allowed)
    check_finite(output, "integral_action")
    return output, tuple(f"sum {k + 1}" for k in range(len(output)))


def _refuse(
    scene: str, hidden: Sequence[HiddenMode], rigid: Sequence[str], names: tuple[str, ...]
) -> NoReturn:
    """Raise FormulationError for modes that do not decay and that the actuators cannot change."""
    mode = hidden[0]
    value = mode.eigenvalue
    eigenvalue = f"{value.real:.6g}" if abs(value.imag) < 1e-9 else f"{value:.6g}"
    reason = describe_direction(mode.direction, names)
    if rigid:
        reason = f"rigid motions of the whole structure: {', '.join(rigid)}"
    raise FormulationError(
        f"the actuators cannot stabilise the motion; not changed: {reason}",
        where=f"{scene}: design_lqr",
        given=f"{len(hidden)} uncontrolled {'mode' if len(hidden) == 1 else 'modes'}; "
        f"rank {mode.rank} of {mode.size} at eigenvalue {eigenvalue}",
        allowed="actuators that change every motion that does not decay",
        hint="anchor a structure that can move freely, or let friction hold its feet; sum fewer outputs; "
        "or add actuators",
    )


# Weights of quadratic objectives, checked: size, symmetry, definiteness.


def read_weight(value: ArrayLike, size: int, where: str, over: str, *, definite: bool) -> FloatArray:
    """Return a weight as a symmetric matrix.

    value (size, size) or (size,): the matrix, or its diagonal.
    """
    allowed = f"shape ({size}, {size}), or ({size},) for a diagonal: {over}"
    weight = to_doubles(value, where, allowed)
    if weight.shape not in ((size, size), (size,)):
        raise InvalidValueError(
            "the weight has another size", where=where, given=weight.shape, allowed=allowed
        )
    check_finite(weight, where)
    # Symmetric, up to rounding.
    matrix = np.diag(weight) if weight.ndim == 1 else weight
    scale = float(np.abs(matrix).max(initial=0.0))
    gap = np.abs(matrix - matrix.T)
    if gap.max(initial=0.0) > SYMMETRIC * scale:
        i, j = (int(k) for k in np.unravel_index(int(gap.argmax()), gap.shape))
        raise InvalidValueError(
            "the weight is not symmetric",
            where=where,
            given=f"{float(matrix[i, j])!r} at ({i}, {j}), {float(matrix[j, i])!r} at ({j}, {i})",
            allowed="a symmetric matrix",
            hint=f"({where} + {where}.T) / 2",
        )
    matrix = 0.5 * (matrix + matrix.T)
    # Definite by its eigenvalues.
    values = np.linalg.eigvalsh(matrix) if size else np.zeros(0)
    smallest = float(values.min(initial=np.inf))
    bound = SEMIDEFINITE * float(np.abs(values).max(initial=0.0))
    if smallest <= bound if definite else smallest < -bound:
        raise InvalidValueError(
            f"the weight is not positive {'definite' if definite else 'semidefinite'}",
            where=where,
            given=f"smallest eigenvalue {smallest:.3g}",
            allowed="eigenvalues > 0" if definite else "eigenvalues >= 0",
        )
    return matrix


# Actuators that cannot do their work: cables between fixed points, cables without force.


def list_actuators(model: CompiledModel, names: Sequence[str]) -> tuple[Actuator | None, ...]:
    """Return the scene's actuators of these inputs, None for an input that is no actuator."""
    actuators = () if model.structure is None else model.structure.actuators
    by_name = {actuator.name: actuator for actuator in actuators}
    return tuple(by_name.get(name) for name in names)


def check_effects(model: CompiledModel, input_matrix: FloatArray, names: Sequence[str]) -> None:
    """Raise InvalidValueError for an actuator that changes nothing along a whole motion."""
    size = np.abs(input_matrix).max(axis=(0, 1), initial=0.0)
    idle = np.flatnonzero(size <= NO_EFFECT * size.max(initial=0.0))
    if not idle.size:
        return
    chosen = [names[int(k)] for k in idle]
    actuator = list_actuators(model, chosen)[0]
    reason = _describe_reason(model, actuator)
    raise InvalidValueError(
        "an actuator has no effect",
        where=f"actuators.{chosen[0]}",
        given=", ".join(chosen),
        allowed="actuators that move the structure",
        hint=f"{reason}: remove it from the actuators",
    )


def _describe_reason(model: CompiledModel, actuator: Actuator | None) -> str:
    structure = model.structure
    if actuator is None or structure is None:
        return "the accelerations do not depend on it"
    names = ", ".join(structure.member_name[e] for e in actuator.members)
    ends = structure.connectivity[list(actuator.members)]
    if _select_fixed(structure)[ends].all():
        return f"{names} connects points that cannot move"
    return f"{names} is slack during the whole motion, or its force has no component along a coordinate"


def _select_fixed(structure: Structure | BodySystem) -> NDArray[np.bool_]:
    """Return which nodes cannot move, (n_nodes,)."""
    if isinstance(structure, BodySystem):
        return np.array([isinstance(structure.bodies[k], FixedBody) for k in structure.node_body.tolist()])
    return np.asarray(structure.node_anchored[:, list(structure.axes)].all(axis=1))
