"""Measurements of a motion: a table of times and values, in which parts may be missing."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.scene.formats.files.csv_table import read_table
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, check_choice

TIME = "time"
# Kinds of measurements: unit, and the quantity that they are entries of.
KINDS = {
    "position": ("m", "node_position"),
    "velocity": ("m/s", "node_velocity"),
    "length": ("m", "member_length"),
    "tension": ("N", "member_tension"),
}
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
    """Values of channels over time.

    Attributes
    ----------
    time : ndarray, shape (n_t,) [s]
        Increasing, from 0 or later on; the motion starts at 0 in the state of the scene.
    channels : tuple of Channel
        What was measured.
    value : ndarray, shape (n_t, n_channels)
        Values in the units of the channels, NaN where one is missing.
    source : str
        The file, for messages.
    """

    time: FloatArray
    channels: tuple[Channel, ...]
    value: FloatArray
    source: str = "measured"

    @property
    def count(self) -> int:
        """Number of values that are not missing."""
        return int(np.isfinite(self.value).sum())


def list_channels(structure: Structure) -> dict[str, Channel]:
    """Return all that can be measured of a structure, by its name as in files of motions.

    ``t1.x [m]``, ``t1.vx [m/s]``, ``bar1.length [m]``, ``bar1.tension [N]``.
    """
    return {f"{item.name} [{item.unit}]": item for item in _list(structure)}


def _list(structure: Structure) -> Iterator[Channel]:
    for node, name in enumerate(structure.node_name):
        for axis, letter in enumerate("xyz"):
            yield Channel(f"{name}.{letter}", "position", (node, axis))
            yield Channel(f"{name}.v{letter}", "velocity", (node, axis))
    for member, name in enumerate(structure.member_name):
        yield Channel(f"{name}.length", "length", (member,))
        yield Channel(f"{name}.tension", "tension", (member,))


def read_measurements(
    measured: str | Path | Mapping[str, ArrayLike] | Measurements, structure: Structure
) -> Measurements:
    """Return what was measured, from a CSV file or from arrays by name.

    Parameters
    ----------
    measured : str, Path, mapping or Measurements
        File with the column ``time`` and columns as ``t1.x``, ``t1.vx``, ``bar1.length``, ``bar1.tension``,
        each with or without its unit (``t1.x [m]``, as files of motions have them); cells of what is missing
        are empty. Or a mapping of such names to arrays (n_t,), NaN where a value is missing.
    structure : Structure
        Whose nodes and members are named.

    Returns
    -------
    Measurements
        Times, channels and values.

    Raises
    ------
    SceneError
        The file cannot be read or is no table.
    UnknownKeyError, UnknownNameError
        A column of what the structure does not have; the message lists near ones.
    InvalidValueError
        No column but the time, no values, times that do not increase or are below zero, unequal lengths.
    NonFiniteError
        A time that is not finite, or a value that is infinite.
    """
    if isinstance(measured, Measurements):
        return measured
    known = list_channels(structure)
    known |= {item.name: item for item in known.values()}
    if isinstance(measured, str | Path):
        names, table, source = _read_file(Path(measured), known)
    else:
        names, table = _read_arrays(measured, known)
        source = "measured"
    channels = tuple(known[name] for name in names[1:])
    _check_twice(channels, source)
    found = Measurements(table[:, 0], channels, table[:, 1:], source)
    _check(found)
    return found


def _read_file(path: Path, known: Mapping[str, Channel]) -> tuple[list[str], FloatArray, str]:
    rows = read_table(path, (TIME, f"{TIME} [s]", *known, *IGNORED), ())
    header = list(rows[0].cells) if rows else []
    time = next((name for name in (TIME, f"{TIME} [s]") if name in header), None)
    if time is None:
        raise InvalidValueError(
            "the table has no times" if rows else "the table has no rows",
            where=str(path),
            given=", ".join(header) or "nothing",
            allowed=f"a column {TIME} [s], and columns of what was measured then",
        )
    names = [time, *(name for name in header if name not in (time, *IGNORED))]
    numbers = [[row.number(name) for name in names] for row in rows]
    missing = [row for row, cells in zip(rows, numbers, strict=True) if cells[0] is None]
    if missing:
        missing[0].text(time)  # which refuses an empty cell
    table = np.array([[np.nan if cell is None else cell for cell in cells] for cells in numbers])
    return names, table.reshape(len(rows), len(names)), str(path)


def _read_arrays(
    measured: Mapping[str, ArrayLike], known: Mapping[str, Channel]
) -> tuple[list[str], FloatArray]:
    time = next((name for name in (TIME, f"{TIME} [s]") if name in measured), None)
    if time is None:
        raise InvalidValueError(
            "no times are given",
            where="measured",
            given=", ".join(measured) or "nothing",
            allowed=f"{TIME!r}",
        )
    names = [time, *(name for name in measured if name != time and name not in IGNORED)]
    for name in names[1:]:
        check_choice(name, known, "measured number", "measured")
    arrays = [np.asarray(to_doubles(measured[name], name, "(n_t,)"), dtype=float) for name in names]
    for name, array in zip(names, arrays, strict=True):
        if array.shape != (arrays[0].size,):
            raise InvalidValueError(
                "as many values as times are needed",
                where=f"measured: {name}",
                given=array.shape,
                allowed=f"({arrays[0].size},), NaN where a value is missing",
            )
    return names, np.column_stack(arrays)


def _check_twice(channels: Sequence[Channel], source: str) -> None:
    names = [item.name for item in channels]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise InvalidValueError("measured twice", where=source, given=twice, allowed="each number once")


def _check(found: Measurements) -> None:
    time, where = found.time, f"{found.source}: {TIME}"
    if np.isinf(found.value).any():
        raise NonFiniteError("a measured value is infinite", where=found.source, allowed="finite values")
    if not found.channels or not found.count:
        raise InvalidValueError(
            "nothing was measured", where=found.source, allowed="columns such as t1.x [m] or bar1.length [m]"
        )
    if not np.isfinite(time).all():
        raise NonFiniteError("a time is not finite", where=where, allowed="finite times")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size or time[0] < 0.0:
        first: Any = (
            f"{time[0]:g} s" if not back.size else f"{time[back[0] + 1]:g} s after {time[back[0]]:g} s"
        )
        raise InvalidValueError(
            "times go back, or stand still" if back.size else "a time lies before the start of the motion",
            where=where,
            given=first,
            allowed="increasing times from 0 on",
        )
    if time[-1] == 0.0:
        raise InvalidValueError(
            "all was measured at the start", where=where, given="0 s", allowed="times after 0"
        )
