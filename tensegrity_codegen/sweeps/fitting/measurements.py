"""Measurements of a motion, or of states at rest: a table of values, in which parts may be missing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.trajectory.motion_tables import list_input_units
from tensegrity_codegen.scene.formats.files.csv_table import MAX_TABLE_BYTES, read_lines, read_table
from tensegrity_codegen.scene.formats.imported import read_text
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_path
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, check_choice

TIME = "time"
TIMES = (TIME, f"{TIME} [s]")
# Kinds of measurements: unit, and the quantity that they are entries of.
KINDS = {
    "position": ("m", "node_position"),
    "velocity": ("m/s", "node_velocity"),
    "length": ("m", "member_length"),
    "tension": ("N", "member_tension"),
    "frequency": ("Hz", "natural_frequency"),
}
FREQUENCY = "frequency"  # of states at rest, from 1 for the lowest on
MOST_FREQUENCIES = 20
OF_MOTIONS = ("velocity",)
IGNORED = ("kinetic_energy [J]", "total_energy [J]")  # columns of files of motions that are no measurements


@dataclass(frozen=True)
class Channel:
    """One measured number: name, kind (of KINDS), and its place in the quantity of that kind."""

    name: str
    kind: str
    place: tuple[int, ...]

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return KINDS[self.kind][0]

    @property
    def quantity(self) -> str:
        """The quantity whose entry it is."""
        return KINDS[self.kind][1]


@dataclass(frozen=True)
class Measurements:
    """Values of channels over time, or in states at rest.

    time: (n_t,) [s] increasing, from 0 or later on; the motion starts at 0 in the state of the scene. Of
    states at rest their numbers; conditions: (n_t,) keys of the scene, and their values in each state at
    rest; inputs of motions at the times.
    """

    time: FloatArray
    channels: tuple[Channel, ...]  # what was measured
    value: FloatArray  # (n_t, n_channels) values in the units of the channels, NaN where one is missing
    source: str = "measured"  # the file, for messages
    is_static: bool = False  # whether these are states at rest
    conditions: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of values that are not missing."""
        return int(np.isfinite(self.value).sum())


def _list(structure: Structure) -> Iterator[Channel]:
    for node, name in enumerate(structure.node_name):
        for axis, letter in enumerate("xyz"):
            yield Channel(f"{name}.{letter}", "position", (node, axis))
            yield Channel(f"{name}.v{letter}", "velocity", (node, axis))
    for member, name in enumerate(structure.member_name):
        yield Channel(f"{name}.length", "length", (member,))
        yield Channel(f"{name}.tension", "tension", (member,))
    for number in range(min(MOST_FREQUENCIES, structure.n_coordinates)):
        yield Channel(f"{FREQUENCY}.{number + 1}", FREQUENCY, (number,))


def read_measurements(
    measured: str | Path | Mapping[str, ArrayLike] | Measurements, structure: Structure
) -> Measurements:
    """Return what was measured, from a CSV file or from arrays by name.

    measured: file with the column ``time`` and columns as ``t1.x``, ``t1.vx``, ``bar1.length``,
        ``bar1.tension``, each with or without its unit (``t1.x [m]``, as files of motions have them); cells
        of what is missing are empty; ``input.winch`` is an input over time. Without ``time`` each row is a
        state at rest, which may have natural frequencies (``frequency.1``), and other columns are keys of the
        scene with their values in each state (``loads[0].force[2]``, ``input.winch``). Or a mapping of such
        names to arrays (n_t,), NaN where a value is missing.
    structure: whose nodes and members are named.
    Raises SceneError: the file cannot be read or is no table; UnknownKeyError, UnknownNameError: a column of
    what the structure does not have; the message lists near ones; InvalidValueError: no column but the time,
    no values, times that do not increase or are below zero, unequal lengths; NonFiniteError: a time that is
    not finite, or a value that is infinite.
    """
    if isinstance(measured, Measurements):
        return measured
    if not isinstance(measured, Mapping):
        check_path(measured, "measured")
    valid = {f"{channel.name} [{channel.unit}]": channel for channel in _list(structure)}
    valid |= {channel.name: channel for channel in valid.values()}
    source = str(measured) if isinstance(measured, str | Path) else "measured"
    units = list_input_units(structure).items()
    inputs = {
        key: f"input.{name}" for name, unit in units for key in (f"input.{name}", f"input.{name} [{unit}]")
    }
    read: Any = _read_arrays if isinstance(measured, Mapping) else _read_file
    columns = {inputs.get(name, name): values for name, values in read(measured, valid, inputs).items()}
    time = columns.pop(TIME, None)
    channels = tuple(valid[name] for name in columns if name in valid)
    names = [channel.name for channel in channels]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise InvalidValueError("measured twice", where=source, given=twice, allowed="each number once")
    count = len(next(iter(columns.values()))) if columns else 0
    value = np.array([columns[name] for name in columns if name in valid]).reshape(len(channels), count).T
    conditions = {name: values for name, values in columns.items() if name not in valid}
    numbers = np.arange(count, dtype=float) if time is None else time
    measurements = Measurements(numbers, channels, value, source, time is None, conditions)
    _check(measurements)
    return measurements


def _read_file(
    measured: Any, known: Mapping[str, Channel], inputs: Mapping[str, str]
) -> dict[str, FloatArray]:
    """Return the columns of a table by name; the times by the name TIME."""
    path = Path(measured)
    header = next(read_lines(read_text(path, MAX_TABLE_BYTES, "a CSV table"), path), (0, []))
    is_motion = any(name in TIMES for name in header[1])
    conditions = [
        name
        for name in header[1]
        if name and (name in inputs if is_motion else name not in (*known, *IGNORED))
    ]
    rows = read_table(path, (*TIMES, *known, *IGNORED, *conditions), ())
    if not rows:
        problem = "the table has no rows"
        raise InvalidValueError(problem, where=str(path), allowed="a row for each time or state")
    columns = {}
    for name in (name for name in rows[0].cells if name not in IGNORED):
        if name in TIMES or name in conditions:
            for row in rows:
                row.text(name)  # which refuses an empty cell
        cells = [row.number(name) for row in rows]
        columns[TIME if name in TIMES else name] = np.array([np.nan if x is None else x for x in cells])
    return columns


def _read_arrays(
    measured: Any, known: Mapping[str, Channel], inputs: Mapping[str, str]
) -> dict[str, FloatArray]:
    """Return arrays by name; the times by the name TIME."""
    is_motion = any(name in TIMES for name in measured)
    columns = {}
    for name, values in measured.items():
        if name in IGNORED:
            continue
        if is_motion:
            check_choice(name, (*TIMES, *known, *inputs), "measured number", "measured")
        columns[TIME if name in TIMES else name] = np.atleast_1d(to_doubles(values, name, "(n_t,)"))
    count = len(next(iter(columns.values()))) if columns else 0
    for name, array in columns.items():
        if array.shape != (count,):
            problem = "as many values as times or states are needed"
            allowed = f"({count},), NaN where a value is missing"
            raise InvalidValueError(problem, where=f"measured: {name}", given=array.shape, allowed=allowed)
    return columns


def _check(measurements: Measurements) -> None:
    time, source = measurements.time, measurements.source
    where = f"{source}: {TIME}"
    wrong = OF_MOTIONS if measurements.is_static else (FREQUENCY,)
    for channel in measurements.channels:
        if channel.kind in wrong:
            is_static, allowed = measurements.is_static, "other measurements"
            problem = "states at rest have no velocities" if is_static else "motions have no frequencies"
            hint = f"a table with the column {TIME} is a motion, one without it states at rest"
            raise InvalidValueError(problem, where=source, given=channel.name, allowed=allowed, hint=hint)
    if np.isinf(measurements.value).any():
        raise NonFiniteError("a measured value is infinite", where=source, allowed="finite values")
    if not measurements.channels or not measurements.count:
        allowed = "columns such as t1.x [m] or bar1.length [m]"
        raise InvalidValueError("nothing was measured", where=source, allowed=allowed)
    if not np.isfinite(time).all():
        raise NonFiniteError("a time is not finite", where=where, allowed="finite times")
    # Times increase, and motions last longer than their start.
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size or time[0] < 0.0:
        problem, value = "a time lies before the start of the motion", f"{time[0]:g} s"
        if back.size:
            problem = "times go back, or stand still"
            value = f"{time[back[0] + 1]:g} s after {time[back[0]]:g} s"
        raise InvalidValueError(problem, where=where, given=value, allowed="increasing times from 0 on")
    if time[-1] == 0.0 and not measurements.is_static:
        problem = "all was measured at the start"
        raise InvalidValueError(problem, where=where, given="0 s", allowed="times after 0")
