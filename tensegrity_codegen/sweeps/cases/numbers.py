"""One number of what varies, from a text or a number."""

import math
import re
from typing import Any

from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError

_NUMBER = re.compile(r"\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*")
_NOT_FINITE = ("nan", "inf", "infinity")


def read_number(given: Any, where: str, what: str = "number") -> float:
    """Return a finite number; raises NonFiniteError or InvalidValueError, which name `where` and `what`."""
    if isinstance(given, str):
        if given.strip().lower().lstrip("+-") in _NOT_FINITE:
            raise NonFiniteError(f"the {what} is not finite", where=where, given=given)
        number = float(given) if _NUMBER.fullmatch(given) else None
    else:
        try:
            number = None if isinstance(given, bool) else float(given)
        except (TypeError, ValueError, OverflowError):
            number = None
    if number is None:
        raise InvalidValueError(
            f"the {what} is not a number", where=where, given=given, allowed="a number such as 0.25 or 1e-3"
        )
    if not math.isfinite(number):
        raise NonFiniteError(f"the {what} is not finite", where=where, given=given)
    return number


def read_count(given: Any, where: str, what: str, least: int = 1) -> int:
    """Return a whole number from `least` on; raises InvalidValueError."""
    number = read_number(given, where, what)
    if not number.is_integer() or number < least:
        raise InvalidValueError(
            f"the {what} is not possible", where=where, given=given, allowed=f"a whole number from {least} on"
        )
    return int(number)
