"""Axes of a grid from texts: `start:stop:n`, `start:stop:n:log`, `a,b,c`."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from tensegrity_codegen.sweeps.cases.cases import Axis
from tensegrity_codegen.sweeps.cases.numbers import read_count, read_number
from tensegrity_codegen.system.errors import InvalidValueError

RANGE_RULE = "start:stop:n, start:stop:n:log, or values with commas: 1,2,5"
MOST_VALUES = 10_000_000  # of one axis


def read_axis(key: str, given: Any, where: str) -> Axis:
    """Return the axis of a key.

    given: a text as `0:1:11`, `1:1000:4:log` or `1,2,5`, or a sequence of numbers. Raises InvalidValueError
    (no range, an empty one, a logarithmic one with a bound that is not positive, a value twice) or
    NonFiniteError.
    """
    if isinstance(given, str):
        values = _read_range(given, where) if ":" in given else _read_list(given.split(","), given, where)
    elif isinstance(given, Iterable):
        values = _read_list(given, given, where)
    else:
        values = np.array([read_number(given, where, "value")])
    _check_different(values, given, where)
    return Axis(key, values)


def _read_range(text: str, where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    parts = text.split(":")
    if len(parts) not in (3, 4):
        raise InvalidValueError("not a range", where=where, given=text, allowed=RANGE_RULE)
    if len(parts) == 4 and parts[3].strip() != "log":
        raise InvalidValueError("unknown spacing", where=where, given=parts[3], allowed="log, or nothing")
    start, stop = read_number(parts[0], where, "start"), read_number(parts[1], where, "stop")
    count = read_count(parts[2], where, "number of values")
    if count > MOST_VALUES:
        raise InvalidValueError(
            "too many values", where=where, given=count, allowed=f"up to {MOST_VALUES:,} values of one key"
        )
    if start == stop and count > 1:
        raise InvalidValueError(
            "an empty range", where=where, given=text, allowed="a stop that is not the start, or one value"
        )
    if len(parts) == 3:
        return np.linspace(start, stop, count)
    if not (start > 0 and stop > 0):
        raise InvalidValueError(
            "a logarithmic range with a bound that is not positive",
            where=where,
            given=text,
            allowed="bounds greater than 0",
            hint=f"without log: {parts[0]}:{parts[1]}:{parts[2]}",
        )
    return np.geomspace(start, stop, count)


def _read_list(parts: Iterable[Any], given: Any, where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    items = list(parts)
    if not items or (len(items) == 1 and isinstance(items[0], str) and not items[0].strip()):
        raise InvalidValueError("no values", where=where, given=given, allowed=RANGE_RULE)
    if any(isinstance(item, str) and not item.strip() for item in items):
        raise InvalidValueError("a value is missing", where=where, given=given, allowed=RANGE_RULE)
    return np.array([read_number(item, where, "value") for item in items])


def _check_different(values: np.ndarray[Any, np.dtype[np.float64]], given: Any, where: str) -> None:
    ordered = np.sort(values)
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    if same.size:
        twice = f" (the value {float(ordered[same[0]])!r} appears twice)"
        raise InvalidValueError(
            f"values of a grid must differ{twice}",
            where=where,
            given=given,
            allowed="each value once",
            hint="give fewer values, or a wider range",
        )
