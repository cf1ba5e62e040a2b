"""Units as exponents of SI base units, for the unit definitions of a model description."""

import re

# Exponents of the units that quantities and arguments are given in.
BASE = {
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
}
FACTOR = re.compile(r"([A-Za-z]+)(\d*)")


def has_one_unit(unit: str) -> bool:
    """Return whether a text such as "N s/m" is one unit; "m or N" and "m, rad" are several."""
    return find_exponents(unit) is not None


def find_exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of SI base units in a unit, {} for "1".

    Parameters
    ----------
    unit : str
        Factors apart by spaces, a power behind each, those behind a slash in the denominator: "N s/m2".

    Returns
    -------
    dict of str to int, or None
        Base unit -> exponent, without zeros; None where the text is no unit of this form.
    """
    if unit == "1":
        return {}
    found: dict[str, int] = {}
    for k, part in enumerate(unit.split("/")):
        for word in part.split():
            match = FACTOR.fullmatch(word)
            if match is None or match[1] not in BASE:
                return None
            power = int(match[2] or 1) * (1 if k == 0 else -1)
            for base, exponent in BASE[match[1]].items():
                found[base] = found.get(base, 0) + power * exponent
    return {base: exponent for base, exponent in found.items() if exponent} if unit.strip() else None
