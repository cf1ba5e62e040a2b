"""Tensions that give the forces which feedback asks for, above the least tensions and near preferred ones."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.control.feedback.design.linear_samples import check_motion, to_dense
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds, find_bounds
from tensegrity_codegen.control.feedback.loop.cable_tensions import (
    CableTensions,
    TensionLine,
    TensionProgram,
    find_cables,
)
from tensegrity_codegen.control.planning.quadratic_program import require_solver
from tensegrity_codegen.runtime.model.arrays import to_each
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs
from tensegrity_codegen.runtime.model.require import require_model, require_quantities
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import Summarised

QUANTITIES = ("member_length", "equilibrium_matrix")
WEIGHT = 1e-6  # of preferred tensions, over the mean square of the equilibrium matrix
FORCE_TOLERANCE = 1e-3  # part of the tensions, by which forces may differ from those asked for
ROUNDING = 1e-9  # [m]
PASSES = 4  # of Newton's method, which tensions that are not linear in rest lengths need


@dataclass(frozen=True)
class Distributed:
    """The command of one sample.

    Attributes
    ----------
    command : ndarray, shape (n_actuators,) [m]
        Inputs of the actuators, within rate and range.
    status : str
        ``"ok"``, ``"rate_limited"``, ``"range_limited"``, ``"tension_limited"``, ``"least_tension"`` or
        ``"not_solved"``.
    yielding : ndarray of bool, shape (n_members,)
        Members whose least tension cannot be reached within rate and range.
    """

    command: FloatArray
    status: str
    yielding: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, repr=False)
class TensionDistribution(Summarised):
    """A quadratic program for the tensions of each sample; as of `design_distribution`.

    Attributes
    ----------
    model : CompiledModel
        The model that the controller knows.
    motion : Motion
        The motion, with the preferred tensions where none are given.
    bounds : ActuatorBounds
        Rates and ranges.
    cables : CableTensions
        Rest lengths and laws of the members.
    least_tension : ndarray, shape (n_members,) [N]
        Least tensions; -infinity where there is none.
    preferred : ndarray, shape (n_members,) [N], or None
        Preferred tensions; None: those of the motion.
    weight : float
        eps over the mean square of the entries of A.
    """

    model: CompiledModel
    motion: Motion
    bounds: ActuatorBounds
    cables: CableTensions
    least_tension: FloatArray
    preferred: FloatArray | None
    weight: float

    def distribute(
        self, time: float, coordinate: FloatArray, wanted: FloatArray, low: FloatArray, high: FloatArray
    ) -> Distributed:
        """Return the command of a sample.

        Parameters
        ----------
        time : float [s]
            Time of the sample.
        coordinate : ndarray, shape (n_coordinates,)
            Coordinates, true or estimated.
        wanted : ndarray, shape (n_actuators,) [m]
            Inputs that feedback asks for.
        low, high : ndarray, shape (n_actuators,) [m]
            Bounds of the command by rates and ranges.

        Returns
        -------
        Distributed
            Command, status, members whose least tension yields.
        """
        # Members, and the bounds of the inputs by rates, ranges and least tensions.
        at = {"coordinate": coordinate}
        length = np.asarray(self.model.compute("member_length", **at))
        whole = to_dense(self.model.compute("equilibrium_matrix", **at))
        others, driven, cables = self.motion.at(time).input, self.cables.driven, self.cables
        top, yielding = self._find_upper_bounds(others, length, low)
        most, shared = self._apply_upper_bounds(top, high), np.isin(cables.limited, cables.shared)
        # Tensions that feedback asks for, and those preferred.
        asked = cables.tension(length, cables.rest_length(others, wanted))[driven]
        preferred, command = self._find_preferred(time)[driven], np.clip(wanted, low, most)
        a = whole[:, driven]
        # Newton's method: a program about each command, with tensions as straight lines.
        for _ in range(1 if cables.is_one_to_one else PASSES):
            rest = cables.rest_length(others, command)
            program = TensionProgram(
                a / np.sqrt(max(float(np.mean(whole**2)), np.finfo(float).tiny)),
                cables.tension(length, rest)[driven],
                (cables.slope(length, rest)[:, None] * cables.incidence)[driven],
            )
            line = TensionLine(cables, length, others, command)
            limits = (line.to_change(low), line.to_change(most), cables.incidence[cables.shared], top[shared])
            change = program.solve(asked, preferred, self.weight, command, limits)
            if change is None:
                return Distributed(np.clip(wanted, low, high), "not_solved", yielding)
            command = np.clip(line.to_input(change), low, most)
            if np.abs(change).max() < ROUNDING:
                break
        # Whether the forces are those asked for.
        reached = cables.tension(length, cables.rest_length(others, command))[driven]
        missed = float(np.abs(a @ (reached - asked)).max())
        scale = float(np.abs(whole).max()) * float(np.abs(asked).max(initial=0.0))
        status = self._find_status(
            command, low, high, missed <= FORCE_TOLERANCE * scale, bool(yielding.any())
        )
        return Distributed(command, status, yielding)

    def _apply_upper_bounds(self, top: FloatArray, high: FloatArray) -> FloatArray:
        """Return the upper bounds of inputs (n_actuators,) [m]: of rate, range, and members pulled by one."""
        most = high.copy()
        for bound, row in zip(top.tolist(), self.cables.incidence[self.cables.limited], strict=True):
            if row.sum() == 1.0:
                most[row > 0.0] = np.minimum(most[row > 0.0], bound)
        return most

    def _find_upper_bounds(
        self, others: FloatArray, length: FloatArray, low: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return bounds of the inputs of limited members [m], and which members cannot meet them."""
        rows = self.cables.limited
        base = self.cables.rest_length(others, np.zeros(len(low)))[rows]
        longest = self.cables.find_rest_length(length, self.least_tension)[rows]
        top, least = longest - base, self.cables.incidence[rows] @ low
        yielding = np.zeros(len(length), dtype=bool)
        yielding[rows] = top < least - ROUNDING
        return np.maximum(top, least), yielding

    def _find_preferred(self, time: float) -> FloatArray:
        if self.preferred is not None:
            return self.preferred
        motion = self.motion
        columns = [np.interp(time, motion.time, column) for column in motion.member_tension.T]
        return np.array(columns)

    def _find_status(
        self, command: FloatArray, low: FloatArray, high: FloatArray, is_met: bool, yields: bool
    ) -> str:
        if yields:
            return "least_tension"
        if is_met:
            return "ok"
        at_bound = (command <= low + ROUNDING) | (command >= high - ROUNDING)
        ranged = (command <= self.bounds.least + ROUNDING) | (command >= self.bounds.most - ROUNDING)
        if (at_bound & ~ranged).any():
            return "rate_limited"
        return "range_limited" if ranged.any() else "tension_limited"


def design_distribution(
    model: CompiledModel,
    motion: Motion,
    *,
    least_tension: ArrayLike | None = None,
    preferred: ArrayLike | None = None,
    weight: float = WEIGHT,
    arguments: Mapping[str, Any] | None = None,
) -> TensionDistribution:
    """Return the distribution of tensions for a motion.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene.
    motion : Motion
        The motion; its tensions are the preferred ones by default.
    least_tension : float or array_like, shape (n_members,), optional [N]
        Least tensions of the members that actuators pull; by default those of the scene's ``[limits]``.
    preferred : float or array_like, shape (n_members,), optional [N]
        Preferred tensions.
    weight : float
        eps over the mean square of the entries of A.
    arguments : mapping, optional
        Rest lengths and stiffnesses that the controller knows, where they differ from the scene.

    Returns
    -------
    TensionDistribution
        For `simulate_control`.

    Raises
    ------
    InvalidValueError, NonFiniteError
        A value out of range, or a least tension that the range of an actuator does not allow: which cable.
    FormulationError
        The model lacks a quantity, or a member has a law that is not a linear spring.
    MissingExtraError
        DAQP is not installed.

    Notes
    -----
    Least `|A (T - T_lqr)|^2 + eps |T - T_preferred|^2` over the inputs of the actuators, by
    Gauss-Newton steps; A T are the forces of tensions on the coordinates. Bounds are exact: rates,
    ranges, and of each cable rho <= EA l / (EA + t_min), or l - t_min / k. T_lqr follows the law of a taut
    cable below zero tension too. By DAQP (D. Arnström, A. Bemporad, D. Axehill, IEEE Transactions on
    Automatic Control 67, 2022).

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, design_distribution, plan, time_motion
    >>> model = compile_scene("prism12.toml", for_=("plan", "time_motion", "control"))
    >>> motion = time_motion(model, plan(model, "twist=157", steps=2), duration=1.0)
    >>> design_distribution(model, motion, least_tension=1.0).least_tension[-1].tolist()
    1.0
    """
    require_model(model)
    require_solver()
    check_motion(model, motion)
    require_quantities(model, QUANTITIES, "a distribution of tensions needs")
    bounds = find_bounds(model, motion)
    structure = model.structure
    assert structure is not None  # find_bounds refuses models without
    count = len(model.manifest.member_name)
    stated = structure.limits.least_tension if least_tension is None else least_tension
    least = _read(stated, count, "least_tension")
    chosen = None if preferred is None else _read(preferred, count, "preferred")
    if chosen is not None and not np.isfinite(chosen).all():
        raise InvalidValueError(
            "out of range", where="preferred", given=preferred, allowed="finite tensions [N]"
        )
    check_positive(weight, "weight")
    cables = find_cables(model, bounds, least, merge_inputs(model.manifest, arguments))
    _check_reach(model, motion, bounds, cables, least)
    return TensionDistribution(model, motion, bounds, cables, least, chosen, weight)


def _read(value: ArrayLike, count: int, where: str) -> FloatArray:
    allowed = f"a tension [N], or one for each of {count} members"
    return to_each(value, count, where, lambda x: x < np.inf, allowed)


def _check_reach(
    model: CompiledModel, motion: Motion, bounds: ActuatorBounds, cables: CableTensions, least: FloatArray
) -> None:
    """Raise InvalidValueError for a least tension that a range does not allow somewhere along a motion."""
    for time, q in zip(motion.time.tolist(), motion.coordinate, strict=True):
        length = np.asarray(model.compute("member_length", coordinate=q))
        shortest = cables.rest_length(motion.at(time).input, bounds.least)
        longest = cables.find_rest_length(length, least)
        short = [e for e in cables.limited.tolist() if longest[e] < shortest[e] - ROUNDING]
        if short:
            e = short[0]
            most = float(cables.tension(length, shortest)[e])
            raise InvalidValueError(
                "the range of an actuator does not allow the least tension",
                where=f"least_tension of {model.manifest.member_name[e]}",
                given=f"{least[e]:g} N, at t = {time:.4g} s a rest length of {longest[e]:.6g} m",
                allowed=f"at most {most:.4g} N, with the shortest rest length of {shortest[e]:.6g} m",
                hint="a smaller least tension, or a larger range",
            )
