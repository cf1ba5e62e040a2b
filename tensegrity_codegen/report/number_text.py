"""Numbers and symbols as people read them: true minus signs, raised exponents, lowered indices."""

import math
import re

MISSING = "–"
# A symbol of one letter, or a Greek one by its name, with an index: T_S, M_3, H_δ, rho_e.
_INDEXED = re.compile(r"(?<![^\W_])(mu|rho|[^\W\d_])_([^\W_])(?![^\W_])")
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
    return f"{mantissa} × 10{raise_digits(int(exponent))}" if letter and int(exponent) else mantissa


def format_short(value: float | None, digits: int = 3) -> str:
    """Return a number for a sentence: so many digits, below a million without a power of ten."""
    if value is None or not math.isfinite(value):
        return format_number(value, "g")
    rounded = abs(float(f"{value:.{digits}g}"))
    return format_number(value, ",.0f" if 10.0 ** (digits - 1) <= rounded < 1e6 else f".{digits}g")


def raise_digits(number: int) -> str:
    """Return a whole number in raised digits: -3 -> ⁻³."""
    return str(number).translate(_RAISED)


def lower_indices(text: str, opening: str, closing: str) -> str:
    """Return text in which the index of each symbol like T_S stands between `opening` and `closing`."""
    return _INDEXED.sub(lambda match: f"{match[1]}{opening}{match[2]}{closing}", text)
