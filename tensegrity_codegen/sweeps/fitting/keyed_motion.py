"""Motions of a scene as functions of some of its numbers, with derivatives from the same integration.

What a library takes follows from the numbers by assembling the scene, whose derivatives are central
differences; those of the motion are columns along these directions, so that a number which many members share
costs one column.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.gradient import Loss, MotionGradient, motion_gradient
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import CONTACT_QUANTITIES
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.fitting.keyed_scene import STEP, KeyedScene
from tensegrity_codegen.sweeps.fitting.measurements import Measurements
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, check_choice
from tensegrity_codegen.tables.quantities import DIRECTED

METHOD = "rk853"
BACKWARDS = ("adjoint_rate", "adjoint_tension")  # quantities of gradients backwards
FINER = 100.0  # times the accuracy of the steps that derivatives are compared with
MEANINGLESS = 0.1  # of the largest derivative so far: a difference from which derivatives mean nothing


@dataclass(frozen=True)
class RunSettings:
    """How motions are integrated: method, relative tolerance of its steps, inputs over time, arguments.

    arguments: start and run-time parameters where they differ from the scene; keys that move one win.
    """

    method: str = METHOD
    rtol: float = 1e-8
    schedule: Profile | None = None
    arguments: Mapping[str, ArrayLike] = field(default_factory=dict)


# A knot of the profile of an input: its name, and the number of the knot from 0 on.
KNOT = re.compile(r"profile\.(\w+)\[(\d{1,9})\]")
KNOT_SIZE = 0.01  # size of the knots of an input that are all zero, in the unit of the input


def _find_knot(text: str, schedule: Profile | None, where: str) -> tuple[str, int]:
    """Return input and number of a knot; raises InvalidValueError or UnknownNameError where there is none."""
    knot = KNOT.fullmatch(text)
    assert knot is not None
    name, number = knot[1], int(knot[2])
    if schedule is None:
        raise InvalidValueError("there is no profile", where=where, given=text, allowed="inputs over time")
    check_choice(name, schedule.values, "input of the profile", where)
    if number >= len(schedule.time):
        allowed = f"profile.{name}[0] to profile.{name}[{len(schedule.time) - 1}]"
        raise InvalidValueError("the profile has fewer knots", where=where, given=text, allowed=allowed)
    return name, number


class KeyedMotion(KeyedScene):
    """The motion of a scene as a function of some of its numbers.

    scene, keys: as of `KeyedScene`; also knots of the profile of an input, as ``profile.winch[2]``.
    settings: method, tolerance, inputs over time.
    backwards: whether gradients are taken backwards over the steps; one column along all keys is integrated
        beside the motion then, which shortens steps that are too long for derivatives.
    compiler: c compiler.
    Raises UnknownKeyError, InvalidValueError: as of `KeyedScene`; FormulationError: the scene's motions have
    no derivatives.
    """

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any] | Scene,
        keys: Sequence[str],
        settings: RunSettings,
        compiler: str | None = None,
        *,
        backwards: bool = False,
    ) -> None:
        check_instance(settings.method, str, "method", "the name of an integrator")
        knots = [key for key in keys if KNOT.fullmatch(key)]
        super().__init__(scene, [key for key in keys if key not in knots])
        self.settings, self.n_scene = settings, len(self.keys)
        self.knots = tuple(_find_knot(key, settings.schedule, self.assembler.where) for key in knots)
        if self.knots:
            self.keys = (*self.keys, *knots)
            self.start = np.append(self.start, [self._schedule.values[name][k] for name, k in self.knots])
            largest = [float(np.abs(self._schedule.values[name]).max()) for name, _ in self.knots]
            self.size = np.append(self.size, [size or KNOT_SIZE for size in largest])
        request = self.group.request
        needs = find_needs("simulate", self.structure, request, method=settings.method).alone(request)
        # What columns are along, as parts of each key.
        self.mix = np.eye(len(self.keys))
        if backwards:
            self.mix = np.random.default_rng(0).choice([-1.0, 1.0], (len(self.keys), 1))
        names = ("all",) if backwards else self.keys
        needs = replace(needs, directions=names, batch_width=0, keep=(), interfaces=(), flags="native")
        # Forces of contacts are not measured, and take longer than the motion.
        needed = [name for name in needs.quantities if name not in CONTACT_QUANTITIES]
        needs = replace(needs, quantities=(*needed, "tension_column", *(BACKWARDS if backwards else ())))
        built = build_library(self.structure, needs, compiler=compiler, calls=MANY_CALLS)
        self.model: CompiledModel = built.load()

    @property
    def _schedule(self) -> Profile:
        assert self.settings.schedule is not None
        return self.settings.schedule

    def build_schedule(self, values: FloatArray, direction: FloatArray | None = None) -> Profile | None:
        """Return the inputs over time with values (n_keys,) and directions (n_directed, n_columns)."""
        if not self.knots:
            return self.settings.schedule
        courses = {name: np.array(column) for name, column in self._schedule.values.items()}
        for (name, k), value in zip(self.knots, values[self.n_scene :], strict=True):
            courses[name][k] = value
        if direction is not None:
            rows = np.tile(direction, (len(self._schedule.time), 1, 1))
            first_input = direction.shape[0] - len(self.model.manifest.input_name)
            for column, (name, k) in enumerate(self.knots, start=self.n_scene):
                row = first_input + self.model.manifest.input_name.index(name)
                rows[k, row] += self.size[column] * self.mix[column]
            courses["direction"] = rows
        return Profile(self._schedule.time, courses, self._schedule.kind)

    def differentiate(self, values: FloatArray) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return arguments for values (n_keys,), and derivatives (..., n_keys) to values over their sizes."""
        count = self.n_scene
        rows = self.vary(values[:count], np.zeros(0), STEP)
        arguments = self.apply(rows)
        over = (np.diagonal(rows[1 : count + 1]) - np.diagonal(rows[count + 1 :])) / self.size[:count]
        slopes = {}
        for name, value in arguments.items():
            change = np.moveaxis(value[1 : count + 1] - value[count + 1 :], 0, -1) / over
            unchanged = np.zeros((*change.shape[:-1], len(values) - count))
            slopes[name] = np.concatenate([change, unchanged], axis=-1)
        return {name: value[0] for name, value in arguments.items()}, slopes

    def find_loss_of_meaning(
        self, values: FloatArray, data: Measurements, slopes: FloatArray
    ) -> float | None:
        """Return the first time [s] from which slopes (n_t, n_channels, n_keys) mean nothing, or None."""
        _, exact = self.observe(values, data, len(data.time), accuracy=FINER)
        size = np.maximum.accumulate(np.abs(exact).max(axis=1), axis=0)
        error = np.abs(slopes - exact).max(axis=1)
        wrong = np.flatnonzero((error > MEANINGLESS * np.where(size > 0.0, size, 1.0)).any(axis=1))
        return float(data.time[wrong[0]]) if wrong.size else None

    def observe(
        self, values: FloatArray, data: Measurements, until: int, accuracy: float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return measured values before `until`, and derivatives (..., n_keys); raises ConvergenceError."""
        time = data.time[:until]
        run = self.run(values, time if time[0] == 0.0 else np.concatenate([[0.0], time]), accuracy)
        if run.motion.status != "ok":
            problem = f"the motion fails: {run.motion.message}"
            hint = "values of the scene nearer to what was measured, or a shorter time"
            raise ConvergenceError(problem, where=self.assembler.where, hint=hint)
        rows: list[Any] = [(channel, (slice(-len(time), None), *channel.place)) for channel in data.channels]
        return (
            np.stack([run.find(channel.quantity)[index] for channel, index in rows], axis=1),
            np.stack([getattr(run, channel.quantity)[index] for channel, index in rows], axis=1),
        )

    def run(self, values: FloatArray, times: FloatArray, accuracy: float = 1.0) -> "MotionSlopes":
        """Return the motion at sample times (n_t,), the first 0, with values (n_keys,) of the keys."""
        run_inputs = self._give(values)
        motion = simulate(
            self.model,
            float(times[-1]),
            samples=times,
            method=self.settings.method,
            rtol=self.settings.rtol / accuracy,
            **run_inputs.options,
            stepping=Stepping(control="steps"),
        )
        return self._differentiate(run_inputs, motion)

    def differentiate_loss(
        self, values: FloatArray, times: FloatArray, loss: Loss
    ) -> tuple[MotionGradient, FloatArray, float]:
        """Return the gradient of a loss backwards, over sizes (n_keys,), and its error by the column."""
        run_inputs = self._give(values)
        gradient = motion_gradient(
            self.model,
            loss,
            float(times[-1]),
            samples=times,
            method=self.settings.method,
            rtol=self.settings.rtol,
            **run_inputs.options,
            check=False,
        )
        slopes = np.zeros(len(values))
        for name, derivative in run_inputs.slopes.items():
            if name in gradient.by:
                slopes += np.tensordot(gradient.by[name], derivative, axes=derivative.ndim - 1)
        for column, (name, k) in enumerate(self.knots, start=self.n_scene):
            slopes[column] += float(gradient.knots[name][k]) * self.size[column]
        run, along = self._differentiate(run_inputs, gradient.motion), 0.0
        for name, derivative in gradient.parts.items():
            along += float(np.tensordot(derivative, getattr(run, name)[..., 0], axes=derivative.ndim))
        error = abs(along - float(slopes @ self.mix[:, 0])) / max(np.abs(slopes).max(), 1e-300)
        return gradient, slopes, float(error)

    def _give(self, values: FloatArray) -> "_Given":
        """Return the arguments of a motion with values (n_keys,) of the keys, and of its columns."""
        moved, slopes = self.differentiate(values)
        arguments: dict[str, Any] = {**self.settings.arguments, **moved}
        coordinate, velocity = (arguments.pop(name, None) for name in ("coordinate", "velocity"))
        manifest, count = self.model.manifest, self.mix.shape[1]
        shapes = {argument.name: argument.shape for argument in manifest.arguments}
        mixed = {name: derivative @ self.mix for name, derivative in slopes.items()}

        def stack(names: Sequence[str]) -> FloatArray:
            sizes = {name: int(np.prod(shapes[name])) for name in names if name in shapes}
            rows = [
                mixed[name].reshape(size, count) if name in mixed else np.zeros((size, count))
                for name, size in sizes.items()
            ]
            return np.vstack([np.zeros((0, count)), *rows])

        column = stack(("coordinate", "velocity"))
        column = np.vstack([column, np.zeros((len(manifest.internal_name), count))])
        columns = {"column": column, "direction": stack(DIRECTED)}
        columns = {name: value for name, value in columns.items() if name in shapes}
        schedule = self.build_schedule(values, columns.pop("direction", None) if self.knots else None)
        return _Given(arguments, coordinate, velocity, columns, schedule, slopes, mixed)

    def _differentiate(self, given: "_Given", motion: Trajectory) -> "MotionSlopes":
        chosen = given.schedule if self.knots else given.columns.get("direction")
        return MotionSlopes(self.model, motion, given.arguments, chosen, given.mixed)


@dataclass(frozen=True)
class _Given:
    """The inputs of a motion: arguments, start, columns, inputs over time; derivatives of the arguments."""

    arguments: dict[str, FloatArray]
    coordinate: FloatArray | None
    velocity: FloatArray | None
    columns: dict[str, FloatArray]
    schedule: Profile | None
    slopes: dict[str, FloatArray]  # to each value over its size
    mixed: dict[str, FloatArray]  # along the columns

    @property
    def options(self) -> dict[str, Any]:
        """Start, arguments and inputs, as `simulate` takes them."""
        start = {"coordinate": self.coordinate, "velocity": self.velocity}
        return start | {"arguments": self.arguments | self.columns, "schedule": self.schedule}


@dataclass(frozen=True)
class MotionSlopes:
    """A motion, and the derivatives of measurable quantities along it, one for each column."""

    model: CompiledModel
    motion: Trajectory
    arguments: Mapping[str, FloatArray]  # of the motion, without those that follow a profile
    direction: FloatArray | Profile | None  # (n_directed, n_columns), or the profile that has it
    slopes: Mapping[str, FloatArray]  # derivatives of the arguments

    @property
    def columns(self) -> FloatArray:
        """Derivatives of the states, (n_t, n_states, n_keys)."""
        assert self.motion.columns is not None
        return self.motion.columns

    def find(self, quantity: str) -> FloatArray:
        """Return a quantity at the samples, (n_t, ...)."""
        if quantity != "member_length":
            return np.asarray(getattr(self.motion, quantity))
        return self.model.manifest.strands.lengths(self.motion.node_position)

    @cached_property
    def _spans(self) -> FloatArray:
        """Vectors from end to end of all strands of members, (n_t, n_strands, 3) [m]."""
        return self._span(self.motion.node_position)

    def _span(self, position: FloatArray) -> FloatArray:
        """Return from end to end of all strands, (n_t, n_strands, 3, ...), of (n_t, n_nodes, 3, ...)."""
        ends = self.model.manifest.strands.ends
        return np.asarray(position[:, ends[:, 1]] - position[:, ends[:, 0]])

    @cached_property
    def node_position(self) -> FloatArray:
        """Derivatives of all positions, (n_t, n_nodes, 3, n_keys) [m]."""
        manifest = self.model.manifest
        positions = self._place(0)
        moved = self.slopes.get("anchor_position")
        if moved is not None:
            anchors = manifest.argument("anchor_position").over
            axes = list(manifest.axes)
            for row, name in enumerate(anchors):
                node = manifest.node_name.index(name)
                held = [axis for axis in axes if (node, axis) not in manifest.coordinate_node_axis]
                for axis in held:
                    positions[:, node, axis] = moved[row, axes.index(axis)]
        return positions

    @cached_property
    def node_velocity(self) -> FloatArray:
        """Derivatives of all velocities, (n_t, n_nodes, 3, n_keys) [m/s]."""
        return self._place(len(self.model.manifest.coordinate_name))

    @cached_property
    def member_length(self) -> FloatArray:
        """Derivatives of all member lengths, (n_t, n_members, n_keys) [m]."""
        along = self._spans / np.linalg.norm(self._spans, axis=-1, keepdims=True)
        rates = np.einsum("tma,tmak->tkm", along, self._span(self.node_position))
        return self.model.manifest.strands.add_up(rates).swapaxes(1, 2)

    @cached_property
    def member_tension(self) -> FloatArray:
        """Derivatives of all member tensions, (n_t, n_members, n_keys) [N]."""
        spec = next(entry for entry in self.model.manifest.functions if entry.quantity == "tension_column")
        motion, arguments = self.motion, {**self.arguments}
        if isinstance(self.direction, np.ndarray):
            arguments["direction"] = self.direction
        tensions = np.empty((len(motion.time), len(motion.member_name), self.columns.shape[2]))
        for k in range(len(motion.time)):
            arguments |= {"coordinate": motion.coordinate[k], "velocity": motion.velocity[k]}
            arguments["column"] = self.columns[k]
            if isinstance(self.direction, Profile):
                arguments["direction"] = self.direction(float(motion.time[k]))["direction"]
            if motion.internal is not None:
                arguments["internal"] = motion.internal[k]
            if motion.input is not None:
                arguments["input"] = motion.input[k]
            tensions[k] = self.model.compute(
                "tension_column", **{name: arguments[name] for name in spec.arguments if name in arguments}
            )
        return tensions

    def _place(self, first: int) -> FloatArray:
        """Return rows of coordinates from `first` on by nodes and axes, (n_t, n_nodes, 3, n_keys)."""
        manifest = self.model.manifest
        node, axis = np.array(manifest.coordinate_node_axis, dtype=np.int64).reshape(-1, 2).T
        placed = np.zeros((len(self.motion.time), len(manifest.node_name), 3, self.columns.shape[2]))
        placed[:, node, axis] = self.columns[:, first : first + len(node)]
        for body in manifest.body_places:
            body.attach(np.swapaxes(placed, 2, 3).swapaxes(1, 2))  # a view: (n_t, n_keys, n_nodes, 3)
        return placed
