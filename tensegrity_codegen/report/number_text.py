"""Numbers as people read them: true minus signs, powers of ten with raised digits."""

from __future__ import annotations

import math

__all__ = ["MISSING", "format_number", "raise_digits"]

MISSING = "–"
_MINUS = "−"
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def format_number(value: float | None, spec: str) -> str:
    """Return a number in the format `spec`: no signed zero, exponents as × 10ⁿ; None and NaN are a dash."""
    if value is None or math.isnan(value):
        return MISSING
    mantissa, letter, exponent = format(value, spec).partition("e")
    if not letter and not mantissa.strip("+-0."):
        mantissa = mantissa.lstrip("+-")
    mantissa = mantissa.replace("-", _MINUS)
    return f"{mantissa} × 10{raise_digits(int(exponent))}" if letter else mantissa


def raise_digits(number: int) -> str:
    """Return a whole number in raised digits: -3 -> ⁻³."""
    return str(number).translate(_RAISED)
