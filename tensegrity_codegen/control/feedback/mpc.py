"""Model-predictive control along a motion: the design that `build_controller` writes in C."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    check_still_feet,
    find_reference,
    linearise,
)
from tensegrity_codegen.control.feedback.kalman import count_substeps
from tensegrity_codegen.control.feedback.loop.actuator_bounds import find_bounds
from tensegrity_codegen.control.feedback.loop.tension_distribution import CableTensions, find_cables
from tensegrity_codegen.control.feedback.lqr import design_lqr, read_weight
from tensegrity_codegen.runtime.model.arguments import merge_inputs
from tensegrity_codegen.runtime.model.arrays import to_doubles, to_each
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive, check_whole
from tensegrity_codegen.system.errors import InvalidValueError, check_choice
from tensegrity_codegen.system.summaries import Summarised

HORIZON = 20  # commands
MAX_HORIZON = 200
SOFT_WEIGHT = 100.0  # of the excess over least tensions and ranges of coordinates, over the largest weight


@dataclass(frozen=True, eq=False, repr=False)
class Mpc(Summarised):
    """Model-predictive control along a motion, as of `design_mpc`.

    Attributes
    ----------
    gains : Gains
        Linear-quadratic regulator without delays, whose cost is that of everything after the horizon.
    Q : ndarray, shape (n_states, n_states)
        Weight of coordinates, velocities and sums.
    R : ndarray, shape (n_actuators, n_actuators)
        Weight of the actuators' inputs.
    blocks : tuple of int
        Numbers of commands with the same deviation from the motion's; their sum is the horizon.
    cables : CableTensions
        Members that actuators pull.
    least_tension : ndarray, shape (n_members,) [N]
        Least tensions of members that actuators pull; -infinity if there is none.
    coordinate_range : ndarray, shape (n_coordinates, 2)
        Least and largest coordinates; infinite if there is none.
    soft_weight : float
        Weight of the excess over least tensions and coordinate ranges, over the largest entry of Q and R.
    substeps : int
        Runge-Kutta steps in a sample.
    """

    gains: Gains
    Q: FloatArray
    R: FloatArray
    blocks: tuple[int, ...]
    cables: CableTensions
    least_tension: FloatArray
    coordinate_range: FloatArray
    soft_weight: float
    substeps: int

    @property
    def excess_weight(self) -> float:
        """Weight of the excess over least tensions and coordinate ranges."""
        return self.soft_weight * float(max(np.abs(self.Q).max(), np.abs(self.R).max()))

    @property
    def horizon(self) -> int:
        """Number of commands in the horizon."""
        return sum(self.blocks)


def design_mpc(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    sample: float = 0.005,
    horizon: int = HORIZON,
    blocks: Sequence[int] | None = None,
    integral_action: ArrayLike | Sequence[str] | None = None,
    least_tension: ArrayLike | None = None,
    coordinate_range: Mapping[str, Sequence[float]] | None = None,
    soft_weight: float = SOFT_WEIGHT,
    arguments: Mapping[str, Any] | None = None,
) -> Mpc:
    """Return model-predictive control along a motion, for `build_controller` and `simulate_control_batch`.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene; its coordinates are independent of each other.
    motion : Motion or Equilibrium
        The motion, or the equilibrium to hold.
    Q, R : array_like
        Weights of states and inputs, as of `design_lqr`.
    sample : float [s]
        Time between two commands.
    horizon : int
        Number of commands that are planned at each sample, 1 to 200.
    blocks : sequence of int, optional
        Numbers of commands that have the same deviation from the motion, whose sum is the horizon; by default
        1, 1, 2, 4 and the rest. Fewer blocks are faster.
    integral_action : array_like or sequence of str, optional
        The summed errors, as of `design_lqr`.
    least_tension : float or array_like, shape (n_members,), optional [N]
        Least tensions of the members that actuators pull, but no more than the least on the motion; by
        default those of the scene's ``[limits]``, and 0 for other cables. -infinity: none.
    coordinate_range : mapping of str to (least, largest), optional
        Limits of coordinates by name [m, rad].
    soft_weight : float
        Weight of a metre of rest length that misses a least tension, and of a unit beyond a coordinate's
        range, over the largest entry of Q and R.
    arguments : mapping, optional
        Run-time parameters that the controller knows, if they differ from the scene.

    Returns
    -------
    Mpc
        The design; delays, rates and ranges are those of the actuators of the loop.

    Raises
    ------
    InvalidValueError, NonFiniteError, UnknownNameError
        A weight, horizon, block, tension or range that is out of range, or an unknown coordinate.
    FormulationError, ConvergenceError
        As `design_lqr`; or an actuator pulls a member that is not a linear spring.

    Notes
    -----
    At each sample one step of sequential quadratic programming about the plan of the last sample (M. Diehl,
    H. G. Bock, J. P. Schloeder, SIAM Journal on Control and Optimization 43, 2005): least sum of x^T Q x +
    u^T R u over the horizon, plus the cost of the linear-quadratic regulator after it, of the deviations
    from the motion. States follow the equations of motion by Runge-Kutta steps of order four with exact
    derivatives; commands on their way are known. Rates and ranges are kept exactly, least tensions and
    coordinate ranges if it is possible, by a quadratic weight of what exceeds them at the ends of the
    blocks. With blocks of one command, and if no limit is active, the command is that of `design_lqr`
    for a linear model.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import compile_scene, design_mpc, find_equilibrium
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> design_mpc(model, find_equilibrium(model), [100.0, 1.0], [1.0], sample=0.02).blocks
    (1, 1, 2, 4, 12)
    """
    gains = design_lqr(
        model, motion, Q, R, sample=sample, integral_action=integral_action, delay=0.0, arguments=arguments
    )
    n, m = len(gains.S[-1]), len(gains.actuators)
    reference = find_reference(model, motion, sample, arguments)
    check_still_feet(model, reference, "model-predictive control")
    # A member whose tension is below its least one on the motion keeps the tension of the motion.
    structure = model.structure
    assert structure is not None  # design_lqr refuses models without
    usual = structure.limits.least_tension
    usual = np.where(np.isfinite(usual) | structure.is_bar, usual, 0.0)
    stated = usual if least_tension is None else least_tension
    count = len(model.manifest.member_name)
    allowed = f"a tension [N], or one for each of {count} members"
    least = to_each(stated, count, "least_tension", lambda x: x < np.inf, allowed)
    given, times = merge_inputs(model.manifest, arguments), np.linspace(0.0, reference.duration, 3).tolist()
    least = np.minimum(least, np.where(np.isfinite(least), reference.member_tension.min(axis=0), np.inf))
    cables = find_cables(model, find_bounds(model, reference, may_lag=True), least, given)
    return Mpc(
        gains=gains,
        Q=read_weight(Q, n, "Q", f"{n} states and sums", definite=False),
        R=read_weight(R, m, "R", f"{m} actuators", definite=True),
        blocks=_read_blocks(horizon, blocks),
        cables=cables,
        least_tension=least,
        coordinate_range=_read_ranges(coordinate_range, gains.state_name[: len(gains.state_name) // 2]),
        soft_weight=check_positive(soft_weight, "soft_weight"),
        substeps=count_substeps([linearise(model, reference, t, (), given)[0] for t in times], sample),
    )


def _read_blocks(horizon: int, blocks: Sequence[int] | None) -> tuple[int, ...]:
    """Return the numbers of commands of the blocks, whose sum is the horizon."""
    check_whole(horizon, "horizon", 1, MAX_HORIZON)
    if blocks is None:
        ends = [end for end in (1, 2, 4, 8) if end < horizon]
        return tuple(np.diff([0, *ends, horizon]).tolist())
    found = tuple(check_whole(item, f"blocks[{k}]", 1) for k, item in enumerate(blocks))
    if sum(found) != horizon:
        raise InvalidValueError(
            "the blocks do not make the horizon",
            where="blocks",
            given=f"{', '.join(map(str, found))}: {sum(found)} commands",
            allowed=f"whole numbers whose sum is the horizon, {horizon}",
        )
    return found


def _read_ranges(given: Mapping[str, Sequence[float]] | None, names: tuple[str, ...]) -> FloatArray:
    """Return the least and largest value of each coordinate."""
    found = np.tile([-math.inf, math.inf], (len(names), 1))
    for name, pair in (given or {}).items():
        check_choice(name, names, "coordinate", "coordinate_range")
        where, allowed = f"coordinate_range.{name}", "least < largest"
        values = to_doubles(pair, where, allowed)
        if values.shape != (2,) or not values[0] < values[1]:
            raise InvalidValueError("not a range", where=where, given=pair, allowed=allowed)
        found[names.index(name)] = values
    return found
