"""Checks of numbers that callers hand in: whole numbers of things, positive numbers, numbers at all."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any, TypeGuard

from tensegrity_codegen.errors import InvalidValueError

__all__ = ["check_positive", "check_switch", "check_whole", "is_number", "is_whole"]


def is_whole(value: Any) -> TypeGuard[int]:
    """Return whether a value is an integer of Python or NumPy; True and False are none."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a finite real number of Python or NumPy; True and False are none."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def check_whole(
    value: Any, where: str, least: int, most: int | None = None, problem: str = "out of range", hint: str = ""
) -> int:
    """Return a whole number from `least` to `most`; raises InvalidValueError, naming what is allowed."""
    if is_whole(value) and least <= value and (most is None or value <= most):
        return int(value)
    upper = "on" if most is None else f"to {most}"
    raise InvalidValueError(
        problem, where=where, given=value, allowed=f"a whole number from {least} {upper}", hint=hint
    )


def check_switch(value: Any, where: str) -> bool:
    """Return True or False; raises InvalidValueError for anything else, such as "no"."""
    if value is True or value is False:
        return value
    raise InvalidValueError("not a switch", where=where, given=value, allowed="True or False")


def check_positive(value: Any, where: str, unit: str = "") -> float:
    """Return a finite number above zero; raises InvalidValueError. unit: "[s]", for the message."""
    if is_number(value) and value > 0:
        return float(value)
    raise InvalidValueError(
        "out of range", where=where, given=value, allowed=f"a finite number > 0 {unit}".strip()
    )
