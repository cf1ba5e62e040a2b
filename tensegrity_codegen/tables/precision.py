"""The precision of a library's numbers: how C and NumPy call them, how far they reach."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.system.errors import InvalidValueError, check_choice


@dataclass(frozen=True)
class Precision:
    """One kind of numbers: its name in C, the ending of literals and functions of <math.h>, NumPy's type."""

    name: str
    c_type: str
    suffix: str
    dtype: np.dtype[np.floating]

    @property
    def largest(self) -> float:
        """The largest finite number."""
        return float(np.finfo(self.dtype).max)


# The first is the default.
PRECISIONS: Mapping[str, Precision] = {
    "double": Precision("double", "double", "", np.dtype(np.float64)),
    "single": Precision("single", "float", "f", np.dtype(np.float32)),
}


def find_precision(name: str, where: str = "model.precision") -> Precision:
    """Return the precision of that name; raises UnknownNameError, naming `where`, for an unknown one."""
    check_choice(name, PRECISIONS, "precision", where)
    return PRECISIONS[name]


def check_precision(value: float, precision: Precision, where: str) -> None:
    """Raise InvalidValueError if a finite `value` is too large for the precision; `where` names its owner."""
    if precision.largest < abs(value) < np.inf:
        problem, allowed = f"too large for {precision.name} precision", f"up to {precision.largest:.6g}"
        hint = 'a smaller value, or precision = "double"'
        raise InvalidValueError(problem, where=where, given=float(value), allowed=allowed, hint=hint)
