"""Tensions that give the forces which feedback asks for, above the least tensions and near preferred ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.control.feedback.design.linear_samples import (
    check_motion,
    find_reference,
    require_no_rigid_bars,
    to_dense,
)
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds, find_bounds
from tensegrity_codegen.control.planning.quadratic_program import find_nearest, require_solver
from tensegrity_codegen.runtime.model.arguments import merge_inputs
from tensegrity_codegen.runtime.model.arrays import to_each
from tensegrity_codegen.runtime.model.interface import require_model, require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.bodies import BodyInput
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tensegrity_codegen.system.summaries import Summarised
from tensegrity_codegen.tables.laws import LINEAR

QUANTITIES = ("member_length", "equilibrium_matrix")
WEIGHT = 1e-6  # of preferred tensions, over the mean square of the equilibrium matrix
FORCE_TOLERANCE = 1e-3  # part of the tensions, by which forces may differ from those asked for
ROUNDING = 1e-9  # [m]
PASSES = 4  # of Newton's method, which tensions that are not linear in rest lengths need

LONGEST_REST = 100.0  # rest length over length, up to which tensions are counted with
IDLE_WEIGHT = 1e-9  # part of the weight, for inputs that change no tension
TOLERANCE = 1e-12  # of bounds, over the largest tension (1 N at least)


@dataclass(frozen=True)
class CableTensions:
    """Linear springs t = (k + EA / rho) (l - rho), taut or not, with rest lengths moved by actuators."""

    spring_constant: FloatArray  # (n_members,) [N/m, N]: k and EA
    axial_stiffness: FloatArray  # (n_members,) [N/m, N]
    base: FloatArray  # (n_members,) [m]: rest lengths without inputs
    incidence: FloatArray  # (n_members, n_actuators): which actuators change which rest lengths
    other_incidence: FloatArray  # (n_members, n_inputs): gains of the inputs that are not these actuators
    limited: NDArray[np.int64]  # (n_limited,): members that actuators pull and that have a least tension

    @property
    def driven(self) -> NDArray[np.int64]:
        """Members that actuators pull, (n_driven,)."""
        return np.flatnonzero(self.incidence.any(axis=1)).astype(np.int64)

    @property
    def shared(self) -> NDArray[np.int64]:
        """Limited members that several actuators pull, (n_shared,)."""
        several: NDArray[np.bool_] = self.incidence[self.limited].sum(axis=1) > 1.0
        return self.limited[several]

    @property
    def is_one_to_one(self) -> bool:
        """Whether each actuator pulls one member, and no member has several actuators."""
        counts = self.incidence.sum(axis=0), self.incidence.sum(axis=1)
        return bool((counts[0] == 1.0).all() and (counts[1] <= 1.0).all())

    def rest_length(self, inputs: FloatArray, change: FloatArray) -> FloatArray:
        """Return rest lengths (n_members,) [m] for inputs (n_inputs,) and those of the actuators."""
        rest_length: FloatArray = self.base + self.other_incidence @ inputs + self.incidence @ change
        return rest_length

    def tension(self, length: FloatArray, rest: FloatArray) -> FloatArray:
        """Return tensions (n_members,) [N]; negative where a cable is slack."""
        return (self.spring_constant + self.axial_stiffness / rest) * (length - rest)

    def slope(self, length: FloatArray, rest: FloatArray) -> FloatArray:
        """Return the derivatives of tensions by rest lengths, (n_members,) [N/m]."""
        return -(self.spring_constant + self.axial_stiffness * length / rest**2)

    def find_rest_length(self, length: FloatArray, tension: FloatArray) -> FloatArray:
        """Return the rest lengths [m] at which tensions are reached; infinite if any one does."""
        stiffness = {"spring_constant": self.spring_constant, "axial_stiffness": self.axial_stiffness}
        rest_length = np.full(len(length), np.inf)
        finite = np.isfinite(tension) & (self.spring_constant + self.axial_stiffness > 0.0)
        rest_length[finite] = LINEAR.find_rest_length(length, np.where(finite, tension, 0.0), stiffness)[
            finite
        ]
        return rest_length


def find_cables(
    model: CompiledModel, bounds: ActuatorBounds, least: FloatArray, arguments: Mapping[str, Any]
) -> CableTensions:
    """Return the members of a model as functions of its actuators."""
    structure = model.structure
    assert structure is not None
    count = structure.n_members
    # Which actuators pull which members, all of them linear springs.
    incidence = np.zeros((count, len(bounds.names)))
    for column, members in enumerate(bounds.members):
        incidence[list(members), column] = 1.0
    bent = np.flatnonzero(incidence.any(axis=1) & ~structure.is_linear)
    if bent.size:
        raise FormulationError(
            "tensions are distributed over linear springs only",
            where=f"{structure.name}: {structure.member_name[int(bent[0])]}",
            given=structure.law_of(int(bent[0])).name,
            allowed="members with spring_constant or axial_stiffness alone",
        )
    # Inputs that are not these actuators.
    other_incidence = np.zeros((count, len(structure.inputs)))
    inputs: Sequence[ActuatedInput | BodyInput] = structure.inputs
    for column, scene_input in enumerate(inputs):
        for e, gain in scene_input.rest_length_gain.items() if column not in bounds.place.tolist() else ():
            other_incidence[e, column] = gain
    # Stiffnesses and rest lengths: of the scene, or as given.
    values = {
        name: np.array(getattr(structure, name), dtype=float)
        for name in ("spring_constant", "axial_stiffness", "rest_length")
    }
    for name, value in values.items():
        spec = model.manifest.find_argument(name)
        if spec is not None and name in arguments:
            rows = [structure.member_name.index(member) for member in spec.over]
            value[rows] = np.asarray(arguments[name], dtype=float).ravel()
    limited = np.flatnonzero(incidence.any(axis=1) & np.isfinite(least))
    return CableTensions(
        values["spring_constant"],
        values["axial_stiffness"],
        values["rest_length"],
        incidence,
        other_incidence,
        limited.astype(np.int64),
    )


# The quadratic program of a distribution of tensions about one command.


@dataclass(frozen=True, eq=False)
class TensionLine:
    """Tensions as straight lines of changes of a command.

    If each actuator pulls one member, changes stand for tensions, so that lines and bounds are exact.
    """

    cables: CableTensions
    length: FloatArray
    others: FloatArray
    command: FloatArray

    def to_change(self, inputs: FloatArray) -> FloatArray:
        """Return the changes (n_actuators,) [m] at which the lines have the tensions of inputs."""
        plain = inputs - self.command
        if not self.cables.is_one_to_one:
            return plain
        rest_length = self.cables.rest_length(self.others, np.where(np.isfinite(inputs), inputs, 0.0))
        high = self.cables.incidence @ np.where(inputs == np.inf, 1.0, 0.0) > 0.0
        rest_length = np.where(
            high, LONGEST_REST * self.length, np.minimum(rest_length, LONGEST_REST * self.length)
        )
        slope, tension = self._at_command()
        with np.errstate(all="ignore"):
            change = (self.cables.tension(self.length, rest_length) - tension) / slope
        change = np.where(rest_length > 0.0, change, -np.inf)[self._member()]
        return np.where(slope[self._member()] < 0.0, change, plain)

    def to_input(self, change: FloatArray) -> FloatArray:
        """Return the inputs (n_actuators,) [m] that have the tensions of changes on the lines."""
        plain = self.command + change
        if not self.cables.is_one_to_one:
            return plain
        slope, tension = self._at_command()
        reached = tension + slope * (self.cables.incidence @ change)
        rest_length = self.cables.find_rest_length(self.length, reached)
        base = self.cables.rest_length(self.others, np.zeros(len(change)))
        return np.where(slope[self._member()] < 0.0, (rest_length - base)[self._member()], plain)

    def _member(self) -> NDArray[np.int64]:
        member: NDArray[np.int64] = np.argmax(self.cables.incidence, axis=0).astype(np.int64)
        return member

    def _at_command(self) -> tuple[FloatArray, FloatArray]:
        rest_length = self.cables.rest_length(self.others, self.command)
        return self.cables.slope(self.length, rest_length), self.cables.tension(self.length, rest_length)


@dataclass(frozen=True, eq=False)
class TensionProgram:
    """The quadratic program about one command.

    a: equilibrium matrix of the members that actuators pull, over the root of the mean square of all entries;
    tension (n_driven,) [N]; moved (n_driven, n_actuators): derivatives of tensions by the inputs [N/m].
    """

    a: FloatArray
    tension: FloatArray
    moved: FloatArray

    def solve(
        self,
        asked: FloatArray,
        preferred: FloatArray,
        weight: float,
        command: FloatArray,
        limits: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    ) -> FloatArray | None:
        """Return the change of the command (n_actuators,) [m]; None if the solver fails."""
        low, high, rows, top = limits
        size = np.linalg.norm(self.moved, axis=0)
        size = np.where(size > 0.0, size, max(float(size.max(initial=0.0)), 1.0))
        change, root = self.moved / size, np.sqrt(weight)
        idle = root * np.sqrt(IDLE_WEIGHT) * np.eye(len(size))
        solution = find_nearest(
            np.vstack([self.a @ change, root * change, idle]),
            np.concatenate(
                [self.a @ (asked - self.tension), root * (preferred - self.tension), np.zeros(len(size))]
            ),
            np.vstack([np.eye(len(size)), rows]) / size,
            np.concatenate([low, np.full(len(top), -np.inf)]),
            np.concatenate([high, top - rows @ command]),
            tolerance=TOLERANCE * max(1.0, float(np.abs(asked).max(initial=0.0))),
        )
        return None if solution is None else solution.x / size


# The distribution at each sample of a motion.


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
        The motion, with the preferred tensions if none are given.
    bounds : ActuatorBounds
        Rates and ranges.
    cables : CableTensions
        Rest lengths and laws of the members.
    least_tension : ndarray, shape (n_members,) [N]
        Least tensions; -infinity if there is none.
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
        matrix = to_dense(self.model.compute("equilibrium_matrix", **at))
        others, driven, cables = self.motion.at(time).input, self.cables.driven, self.cables
        top, yielding = self._compute_upper_bounds(others, length, low)
        upper, shared = self._apply_upper_bounds(top, high), np.isin(cables.limited, cables.shared)
        # Tensions that feedback asks for, and those preferred.
        requested = cables.tension(length, cables.rest_length(others, wanted))[driven]
        preferred, command = self._interpolate_preferred(time)[driven], np.clip(wanted, low, upper)
        a = matrix[:, driven]
        # Newton's method: a program about each command, with tensions as straight lines.
        for _ in range(1 if cables.is_one_to_one else PASSES):
            rest_length = cables.rest_length(others, command)
            program = TensionProgram(
                a / np.sqrt(max(float(np.mean(matrix**2)), np.finfo(float).tiny)),
                cables.tension(length, rest_length)[driven],
                (cables.slope(length, rest_length)[:, None] * cables.incidence)[driven],
            )
            line = TensionLine(cables, length, others, command)
            limits = (
                line.to_change(low),
                line.to_change(upper),
                cables.incidence[cables.shared],
                top[shared],
            )
            change = program.solve(requested, preferred, self.weight, command, limits)
            if change is None:
                return Distributed(np.clip(wanted, low, high), "not_solved", yielding)
            command = np.clip(line.to_input(change), low, upper)
            if np.abs(change).max() < ROUNDING:
                break
        # Whether the forces are those asked for.
        reached = cables.tension(length, cables.rest_length(others, command))[driven]
        missed = float(np.abs(a @ (reached - requested)).max())
        scale = float(np.abs(matrix).max()) * float(np.abs(requested).max(initial=0.0))
        status = self._judge_status(
            command, low, high, missed <= FORCE_TOLERANCE * scale, bool(yielding.any())
        )
        return Distributed(command, status, yielding)

    def _apply_upper_bounds(self, top: FloatArray, high: FloatArray) -> FloatArray:
        """Return the upper bounds of inputs (n_actuators,) [m]: of rate, range, and members pulled by one."""
        upper = high.copy()
        for bound, row in zip(top.tolist(), self.cables.incidence[self.cables.limited], strict=True):
            if row.sum() == 1.0:
                upper[row > 0.0] = np.minimum(upper[row > 0.0], bound)
        return upper

    def _compute_upper_bounds(
        self, others: FloatArray, length: FloatArray, low: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return bounds of the inputs of limited members [m], and which members cannot meet them."""
        rows = self.cables.limited
        base = self.cables.rest_length(others, np.zeros(len(low)))[rows]
        longest = self.cables.find_rest_length(length, self.least_tension)[rows]
        top, lower = longest - base, self.cables.incidence[rows] @ low
        yielding = np.zeros(len(length), dtype=bool)
        yielding[rows] = top < lower - ROUNDING
        return np.maximum(top, lower), yielding

    def _interpolate_preferred(self, time: float) -> FloatArray:
        if self.preferred is not None:
            return self.preferred
        motion = self.motion
        columns = [np.interp(time, motion.time, column) for column in motion.member_tension.T]
        return np.array(columns)

    def _judge_status(
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
    motion: Motion | Equilibrium,
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
    motion : Motion or Equilibrium
        The motion, or the equilibrium to hold; its tensions are the preferred ones by default.
    least_tension : float or array_like, shape (n_members,), optional [N]
        Least tensions of the members that actuators pull; by default those of the scene's ``[limits]``.
    preferred : float or array_like, shape (n_members,), optional [N]
        Preferred tensions.
    weight : float
        eps over the mean square of the entries of A.
    arguments : mapping, optional
        Rest lengths and stiffnesses that the controller knows, if they differ from the scene.

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
    motion = find_reference(model, motion, arguments=arguments)
    check_motion(model, motion)
    require_quantities(model, QUANTITIES, "a distribution of tensions needs")
    require_no_rigid_bars(model, "a distribution of tensions", "keep least tensions by design_mpc")
    bounds = find_bounds(model, motion)
    structure = model.structure
    assert structure is not None  # find_bounds refuses models without
    count = len(model.manifest.member_name)
    stated = structure.limits.least_tension if least_tension is None else least_tension
    tensions = _read(stated, count, "least_tension")
    chosen = None if preferred is None else _read(preferred, count, "preferred")
    if chosen is not None and not np.isfinite(chosen).all():
        raise InvalidValueError(
            "out of range", where="preferred", given=preferred, allowed="finite tensions [N]"
        )
    check_positive(weight, "weight")
    cables = find_cables(model, bounds, tensions, merge_inputs(model.manifest, arguments))
    _check_reach(model, motion, bounds, cables, tensions)
    return TensionDistribution(model, motion, bounds, cables, tensions, chosen, weight)


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
            reachable = float(cables.tension(length, shortest)[e])
            raise InvalidValueError(
                "the range of an actuator does not allow the least tension",
                where=f"least_tension of {model.manifest.member_name[e]}",
                given=f"{least[e]:g} N, at t = {time:.4g} s a rest length of {longest[e]:.6g} m",
                allowed=f"at most {reachable:.4g} N, with the shortest rest length of {shortest[e]:.6g} m",
                hint="a smaller least tension, or a larger range",
            )
