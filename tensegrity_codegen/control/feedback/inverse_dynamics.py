"""Inverse dynamics: the inputs and tensions that produce given accelerations, and those over a whole motion.

The equations of motion M q'' + A t = f hold in all formulations, with the tensions t of all members and the
force f of everything else. f follows from the model's own accelerations: f = M q''(q, q') + A t(q, q').
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from tensegrity_codegen.control.feedback.equilibrium_path import SmoothPath
from tensegrity_codegen.control.feedback.time_law import Peaks, TimeLaw, compute_peaks
from tensegrity_codegen.control.planning.plan_point import PlanModel
from tensegrity_codegen.runtime.model.interface import require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.constrained_problems import BodyProblem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import FormulationError, name_list

DYNAMIC_QUANTITIES = (
    "acceleration",
    "mass_matrix",
    "equilibrium_matrix",
    "member_tension",
    "tension_rest_length_derivative",
)
TENSION_WEIGHT = 1e3  # weight of differences of cable tensions over those of bar forces
RANK = 1e-10  # of the largest singular value: smaller ones count as zero
FORCE_WEIGHT = 1e6  # weight of forces over differences of tensions, where bounds are active
MAX_ITERATIONS, STEP_TOLERANCE = 12, 1e-12
BOUND_TOLERANCE = 1e-9  # of the tensions: violation of a bound that counts as none
DYNAMIC, STATIC = "dynamic", "static"
RESIDUAL_TOLERANCE = 1e-6  # of the largest tension: residual that counts as none


@dataclass(frozen=True)
class Drive:
    """The inputs and tensions that drive the motion at one time.

    change (n_actuators,) [m]: inputs; tension (n_members,) [N]; residual (n_coordinates,) [N]: force that is
    missing, coordinates of bodies scaled to metres; bounded (n_actuators,): at a bound of tension or range.
    """

    change: FloatArray
    tension: FloatArray
    residual: FloatArray
    bounded: BoolArray


@dataclass(frozen=True)
class _State:
    """One time: matrix A (n_coordinates, n_members), force A t, damping c l' (n_members,)."""

    coordinate: FloatArray
    matrix: FloatArray
    force: FloatArray
    damping: FloatArray


class InverseDynamics:
    """Inverse dynamics of a model with actuators.

    Tensions of cables without actuator follow from the coordinates. Forces of bars are free: those of rigid
    bars are multipliers, and elastic bars take the force that the motion needs by a small change of length.

    plan_model: the model, its actuators and arguments.
    coordinate (n_coordinates,): a configuration, by which coordinates of bodies are scaled.
    Raises FormulationError: the model lacks a quantity: without masses there are no accelerations.
    """

    def __init__(self, plan_model: PlanModel, coordinate: FloatArray) -> None:
        _check_quantities(plan_model.model)
        structure = plan_model.structure
        self.plan_model, self.model = plan_model, plan_model.model
        driven = plan_model.incidence.any(axis=1)
        self.bar = np.flatnonzero(np.asarray(structure.is_bar) & ~driven)
        # Damping of members [N s/m]: as stated, or as given among the arguments.
        self.damping = np.array(structure.damping)
        stated, manifest = plan_model.arguments.get("damping"), plan_model.model.manifest
        spec = manifest.find_argument("damping")
        if stated is not None and spec is not None:
            self.damping[[manifest.member_name.index(name) for name in spec.over]] = np.ravel(stated)
        one_sided = np.asarray(structure.tension_only)
        self.least = np.where(one_sided, np.maximum(structure.limits.least_tension, 0.0), -np.inf)
        self.most = np.asarray(structure.limits.most_tension)
        self.row = 1.0 / _compute_scale(plan_model, coordinate)

    def solve(
        self, q: FloatArray, v: FloatArray, a: FloatArray, change: FloatArray, preferred: FloatArray
    ) -> Drive:
        """Return the inputs for an acceleration; what they cannot produce is the residual."""
        # `change` [m]: inputs at which all cables that shall pull are in tension. If several tensions produce
        # the acceleration, those of actuated cables are near to `preferred` [N], in least squares.
        state = self._build_state(q, v, a, change)
        change, bars = change.copy(), preferred[self.bar].copy()
        bounded = np.zeros(len(change), dtype=bool)
        for _ in range(MAX_ITERATIONS):
            tension, slope = self._tensions(state, change, bars)
            step, pulled, bounded = self._step(state, change, tension, slope, preferred)
            change, bars = change + step, bars + pulled
            moved = np.abs(slope @ step).max(initial=0.0)
            if moved <= STEP_TOLERANCE * max(float(np.abs(tension).max(initial=0.0)), 1e-300):
                break
        tension, _ = self._tensions(state, change, bars)
        return Drive(change, tension, self.row * (state.force - state.matrix @ tension), bounded)

    def _build_state(self, q: FloatArray, v: FloatArray, a: FloatArray, change: FloatArray) -> _State:
        arguments = {**self.plan_model.arguments, "input": self.plan_model.inputs(change), "coordinate": q}
        mass = self.model.compute("mass_matrix", **arguments)
        matrix = np.asarray(self.model.compute("equilibrium_matrix", **arguments).toarray())
        acceleration = self.model.compute("acceleration", velocity=v, **arguments)
        tension = self.model.compute("member_tension", velocity=v, **arguments)
        return _State(q, matrix, mass @ (acceleration - a) + matrix @ tension, self.damping * (matrix.T @ v))

    def _tensions(self, state: _State, change: FloatArray, bars: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return tensions (n_members,) with these bar forces, slopes (n_members, n_actuators) by inputs."""
        arguments = {
            **self.plan_model.arguments,
            "input": self.plan_model.inputs(change),
            "coordinate": state.coordinate,
        }
        still = np.zeros(len(state.coordinate))
        tension = np.array(self.model.compute("member_tension", velocity=still, **arguments))
        tension = np.where(tension != 0.0, tension + state.damping, 0.0)
        tension[self.bar] = bars
        slope = np.asarray(self.model.compute("tension_rest_length_derivative", **arguments))
        return tension, slope[:, None] * self.plan_model.incidence

    def _step(
        self, state: _State, change: FloatArray, tension: FloatArray, slope: FloatArray, preferred: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the changes of inputs and bar forces by the equations linearised, and which are bounded."""
        # Changes of the inputs that lead nearest to the preferred tensions.
        size = np.linalg.norm(slope, axis=0)
        unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)  # 0: a slack cable stays slack
        nearest = (slope.T @ (preferred - tension)) * unit**2
        # The force that is missing then, by the smallest further changes.
        by_input, by_bar = self.row[:, None] * (state.matrix @ slope), state.matrix[:, self.bar]
        by_bar = self.row[:, None] * by_bar
        bar_change = preferred[self.bar] - tension[self.bar]
        missing = self.row * (state.force - state.matrix @ tension) - by_input @ nearest - by_bar @ bar_change
        columns = np.hstack([by_input * unit, TENSION_WEIGHT * by_bar])
        solution = np.linalg.lstsq(columns, missing, rcond=RANK)[0]
        # The same within bounds, where these changes exceed one.
        low, high = self._bounds(state, change, tension, slope, preferred)
        count, bounded = len(change), np.zeros(len(change), dtype=bool)
        slack, moving = BOUND_TOLERANCE * float(np.abs(tension).max(initial=1.0)), size > 0
        ends = [np.where(moving, end - nearest, 0.0) * size for end in (low, high)]
        low, high = np.where(moving, ends, [[-np.inf], [np.inf]])
        if np.any(solution[:count] < low - slack) or np.any(solution[:count] > high + slack):
            solution, bounded = _solve_bounded(columns, missing, low, high)
        return nearest + unit * solution[:count], bar_change + TENSION_WEIGHT * solution[count:], bounded

    def _bounds(
        self, state: _State, change: FloatArray, tension: FloatArray, slope: FloatArray, preferred: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the changes of inputs, (n_actuators,) each.

        Elastic and total tensions stay above the least, or above those preferred where these are below.
        """
        actuation = self.plan_model.actuation
        low, high = actuation.least_change - change, actuation.most_change - change
        lowest = np.minimum(self.least, preferred) + np.maximum(state.damping, 0.0)
        highest = np.maximum(self.most, preferred)
        with np.errstate(divide="ignore", invalid="ignore"):
            fall = np.where(slope < 0, (lowest - tension)[:, None] / slope, np.inf)
            rise = np.where(slope < 0, (highest - tension)[:, None] / slope, -np.inf)
        return np.maximum(low, rise.max(axis=0)), np.minimum(high, fall.min(axis=0))


def _solve_bounded(
    columns: FloatArray, missing: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the least y of least |columns y - missing| within bounds of the inputs, and which are active.

    The active bounds are those of the least |columns y - missing|^2 BALANCE^2 / |columns|^2 + |y|^2.
    """
    size, count = columns.shape[1], len(low)
    weight = FORCE_WEIGHT / max(float(np.linalg.norm(columns, 2)), 1e-300)
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    lower[:count], upper[:count] = low, high
    upper = np.maximum(upper, lower + 1e-12 * (1.0 + np.where(np.isfinite(lower), np.abs(lower), 0.0)))
    bounded = lsq_linear(
        np.vstack([weight * columns, np.eye(size)]),
        np.concatenate([weight * missing, np.zeros(size)]),
        bounds=(lower, upper),
        method="bvls",
        tol=1e-14,
    )
    y, active = np.array(bounded.x), np.asarray(bounded.active_mask != 0)
    exact, remainder = y.copy(), missing - columns[:, active] @ y[active]
    exact[~active] = np.linalg.lstsq(columns[:, ~active], remainder, rcond=RANK)[0]
    slack = BOUND_TOLERANCE * (1.0 + float(np.abs(y).max(initial=0.0)))
    is_inside = np.all(exact >= lower - slack) and np.all(exact <= upper + slack)
    return (exact if is_inside else y), active[:count]


def _check_quantities(model: CompiledModel) -> None:
    structure = model.structure
    if isinstance(structure, Structure) and not model.has("acceleration"):
        moving = np.flatnonzero((structure.node_mass == 0) & ~np.all(structure.node_anchored, axis=1))
        names = name_list(structure.node_name[k] for k in moving)
        raise FormulationError(
            "without masses of the nodes there are no accelerations",
            where=f"{model.manifest.name}: nodes",
            given=f"no accelerations; without own mass: {names or 'none'}",
            allowed='masses of free nodes, and a model compiled for "time_motion"',
            hint='give nodes or bars a mass, or use feedforward="static"',
        )
    require_quantities(model, DYNAMIC_QUANTITIES, "inverse dynamics needs")


def _compute_scale(plan_model: PlanModel, coordinate: FloatArray) -> FloatArray:
    """Return the most that a unit of each coordinate moves a node, (n_coordinates,); 1 for node positions."""
    problem = plan_model.problem(plan_model.start)
    if not isinstance(problem, BodyProblem):
        return np.ones(len(coordinate))
    problem.to_search_coordinate(coordinate)
    return np.array(problem.scale)


# Inputs over time that drive a motion: those of its equilibria, or those that produce its accelerations.


@dataclass(frozen=True, eq=False)
class Timing:
    """A path with its time law, at parts (n_t,) of the duration."""

    path: SmoothPath
    law: TimeLaw
    part: FloatArray

    def states(self, duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return coordinates, velocities and accelerations, (n_t, n_coordinates) each."""
        s, rate, bend = self.law.at(self.part)
        rate, bend = rate[:, None] / duration, bend[:, None] / (duration * duration)
        coordinate, slope, curve = (np.asarray(self.path.coordinate(s, order)) for order in range(3))
        return coordinate, slope * rate, slope * bend + curve * rate**2


@dataclass(frozen=True)
class Driven:
    """A motion of one duration [s].

    change (n_t, n_actuators) [m]; tension (n_t, n_members) [N]; residual (n_t, n_coordinates) [N], without
    columns if it is not computed; peaks: of the rates.
    """

    duration: float
    change: FloatArray
    tension: FloatArray
    residual: FloatArray
    peaks: Peaks


class Feedforward:
    """The drive of a motion, by its duration: inputs of its equilibria, which depend on the progress only."""

    is_static = True

    def __init__(self, timing: Timing) -> None:
        self.timing = timing
        progress = timing.law.at(timing.part)[0]
        self.change = np.asarray(timing.path.change(progress))
        self.tension = np.asarray(timing.path.tension(progress))

    def __call__(self, duration: float) -> Driven:
        """Return the motion of this duration [s]."""
        peaks = compute_peaks(self.timing.part * duration, self.change)
        return Driven(duration, self.change, self.tension, np.zeros((len(self.change), 0)), peaks)


class _DynamicFeedforward(Feedforward):
    """The inputs that produce the accelerations."""

    is_static = False

    def __init__(self, plan_model: PlanModel, timing: Timing) -> None:
        super().__init__(timing)
        self.inverse = InverseDynamics(plan_model, np.asarray(timing.path.coordinate(0.0)))

    def __call__(self, duration: float) -> Driven:
        rows = zip(*self.timing.states(duration), self.change, self.tension, strict=True)
        drives = [self.inverse.solve(*row) for row in rows]
        change = np.array([drive.change for drive in drives])
        return Driven(
            duration,
            change,
            np.array([drive.tension for drive in drives]),
            np.array([drive.residual for drive in drives]),
            compute_peaks(self.timing.part * duration, change),
        )


def build_feedforward(kind: str, plan_model: PlanModel, timing: Timing) -> Feedforward:
    """Return the feedforward of a kind; raises FormulationError if a dynamic one lacks quantities."""
    return Feedforward(timing) if kind == STATIC else _DynamicFeedforward(plan_model, timing)


def describe_residual(coordinates: tuple[str, ...], timing: Timing, driven: Driven) -> tuple[str, ...]:
    """Return a warning if the actuators do not produce the accelerations: force, coordinate and time."""
    size = np.abs(driven.residual)
    largest = float(np.abs(driven.tension).max(initial=0.0))
    if size.max(initial=0.0) <= RESIDUAL_TOLERANCE * largest:
        return ()
    row, column = np.unravel_index(int(size.argmax()), size.shape)
    time = timing.part[row] * driven.duration
    return (
        f"the actuators do not produce this motion exactly: a force of {size.max():.3g} N along "
        f"{coordinates[int(column)]} is missing at {time:.4g} s, beside a largest tension of {largest:.4g} N",
    )
