"""A scene, and arguments of libraries, as functions of some of its numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.array_keys import INPUT, ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import CaseAssembler, build_assembler, expand_document
from tensegrity_codegen.sweeps.apply.group_cases import find_groups
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.table import Table
from tensegrity_codegen.sweeps.fitting.measurements import FREQUENCY, Measurements
from tensegrity_codegen.sweeps.keys import ANY
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_mapping, check_pair
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    DuplicateNameError,
    FormulationError,
    InvalidValueError,
    check_choice,
)

MARGIN = 1e-4  # of a number: distance from a bound that it must not reach
STEP = 1e-5  # of a number: half the distance of the differences by which scenes are differentiated


class KeyedScene:
    """A scene as a function of some of its numbers, by the keys of sweeps.

    scene: as for `read_scene`.
    keys: numbers of the scene, or of the assembled structure, as for sweeps.
    given: further keys, whose values each state of the scene says.
    source: where `given` comes from, for errors.
    Raises UnknownKeyError, InvalidValueError, DuplicateNameError: a key that is no number of the scene, or
    has no value there; keys that change the code; a key twice; FormulationError: a scene of bodies.
    """

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any] | Scene,
        keys: Sequence[str],
        given: Sequence[str] = (),
        source: str = "",
    ) -> None:
        self.keys, self.given = tuple(keys), tuple(given)
        twice = [key for k, key in enumerate(self.keys) if key in self.keys[:k]]
        if twice:
            raise DuplicateNameError("a key twice", where="keys", given=twice[0], allowed="each key once")
        build_assembler(scene, self.given, source=source)
        self.assembler = build_assembler(scene, (*self.keys, *self.given))
        for key in self.assembler.keys[: len(self.keys)]:
            if key.bounds.is_whole:
                problem = "a motion has no derivative to a whole number"
                allowed = "numbers that can change by a little"
                raise InvalidValueError(problem, where=self.assembler.where, given=key.text, allowed=allowed)
        start = np.array([_read_start(self.assembler, k) for k in range(len(self.assembler.keys))])
        size = np.where(start != 0.0, np.abs(start), 1.0)
        self.start, self.size = start[: len(self.keys)], size[: len(self.keys)]
        self.group = self._find_group(start, size)
        self.structure = require_nodes(self.group.structure, self.assembler.where)

    def vary(self, values: FloatArray, given: FloatArray, step: float) -> FloatArray:
        """Return values (n_keys,), and with each larger, then smaller, if allowed; (2 n_keys + 1, n_all)."""
        steps = step * self.size[: len(values)]
        moved = values + np.vstack([np.zeros(len(values)), np.diag(steps), -np.diag(steps)])
        rows = np.hstack([moved, np.tile(given, (len(moved), 1))])
        outside = ~self.assembler.in_bounds(rows)
        outside[0] = False
        rows[outside, : len(values)] = values
        return rows

    def apply(self, rows: FloatArray) -> dict[str, FloatArray]:
        """Return the arguments for values (n_rows, n_all), one row each; raises InvalidValueError."""
        cases = self.group.arguments(rows)
        if not cases.good.all():
            bad = int(np.flatnonzero(~cases.good)[0])
            pairs = zip((*self.keys, *self.given), rows[bad], strict=True)
            problem, location = "these values make no scene", self.assembler.where
            value = ", ".join(f"{key} = {value:g}" for key, value in pairs)
            allowed = "numbers that the scene's keys allow, on both sides of these"
            hint = cases.messages[bad]
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)
        return cases.arguments

    def write(self, values: FloatArray) -> dict[str, Any]:
        """Return the scene with these values (n_keys,); empty for keys of the assembled structure."""
        keys = self.assembler.keys[: len(self.assembler.keys) - len(self.given)]
        if any(isinstance(key, ArrayKey) for key in keys):
            return {}
        return dict(
            CaseAssembler(self.assembler.document, self.assembler.where, keys).write(values[: len(keys)])
        )

    def _find_group(self, start: FloatArray, size: FloatArray) -> CaseGroup:
        """Return the cases near the start; raises InvalidValueError for keys that change the code."""
        keys, steps = (*self.keys, *self.given), np.diag(STEP * size)
        rows = start + np.vstack([np.zeros(len(start)), steps])
        groups = find_groups(self.assembler, Cases((), Table(keys, rows)), yes=True)
        start_group = next(group for group in groups if 0 in group.rows)
        constants = [k for k in range(1, len(rows)) if k not in start_group.rows]
        if constants:
            raise InvalidValueError(
                "these numbers are constants of the code, and no derivative is to them",
                where=self.assembler.where,
                given=", ".join(keys[k - 1] for k in constants),
                allowed="stiffnesses, rest lengths, damping, masses and loads of nodes, gravity, positions "
                "and velocities of nodes at the start, inputs, and numbers of the ground",
                hint="masses of bars are constants, also where they follow from a density: state a mass; of "
                "bodies, motion_gradient differentiates to the parameters body_mass and body_inertia",
            )
        return start_group


def read_bounds(problem: KeyedScene, given: Mapping[str, tuple[float, float]] | None) -> FloatArray:
    """Return least and largest values of the keys, (2, n_keys); raises for those that exclude the start."""
    bounds = check_mapping(given, "bounds", "least and largest value by key")
    for key in bounds:
        check_choice(key, problem.keys, "key", "bounds")
    own_keys = len(problem.assembler.keys) - len(problem.given)
    allowed = [*problem.assembler.bounds[:own_keys], *[ANY] * (len(problem.keys) - own_keys)]
    rows = []
    for key, limits, start, size in zip(
        problem.keys, allowed, problem.start.tolist(), problem.size, strict=True
    ):
        pair = bounds.get(key, (limits.lower, limits.upper))
        low, high = check_pair(pair, f"bounds: {key}", "least and largest value")
        if not (low < high and low <= start <= high):
            raise InvalidValueError(
                "the bounds exclude the value that the search starts from",
                where=f"bounds: {key}",
                given=f"{low:g} to {high:g}",
                allowed=f"bounds around {start:g}, the value in the scene",
                hint="change the scene, or the bounds",
            )
        # An end that is not allowed itself is kept away from.
        low_gap, high_gap = MARGIN * size * limits.lower_is_open, MARGIN * size * limits.upper_is_open
        rows.append((max(low, limits.lower + low_gap), min(high, limits.upper - high_gap)))
    return np.array(rows).T


def require_nodes(subject: Subject, where: str) -> Structure:
    """Return a structure of nodes; raises FormulationError for bodies."""
    if not isinstance(subject, Structure):
        problem = "numbers of bodies are not found from measurements"
        raise FormulationError(problem, where=where, allowed="a scene of nodes, bars and cables")
    return subject


def _read_start(assembler: CaseAssembler, place: int) -> float:
    """Return the value of a key in the scene; raises InvalidValueError without one."""
    key, where = assembler.keys[place], assembler.where
    value: float | None
    if isinstance(key, ArrayKey):
        if key.array == INPUT:
            return 0.0
        from tensegrity_codegen.pipeline.compile_scene import load_scene

        subject, _ = load_scene(assembler.document)
        entries = np.asarray(getattr(subject, key.array))[list(key.rows)]
        entries = entries if key.axis < 0 else entries[:, key.axis]
        if np.ptp(entries) > 0.0:
            problem = "the entries of this key differ in the scene, and it would give them all one value"
            allowed = "a key whose entries are equal at the start"
            hint = "one key for each, or a number of the scene that they follow from"
            raise InvalidValueError(problem, where=where, given=key.text, allowed=allowed, hint=hint)
        return float(entries[0])
    document = expand_document(assembler.document, where) if key.is_from_shape else assembler.document
    value = key.path.read(document)
    if value is None:
        problem = "the scene does not state this number, so that there is no value to start from"
        allowed, hint = "numbers that the scene states", f"write {key.text} into the scene"
        raise InvalidValueError(problem, where=where, given=key.text, allowed=allowed, hint=hint)
    return float(value)


STATIC_STEP = 1e-4  # of a number: half the distance of the differences of equilibria
TOLERANCE = 1e-11  # of the largest member force


class KeyedStatics(KeyedScene):
    """Equilibria in several states, whose loads and inputs are among the conditions of the measurements."""

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any] | Scene,
        keys: Sequence[str],
        data: Measurements,
        compiler: str | None = None,
    ) -> None:
        super().__init__(scene, keys, tuple(data.conditions), data.source)
        self.shape: FloatArray | None = None  # the equilibria that were found last, (n_states, n_coordinates)
        has_frequencies = any(channel.kind == FREQUENCY for channel in data.channels)
        analyses = ("equilibria", "linearize") if has_frequencies else ("equilibria",)
        statics = with_statics(self.structure, replace(self.group.request, quantities=(), integrators=()))
        needs = want_analyses(self.structure, statics, analyses)
        built = build_library(self.structure, needs, compiler=compiler, calls=MANY_CALLS)
        self.model: CompiledModel = built.load()
        self.known = {channel.name for channel in self.model.manifest.arguments} - {"coordinate", "velocity"}

    def observe(self, values: FloatArray, data: Measurements, until: int) -> tuple[FloatArray, FloatArray]:
        """Return measured values before `until`, and derivatives (..., n_keys); raises ConvergenceError."""
        conditions = np.array([data.conditions[key] for key in self.given]).reshape(-1, len(data.time)).T
        blocks = [self.vary(values, state, STATIC_STEP) for state in conditions[:until]]
        rows = np.vstack([np.array(blocks)[:, 0], np.array(blocks)[:, 1:].reshape(-1, blocks[0].shape[1])])
        arguments = self.apply(rows)
        equilibria = self._settle({name: value[:until] for name, value in arguments.items()}, self.shape)
        self.shape = equilibria.coordinate
        if self.structure.ground is not None:
            self.shape = None  # friction depends on the way, which begins in the scene
        count = 2 * len(values)
        varied = {name: value[until:] for name, value in arguments.items()}
        starts = None if self.shape is None else np.repeat(self.shape, count, axis=0)
        moved = self._settle(varied, starts)
        measured = self._read(equilibria, {name: value[:until] for name, value in arguments.items()}, data)
        varied_values = self._read(moved, varied, data).reshape(until, 2, len(values), -1)
        over = np.array([np.diagonal(block[1 : len(values) + 1]) for block in blocks])
        over = over - np.array([np.diagonal(block[len(values) + 1 :]) for block in blocks])
        slopes = (varied_values[:, 0] - varied_values[:, 1]) / (over / self.size)[:, :, None]
        return measured, np.moveaxis(slopes, 1, 2)

    def _settle(self, arguments: Mapping[str, FloatArray], start: FloatArray | None) -> Equilibria:
        """Return the equilibria under arguments (n, ...), from starts (n, n_coordinates)."""
        inputs = {name: value for name, value in arguments.items() if name in self.known}
        count = len(next(iter(arguments.values())))
        coordinate = arguments.get("coordinate")
        if start is None or len(start) != count:
            nominal = np.tile(self.model.nominal("coordinate"), (count, 1))
            start = nominal if coordinate is None else coordinate
        equilibria = find_equilibria(self.model, coordinate=start, arguments=inputs, tolerance=TOLERANCE)
        bad = [k for k, status in enumerate(equilibria.status) if status != "converged"]
        if bad:
            problem = f"{len(bad)} of {count} states have no equilibrium: {equilibria.message[bad[0]]}"
            hint = "values of the scene nearer to what was measured, or fewer states"
            raise ConvergenceError(problem, where=self.assembler.where, hint=hint)
        return equilibria

    def _read(self, found: Equilibria, arguments: Mapping[str, FloatArray], data: Measurements) -> FloatArray:
        """Return the channels at equilibria, (n, n_channels)."""
        count = len(found.coordinate)
        highest = max((entry.place[0] for entry in data.channels if entry.kind == FREQUENCY), default=-1)
        columns, frequency = [], np.zeros((count, highest + 1))
        for k in range(count if highest >= 0 else 0):
            inputs = {name: value[k] for name, value in arguments.items() if name in self.known}
            linear = linearize(self.model, coordinate=found.coordinate[k], velocity=None, arguments=inputs)
            if len(linear.natural_frequency) <= highest:
                problem = "the structure has fewer natural frequencies"
                allowed = f"frequency.1 to frequency.{len(linear.natural_frequency)}"
                raise InvalidValueError(
                    problem, where=data.source, given=f"frequency.{highest + 1}", allowed=allowed
                )
            frequency[k] = linear.natural_frequency[: highest + 1]
        for entry in data.channels:
            values = frequency if entry.kind == FREQUENCY else getattr(found, entry.quantity)
            index: Any = (slice(None), *entry.place)
            columns.append(values[index])
        return np.stack(columns, axis=1)
