"""Checks of values from callers: numbers, switches, objects of this package, paths, moved arguments."""

import math
import os
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeGuard, TypeVar

from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError


def is_whole(value: Any) -> TypeGuard[int]:
    """Return whether a value is an integer of Python or NumPy; True and False are none."""
    return isinstance(value, Integral) and is_number(value)


def is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a finite real number of Python or NumPy; True and False are none."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except (OverflowError, TypeError):  # an integer that no double holds, a duration of NumPy
        return False


def check_whole(
    value: Any, where: str, least: int, most: int | None = None, problem: str = "out of range", hint: str = ""
) -> int:
    """Return a whole number from `least` to `most`; raises InvalidValueError, naming the range."""
    if is_whole(value) and least <= value and (most is None or value <= most):
        return int(value)
    upper = "on" if most is None else f"to {most}"
    allowed = f"a whole number from {least} {upper}"
    raise InvalidValueError(problem, where=where, given=value, allowed=allowed, hint=hint)


def check_switch(value: Any, where: str) -> bool:
    """Return True or False; raises InvalidValueError for anything else, such as "no"."""
    if value is True or value is False:
        return value
    raise InvalidValueError("not a switch", where=where, given=value, allowed="True or False")


def check_positive(value: Any, where: str, unit: str = "") -> float:
    """Return a finite number above zero; raises InvalidValueError. unit: "[s]", for the message."""
    if is_number(value) and value > 0:
        return float(value)
    problem = "out of range"
    raise InvalidValueError(problem, where=where, given=value, allowed=f"a finite number > 0 {unit}".strip())


def check_instance(value: Any, kinds: type | tuple[type, ...], where: str, allowed: str) -> None:
    """Raise InvalidValueError for a value of another type; allowed: valid values."""
    if not isinstance(value, kinds):
        raise InvalidValueError("wrong type", where=where, given=type(value).__name__, allowed=allowed)


def check_mapping(value: Any, where: str, allowed: str) -> Mapping[Any, Any]:
    """Return a mapping, an empty one for None; raises InvalidValueError for anything else."""
    if value is not None:
        check_instance(value, Mapping, where, f"a mapping: {allowed}")
    return value or {}


def check_pair(value: Any, where: str, allowed: str) -> tuple[float, float]:
    """Return two numbers, which may be infinite; raises InvalidValueError for anything else."""
    pair = tuple(value) if isinstance(value, list | tuple) or getattr(value, "shape", ()) == (2,) else ()
    if len(pair) == 2 and all(is_number(x) or (isinstance(x, float) and math.isinf(x)) for x in pair):
        return float(pair[0]), float(pair[1])
    raise InvalidValueError("not a pair of numbers", where=where, given=value, allowed=allowed)


def check_callback(value: Any, where: str) -> None:
    """Raise InvalidValueError for a value that is neither a function nor None."""
    if value is not None and not callable(value):
        raise InvalidValueError("not a function", where=where, given=value, allowed="a function, or None")


def check_names(value: Any, where: str) -> tuple[str, ...]:
    """Return names as a tuple, also a single one; raises InvalidValueError for another value."""
    listed = isinstance(value, Iterable) and getattr(value, "ndim", 1) == 1
    names: list[str] = []
    for name in (value,) if isinstance(value, str) else value if listed else (None,):
        if not isinstance(name, str):
            break
        names.append(name)
    else:
        return tuple(names)
    raise InvalidValueError("not a list of names", where=where, given=value, allowed="a list of texts")


def check_path(value: Any, where: str) -> None:
    """Raise InvalidValueError for a value that is no path of a file or folder."""
    path = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(path, str) or "\0" in path or any("\ud800" <= letter <= "\udbff" for letter in path):
        raise InvalidValueError("not a path", where=where, given=value, allowed="a text or a pathlib.Path")


P = ParamSpec("P")
R = TypeVar("R")


class MovedArgumentError(TensegrityError, TypeError):
    """A keyword that a function had, and that an object given to it has now."""


def with_moved(**places: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator for a function that had these arguments.

    places: name of an argument -> how it is stated now, such as ``"until=Until(condition=...)"``.
    The function raises MovedArgumentError for a call with one of the names.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            for name in kwargs:
                if name in places:
                    problem = f"{function.__name__} takes this argument in an object"
                    raise MovedArgumentError(problem, where=name, given=f"{name}=...", allowed=places[name])
            return function(*args, **kwargs)

        return call

    return decorate
