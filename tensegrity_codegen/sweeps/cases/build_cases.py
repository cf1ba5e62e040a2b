"""Cases from statements of a user: ranges (`start:stop:n[:log]`, `a,b,c`), distributions, a table."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.sweeps.cases.cases import Axis, Cases, Points
from tensegrity_codegen.sweeps.cases.sampled import build_sample, read_count, read_number
from tensegrity_codegen.sweeps.cases.table import to_table
from tensegrity_codegen.sweeps.keys import parse_path
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError

MOST_CASES = 100_000  # without an express yes
LARGEST_SAMPLE = 2**30  # rows, that a Sobol' sequence can have

# KEY=RANGE texts of the command line, or a mapping of key to range.
Stated = Mapping[str, Any] | Iterable[str] | None
RANGE_RULE = "start:stop:n, start:stop:n:log, or values with commas: 1,2,5"
MOST_VALUES = 10_000_000  # of one axis


def build_cases(
    over: Stated = (),
    sample: Stated = (),
    table: str | Path | Mapping[str, Any] | None = None,
    *,
    n: int | None = None,
    seed: int = 0,
    method: str = "random",
    yes: bool = False,
    options: Mapping[str, str] | None = None,
) -> Cases:
    """Return the cases that ranges, distributions and a table state.

    over: axes of a grid: key -> ``"0:1:11"``, ``"1:1000:4:log"``, ``"1,2,5"`` or numbers; or texts
        ``"KEY=0:1:11"``.
    sample: distributions: key -> ``"normal(1,0.1)"`` or ``("normal", 1, 0.1)``; or texts
        ``"KEY=normal(1,0.1)"``.
    table: a CSV file with a column for each key and a row for each case, or such columns.
    n: number of samples; of method ``"saltelli"`` the base number, which gives n (D + 2) cases of D keys.
    seed: seed of the sample.
    method: ``"random"``, ``"latin_hypercube"``, ``"sobol"`` or ``"saltelli"``.
    yes: whether more than MOST_CASES cases are meant.
    options: how messages name over, sample, table, n, seed, sampling and yes; by default by these names.
    Returns each point of the grid with each row of the sample or table. Raises InvalidValueError,
    NonFiniteError, UnknownNameError, DuplicateNameError, SceneError: nothing varies, an impossible range,
    distribution or table, a key stated twice, too many cases.
    """
    names = ("over", "sample", "table", "n", "seed", "sampling", "yes")
    option_names = {name: name for name in names} | dict(options or {})
    axes = [(key, stated) for key, stated in _pairs(over, option_names["over"], RANGE_RULE)]
    drawn = _pairs(sample, option_names["sample"], "normal(m,s), uniform(a,b), lognormal(m,s)")
    points = _build_points(drawn, table, n, seed, method, option_names)
    keys = [*(key for key, _ in axes), *(points.keys if points else ())]
    _check_keys(keys, option_names)
    for option, pairs in (("over", axes), ("sample", drawn)):
        for key, _ in pairs:
            parse_path(key, option_names[option])
    grid = (read_axis(key, stated, f"{option_names['over']} {key}") for key, stated in axes)
    cases = Cases(tuple(grid), points)
    _check_count(cases, yes, option_names)
    return cases


def _pairs(given: Stated, where: str, rule: str) -> list[tuple[str, Any]]:
    """Return pairs of key and statement, from texts KEY=... or a mapping."""
    if isinstance(given, Mapping):
        return [(str(key), stated) for key, stated in given.items()]
    if given is not None and (not isinstance(given, Iterable) or getattr(given, "ndim", 1) != 1):
        allowed = f"a dictionary of keys, or texts KEY={rule}"
        raise InvalidValueError("not keys with their values", where=where, given=given, allowed=allowed)
    pairs = []
    for pair in [given] if isinstance(given, str) else () if given is None else given:
        key, equals, value = str(pair).partition("=")
        if not (equals and key.strip() and value.strip()):
            problem = "not of the form KEY=VALUES"
            raise InvalidValueError(problem, where=where, given=pair, allowed=f"KEY={rule}")
        pairs.append((key.strip(), value.strip()))
    return pairs


def _build_points(
    drawn: list[tuple[str, Any]], table: Any, n: Any, seed: Any, method: str, words: Mapping[str, str]
) -> Points | None:
    if drawn and table is not None:
        problem = "a sample and a table together"
        allowed = f"{words['sample']} or {words['table']}, each also with {words['over']}"
        raise InvalidValueError(problem, where=words["sample"], given=drawn[0][0], allowed=allowed)
    if not drawn:
        _check_no_sample(n, seed, method, words)
        return None if table is None else to_table(table, words["table"])
    if n is None:
        problem = "the number of samples is missing"
        raise InvalidValueError(problem, where=words["n"], allowed="a whole number from 1 on")
    return build_sample(drawn, n, seed, method, words["sample"])


def _check_no_sample(n: Any, seed: Any, method: Any, words: Mapping[str, str]) -> None:
    """Raise InvalidValueError for settings of a sample without distributions."""
    stated = (
        ("n", n, n is not None, "a number of samples"),
        ("seed", seed, seed not in (0, None), "a seed"),
        ("sampling", method, method not in ("random", None), "a way of sampling"),
    )
    for name, value, is_stated, setting in stated:
        if is_stated:
            problem = f"{setting} without distributions"
            allowed = f"with {words['sample']} KEY=normal(m,s), for example"
            raise InvalidValueError(problem, where=words[name], given=value, allowed=allowed)


def _check_keys(keys: list[str], words: Mapping[str, str]) -> None:
    if not keys:
        location = f"{words['over']}, {words['sample']}, {words['table']}"
        hint = f"{words['over']} shape.height=0.2:0.4:11"
        raise InvalidValueError("nothing varies", where=location, allowed="at least one key", hint=hint)
    for key in keys:
        if keys.count(key) > 1:
            problem = "a key varies twice"
            raise DuplicateNameError(problem, where=words["over"], given=key, allowed="each key once")


def _check_count(cases: Cases, yes: bool, words: Mapping[str, str]) -> None:
    if cases.points is not None and cases.points.count > LARGEST_SAMPLE:
        problem, value = "too many samples", cases.points.count
        raise InvalidValueError(problem, where=words["n"], given=value, allowed=f"up to {LARGEST_SAMPLE:,}")
    if cases.count > MOST_CASES and not yes:
        sizes = " x ".join(f"{size:,}" for size in cases.shape)
        raise InvalidValueError(
            f"too many cases for a sweep that is not confirmed: {cases.count:,}"
            + (f" ({sizes})" if len(cases.shape) > 1 else ""),
            where=f"{words['over']}, {words['sample']}, {words['table']}",
            given=cases.count,
            allowed=f"up to {MOST_CASES:,}; more with {words['yes']}",
        )


def read_axis(key: str, given: Any, where: str) -> Axis:
    """Return the axis of a key from a text as `0:1:11`, `1:1000:4:log` or `1,2,5`, or from numbers."""
    if isinstance(given, str):
        values = _read_range(given, where) if ":" in given else _read_list(given.split(","), given, where)
    elif isinstance(given, Iterable):
        values = _read_list(given, given, where)
    else:
        values = np.array([read_number(given, where, "value")])
    ordered = np.sort(values)
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    if same.size:
        twice = f" (the value {float(ordered[same[0]])!r} appears twice)"
        problem, hint = f"values of a grid must differ{twice}", "give fewer values, or a wider range"
        raise InvalidValueError(problem, where=where, given=given, allowed="each value once", hint=hint)
    return Axis(key, values)


def _read_range(text: str, where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    fields = text.split(":")
    if len(fields) not in (3, 4):
        raise InvalidValueError("not a range", where=where, given=text, allowed=RANGE_RULE)
    if len(fields) == 4 and fields[3].strip() != "log":
        raise InvalidValueError("unknown spacing", where=where, given=fields[3], allowed="log, or nothing")
    start, stop = read_number(fields[0], where, "start"), read_number(fields[1], where, "stop")
    count = read_count(fields[2], where, "number of values")
    if count > MOST_VALUES:
        allowed = f"up to {MOST_VALUES:,} values of one key"
        raise InvalidValueError("too many values", where=where, given=count, allowed=allowed)
    if start == stop and count > 1:
        allowed = "a stop that is not the start, or one value"
        raise InvalidValueError("an empty range", where=where, given=text, allowed=allowed)
    if len(fields) == 3:
        return np.linspace(start, stop, count)
    if not (start > 0 and stop > 0):
        problem = "a logarithmic range with a bound that is not positive"
        hint = f"without log: {fields[0]}:{fields[1]}:{fields[2]}"
        raise InvalidValueError(problem, where=where, given=text, allowed="bounds greater than 0", hint=hint)
    return np.geomspace(start, stop, count)


def _read_list(parts: Iterable[Any], given: Any, where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    values = list(parts)
    if not values or (len(values) == 1 and isinstance(values[0], str) and not values[0].strip()):
        raise InvalidValueError("no values", where=where, given=given, allowed=RANGE_RULE)
    if any(isinstance(value, str) and not value.strip() for value in values):
        raise InvalidValueError("a value is missing", where=where, given=given, allowed=RANGE_RULE)
    return np.array([read_number(value, where, "value") for value in values])
