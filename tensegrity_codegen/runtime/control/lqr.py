"""Linear-quadratic feedback along a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.errors import FormulationError, InvalidValueError, check_choice
from tensegrity_codegen.runtime.control.design.at_rest import build_rest
from tensegrity_codegen.runtime.control.design.effects import check_effects
from tensegrity_codegen.runtime.control.design.free_motions import name_free_motions
from tensegrity_codegen.runtime.control.design.gains import Gains
from tensegrity_codegen.runtime.control.design.linear_samples import sample_linear_models
from tensegrity_codegen.runtime.control.design.reachable import (
    HiddenMode,
    describe_direction,
    find_uncontrolled,
)
from tensegrity_codegen.runtime.control.design.riccati import find_stationary, step_back
from tensegrity_codegen.runtime.control.design.weights import read_weight
from tensegrity_codegen.runtime.control.loop.actuator_bounds import find_bounds
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.model.arrays import check_finite
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs
from tensegrity_codegen.runtime.model.require import require_model
from tensegrity_codegen.runtime.model.state_names import name_states
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium

__all__ = ["design_lqr"]

FloatArray = NDArray[np.float64]


def design_lqr(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    sample: float = 0.005,
    integral_action: ArrayLike | Sequence[str] | None = None,
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
    arguments : mapping, optional
        Run-time parameters where they differ from the scene.

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
    way = motion if isinstance(motion, Motion) else build_rest(model, motion, sample, arguments)
    if not way.actuators:
        raise InvalidValueError(
            "the motion has no actuators", where="motion.actuators", allowed="at least one actuator"
        )
    find_bounds(model, way)
    names = name_states(model.manifest)
    output, labels = _read_outputs(integral_action, model, names)
    n, k, m = len(names), len(output), len(way.actuators)
    over = f"{n} states (q, q')" + (f" and {k} sums" if k else "")
    q = read_weight(Q, n + k, "Q", over, definite=False)
    r = read_weight(R, m, "R", f"{m} actuators", definite=True)
    samples = sample_linear_models(model, way, sample, way.actuators, arguments)
    check_effects(model, samples.gain, way.actuators)
    a, b = _augment(samples.A[-1], samples.B[-1], output)
    hidden = find_uncontrolled(a, b)
    if hidden:
        end, given = way.at(way.duration).coordinate, merge_inputs(model.manifest, arguments)
        rigid = name_free_motions(model, end, samples.gain[-1, n // 2 :], given)
        _refuse(model.manifest.name, hidden, rigid, (*names, *labels))
    p, residual = find_stationary(a, b, q, r, f"{model.manifest.name}: design_lqr")
    costs, gains = [p], [step_back(p, a, b, q, r)[1]]
    for a_k, b_k in zip(samples.A[-2::-1], samples.B[-2::-1], strict=True):
        earlier, gain = step_back(costs[-1], *_augment(a_k, b_k, output), q, r)
        costs.append(earlier)
        gains.append(gain)
    return Gains(
        time=samples.time,
        K=np.array(gains[::-1]),
        S=np.array(costs[::-1]),
        E=np.linalg.eigvals(a - b @ gains[0]).astype(np.complex128),
        A=samples.A[-1],
        B=samples.B[-1],
        integral_action=output,
        sample=sample,
        residual=residual,
        actuators=way.actuators,
        state_name=names,
        integral_name=labels,
    )


def _augment(a: FloatArray, b: FloatArray, output: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the model with the sums of outputs as further states."""
    n, k = len(a), len(output)
    whole = np.zeros((n + k, n + k))
    whole[:n, :n], whole[n:, :n], whole[n:, n:] = a, output, np.eye(k)
    return whole, np.vstack([b, np.zeros((k, b.shape[1]))])


def _read_outputs(
    value: ArrayLike | Sequence[str] | None, model: CompiledModel, names: tuple[str, ...]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return C (n_integrals, n_x) and the names of its rows."""
    n = len(names)
    if value is None:
        return np.zeros((0, n)), ()
    items = [value] if isinstance(value, str) else value
    if not isinstance(items, np.ndarray) and all(isinstance(item, str) for item in items):  # type: ignore[union-attr]
        known = names[: n // 2]
        for item in items:  # type: ignore[union-attr]
            check_choice(item, known, "coordinate", "integral_action")
        chosen = [str(item) for item in items]  # type: ignore[union-attr]
        return np.eye(n)[[known.index(item) for item in chosen]], tuple(f"sum of {item}" for item in chosen)
    try:
        output = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        output = np.zeros(())
    if output.ndim != 2 or output.shape[1] != n:
        raise InvalidValueError(
            "wrong shape",
            where="integral_action",
            given=output.shape,
            allowed=f"shape (n_integrals, {n}), or names of coordinates",
        )
    check_finite(output, "integral_action")
    return output, tuple(f"sum {k + 1}" for k in range(len(output)))


def _refuse(
    scene: str, hidden: Sequence[HiddenMode], rigid: Sequence[str], names: tuple[str, ...]
) -> NoReturn:
    """Raise FormulationError for modes that do not decay and that the actuators cannot change."""
    first = hidden[0]
    reason = describe_direction(first.direction, names)
    if rigid:
        reason = f"rigid motions of the whole structure: {', '.join(rigid)}"
    raise FormulationError(
        f"the actuators cannot stabilise the motion; not changed: {reason}",
        where=f"{scene}: design_lqr",
        given=f"{len(hidden)} uncontrolled {'mode' if len(hidden) == 1 else 'modes'}; "
        f"rank {first.rank} of {first.size} at eigenvalue {_tell(first.eigenvalue)}",
        allowed="actuators that change every motion that does not decay",
        hint="anchor a structure that can move freely; sum fewer outputs; or add actuators",
    )


def _tell(value: complex) -> str:
    return f"{value.real:.6g}" if abs(value.imag) < 1e-9 else f"{value:.6g}"
