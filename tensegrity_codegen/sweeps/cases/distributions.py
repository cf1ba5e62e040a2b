"""Distributions of one number, `normal(m,s)`, `uniform(a,b)`, `lognormal(m,s)`; numbers from texts."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, check_choice

_CALL = re.compile(r"\s*([A-Za-z_]\w*)\s*\((.*)\)\s*", re.DOTALL)

# Name -> its two parameters.
DISTRIBUTIONS: Mapping[str, tuple[str, str]] = {
    "normal": ("mean", "standard deviation"),
    "uniform": ("lower bound", "upper bound"),
    "lognormal": ("mean of the logarithm", "standard deviation of the logarithm"),
}


@dataclass(frozen=True)
class Distribution:
    """The distribution of one number.

    kind: ``"normal"``: mean and standard deviation. ``"uniform"``: between two bounds. ``"lognormal"``: the
    natural logarithm is normal with this mean and standard deviation; first, second: its two parameters.
    """

    kind: str
    first: float
    second: float

    def compute_quantile(self, probability: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values below which these parts (0 < p < 1) of the distribution lie."""
        if self.kind == "uniform":
            values: NDArray[np.float64] = self.first + (self.second - self.first) * probability
            return values
        values = self.first + self.second * ndtri(probability)
        return np.exp(values) if self.kind == "lognormal" else values

    def __str__(self) -> str:
        return f"{self.kind}({self.first!r},{self.second!r})"


def read_distribution(given: Any, where: str) -> Distribution:
    """Return the distribution that a text as `normal(1,0.1)` states, or a sequence as ("normal", 1, 0.1).

    Raises UnknownNameError (no such distribution), InvalidValueError (not two numbers, or not in order) or
    NonFiniteError.
    """
    if isinstance(given, Distribution):
        kind, parts = given.kind, [given.first, given.second]
    elif isinstance(given, str):
        call = _CALL.fullmatch(given)
        if call is None:
            raise _not_a_distribution(given, where)
        kind, parts = call[1], call[2].split(",")  # type: ignore[assignment]
    else:
        try:
            kind, *parts = given
        except (TypeError, ValueError):
            raise _not_a_distribution(given, where) from None
    check_choice(kind, DISTRIBUTIONS, "distribution", where)
    if len(parts) != 2:
        raise _not_a_distribution(given, where)
    words = DISTRIBUTIONS[kind]
    first, second = (read_number(part, where, word) for part, word in zip(parts, words, strict=True))
    if kind == "uniform" and not first < second:
        raise InvalidValueError(
            "an empty range", where=where, given=given, allowed="a lower bound less than the upper bound"
        )
    if kind != "uniform" and not second > 0:
        raise InvalidValueError(
            f"the {words[1]} is not positive", where=where, given=given, allowed="a number greater than 0"
        )
    _check_range(Distribution(kind, first, second), given, where)
    return Distribution(kind, first, second)


def _check_range(distribution: Distribution, given: Any, where: str) -> None:
    """Raise NonFiniteError for a distribution whose values overflow, as lognormal(1000, 1)."""
    with np.errstate(over="ignore"):
        ends = distribution.compute_quantile(np.array([1e-17, 1.0 - 2.0**-53]))
    if not (np.isfinite(ends).all() and math.isfinite(distribution.second - distribution.first)):
        raise NonFiniteError(
            "values of this distribution are too large for a number",
            where=where,
            given=given,
            allowed="parameters of ordinary size",
        )


def _not_a_distribution(given: Any, where: str) -> InvalidValueError:
    return InvalidValueError(
        "not a distribution",
        where=where,
        given=given,
        allowed="normal(mean,deviation), uniform(a,b), or lognormal(mean,deviation) of the logarithm",
    )


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
