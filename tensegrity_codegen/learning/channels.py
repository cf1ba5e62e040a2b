"""Actions and observations: commands that become inputs after delays, and measurements with noise."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tensegrity_codegen.analyses.cases.keep_text import parse_kept
from tensegrity_codegen.analyses.cases.kept import bind_kept, find_kept_quantities
from tensegrity_codegen.control.feedback.design.linear_samples import split_delays
from tensegrity_codegen.control.feedback.policy import COMMAND, Acted, Observed
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.checks import check_names, check_pair
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    SceneError,
    StructureError,
    UnknownNameError,
    check_choice,
)
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.quantities import QUANTITIES
from tensegrity_codegen.tables.quantities.arguments import INPUT_UNITS
from tensegrity_codegen.tables.request import ModelRequest

POSITION, VELOCITY = "node_position", "node_velocity"
PARTS = 4  # of a sample, to the nearest of which delays are rounded that are drawn
OF_NODES = (POSITION, VELOCITY, COMMAND)
OF_BODIES = ("body_position", "body_axes", "body_velocity", "body_angular_velocity", COMMAND)
RANGE_HINT = "write range = [0.1, 0.5] below [[actuators]], or give ranges of inputs: act={{{}}}"


def choose_actions(
    structure: Subject, act: Sequence[str] | Mapping[str, Sequence[float]] | None
) -> tuple[Acted, ...]:
    """Return the actions: actuators with their ranges, or inputs with ranges that are given."""
    inputs = [source.name for source in structure.inputs]
    actuators = {actuator.name: actuator for actuator in structure.actuators}
    ranges = dict(act) if isinstance(act, Mapping) else {}
    names = check_names([*ranges] or act or [*actuators], "act")
    if not names:
        location, value = f"{structure.name}: actuators", f"no actuators, {len(inputs)} inputs"
        allowed, hint = "at least one table [[actuators]] with a range", RANGE_HINT.format("'push': (-5, 5)")
        raise StructureError("nothing can act", where=location, given=value, allowed=allowed, hint=hint)
    actions = []
    for name in names:
        check_choice(name, inputs, "actuator or input", "act")
        actuator, low, high = actuators.get(name), -np.inf, np.inf
        if actuator is not None:
            lengths = structure.rest_length[list(actuator.members)]
            low, high = actuator.range[0] - float(lengths.min()), actuator.range[1] - float(lengths.max())
        least, most = low - 1e-9, high + 1e-9  # [m]
        low, high = check_pair(ranges.get(name, (low, high)), f"act: {name}", "least and largest input")
        if not least <= low < high <= most or np.isinf(high - low):
            problem, location = "its range is infinite, empty or too wide", f"{structure.name}: {name}"
            value, hint = f"{low:g} to {high:g} of its input", RANGE_HINT.format(f"'{name}': (-0.1, 0.1)")
            allowed = f"finite ends from {least:g} to {most:g}"
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)
        # The equations of a motor with a time constant limit its rate.
        rate = np.inf if actuator is None or actuator.time_constant else actuator.rate
        delay = 0.0 if actuator is None else actuator.delay
        actions.append(Acted(name, (low + high) / 2, (high - low) / 2, rate, delay))
    return tuple(actions)


class Actions:
    """Commands of copies, and those that are on their way.

    command (n, n_actions): the last ones; sent (depth, n, n_actions): the newest first; delay [s] and rate
    (n, n_actions).
    """

    def __init__(self, acted: Sequence[Acted], sample: float, n: int, has_drawn_delays: bool) -> None:
        self.sample, self.has_drawn_delays = sample, has_drawn_delays
        rows = np.array([(a.centre, a.half_range, a.rate, a.delay) for a in acted]).T
        self.centre, self.half_range, rate, delay = rows
        self.low, self.high = self.centre - self.half_range, self.centre + self.half_range
        self.first = np.where((self.low <= 0.0) & (self.high >= 0.0), 0.0, self.centre)
        self.command, self.delay, self.rate = (np.tile(row, (n, 1)) for row in (self.first, delay, rate))
        self.sent = self.command[None]
        self.set_delays(np.arange(n), self.delay)

    def set_delays(self, rows: IntArray, delay: FloatArray) -> None:
        """Set the delays of some copies, (len(rows), n_actions) [s]."""
        if self.has_drawn_delays:
            delay = np.rint(np.maximum(delay, 0.0) * PARTS / self.sample) * self.sample / PARTS
        self.delay[rows] = delay
        self.back, offset, _ = split_delays(self.delay, self.sample)
        self.offset = np.round(offset / self.sample, 9)  # in samples; equal ones are equal bit by bit
        # Parts of drawn delays are always the same, whatever other copies have.
        starts = np.arange(PARTS) / PARTS if self.has_drawn_delays else np.unique([0.0, *self.offset.ravel()])
        self.ends = [*starts.tolist(), 1.0]
        missing = max(int(self.back.max()) + 2 - len(self.sent), 0)
        self.sent = np.concatenate([self.sent, np.repeat(self.sent[-1:], missing, axis=0)])

    def push(self, action: FloatArray) -> None:
        """Send the commands of actions (n, n_actions); for a NaN the last one again."""
        target = self.centre + self.half_range * np.clip(action, -1.0, 1.0)
        reach = self.rate * self.sample
        target = np.clip(target, self.command - reach, self.command + reach)
        self.command = np.clip(np.where(np.isnan(action), self.command, target), self.low, self.high)
        self.sent = np.concatenate([self.command[None], self.sent[:-1]])

    def list_parts(self) -> Iterator[tuple[float, FloatArray]]:
        """Yield the parts of the sample [s], and the commands that have arrived in each."""
        for start, end in pairwise(self.ends):
            late = self.back + (self.offset > start)
            yield (end - start) * self.sample, np.take_along_axis(self.sent, late[None], axis=0)[0]


class Observations:
    """Parts of the observation of a structure, by the texts of `keep`, names of sensors, and "command"."""

    def __init__(self, structure: Subject, observe: Sequence[str] | str) -> None:
        """observe: nothing: all sensors and the commands; without sensors the state and the commands."""
        names = (sensor.name or f"sensors[{k}]" for k, sensor in enumerate(structure.sensors))
        self.sensors = dict(zip(names, structure.sensors, strict=True))
        self.units = {source.name: INPUT_UNITS[source.kind] for source in structure.inputs}
        has_bodies = isinstance(structure, Structure) and bool(structure.bodies)
        usual = (*self.sensors, COMMAND) if self.sensors else OF_BODIES if has_bodies else OF_NODES
        try:
            self.texts = parse_kept(check_names(observe, "observe") or usual, (*self.sensors, COMMAND))
        except SceneError as error:
            raise self._rename(error) from None
        self.names = [kept_text.expression for kept_text in self.texts]
        self.measured = {
            name: "body_angular_velocity" if sensor.kind == "angular_velocity" else sensor.kind
            for name, sensor in self.sensors.items()
            if name in self.names
        }

    def _rename(self, error: SceneError) -> SceneError:
        """Return an error of `keep` as one of `observe`, which knows sensors and commands too."""
        error.where = error.where.replace("keep", "observe")
        if isinstance(error, UnknownNameError) and "did you mean" not in error.hint and not error.allowed:
            error.hint += f"; beside quantities: {', '.join((COMMAND, *self.sensors))}"
        return error

    def list_quantities(self, request: ModelRequest) -> tuple[str, ...]:
        """Return the quantities that they need."""
        texts = [k for k in self.texts if k.expression not in (*self.measured, COMMAND)]
        return *self.measured.values(), *find_kept_quantities(tuple(texts), request)

    def bind(self, manifest: Manifest, acted: Sequence[Acted]) -> tuple[Observed, ...]:
        """Return the parts with their sizes, for a library that has the quantities."""
        # Places and velocities of nodes are known whether or not the library computes them.
        size, specs = (len(manifest.node_name), 3), {spec.quantity: spec for spec in manifest.functions}
        specs[VELOCITY] = replace(
            manifest.functions[0], quantity=VELOCITY, shape=size, pattern=None, unit="m/s"
        )
        manifest = replace(manifest, functions=tuple(specs.values()))
        shapes = {name: spec.shape for name, spec in specs.items()} | {POSITION: size}
        self.results, observed = {}, []
        for kept_text, name in zip(self.texts, self.names, strict=True):
            if name == COMMAND:
                units = {self.units[action.name] for action in acted}
                observed.append(Observed(COMMAND, units.pop() if len(units) == 1 else "mixed", len(acted)))
            elif name in self.measured:
                quantity, sensor = self.measured[name], self.sensors[name]
                count = len(sensor.targets) * int(np.prod(shapes[quantity][1:]))
                observed.append(Observed(name, QUANTITIES[quantity].unit, count, sensor.noise))
            else:
                try:
                    (self.results[name],) = bind_kept((kept_text,), manifest)
                except SceneError as error:
                    raise self._rename(error) from None
                output = self.results[name].output
                observed.append(Observed(kept_text.name, output.unit or "1", int(np.prod(output.shape))))
        # The sensor of each number that has one.
        rows = [[*self.sensors, name].index(name) for name in self.names]
        owner = np.repeat(rows, [entry.size for entry in observed])
        self.noisy = np.flatnonzero(owner < len(self.sensors))
        self.owner = owner[self.noisy]
        return tuple(observed)

    def compute(self, values: Mapping[str, FloatArray], command: FloatArray) -> FloatArray:
        """Return observations (n, n_observation) without noise, from quantities (n, ...)."""
        columns, n = [], len(command)
        for name in self.names:
            if name in self.measured:
                column = values[self.measured[name]][:, self.sensors[name].targets]
            else:
                column = command if name == COMMAND else self.results[name].evaluate(values, (n,))
            columns.append(column.reshape(n, -1))
        return np.concatenate(columns, axis=1)
