"""Values of inputs over time: knots, linear or cubic in between."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.profiles.pieces import Pieces, build_cubic, build_linear
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_names, is_number
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, check_choice
from tensegrity_codegen.system.pickling import reduce_fields
from tensegrity_codegen.system.summaries import Summarised

KINDS = ("linear", "cubic")
BUILD = {"linear": build_linear, "cubic": build_cubic}


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Summarised):
    """Inputs and other run-time arguments as functions of time, for ``simulate(schedule=...)``.

    Attributes
    ----------
    time : ndarray, shape (n_knots,) [s]
        Times of the knots, from 0 on. Two equal times in a row are a jump: the value of the first holds
        before that time, that of the second from that time on.
    values : mapping of str to ndarray, shape (n_knots, ...)
        Values at the knots by the name of an input (a number at each knot) or of a run-time argument (its
        shape at each knot).
    kind : str
        Between knots: ``"linear"``, or ``"cubic"``: the cubic spline with continuous second derivative (its
        third derivative is continuous at the first and last inner knot); a new one after each jump.

    Raises
    ------
    InvalidValueError
        Times that go back, do not start at 0, or are three equal ones; arrays of another length; no values.
    NonFiniteError
        A time or value that is not finite.
    UnknownNameError
        Another kind.

    Examples
    --------
    >>> from tensegrity_codegen import Profile
    >>> ramp = Profile([0.0, 0.5, 1.0], {"motor": [0.0, 0.01, 0.01]})
    >>> float(ramp(0.25)["motor"])
    0.005
    """

    time: FloatArray
    values: Mapping[str, FloatArray]
    kind: Literal["linear", "cubic"] = "linear"

    if TYPE_CHECKING:  # sequences of numbers are given, arrays are kept

        def __init__(
            self,
            time: ArrayLike,
            values: Mapping[str, ArrayLike],
            kind: Literal["linear", "cubic"] = "linear",
        ) -> None: ...

    def __post_init__(self) -> None:
        check_choice(self.kind, KINDS, "kind of profile", "kind")
        check_instance(self.values, Mapping, "profile.values", "a dictionary: name -> values at the knots")
        check_names(self.values, "profile.values")
        time = _read_numbers(self.time, "time")
        _check_time(time)
        values = {name: _read_numbers(value, name) for name, value in dict(self.values).items()}
        if not values:
            raise InvalidValueError("the profile has no values", where="profile", allowed="one input or more")
        for name, array in values.items():
            if len(array) != len(time):
                raise InvalidValueError(
                    "the profile needs one value at each knot",
                    where=f"profile.{name}",
                    given=array.shape,
                    allowed=f"shape ({len(time)}, ...), for {len(time)} times",
                )
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", MappingProxyType(values))
        if not np.isfinite(self.pieces.coefficient).all():
            raise NonFiniteError(
                "knots are too close: the slopes between them are not finite",
                where="profile.time",
                given=f"smallest distance of two knots {float(np.diff(self.pieces.time).min())!r} s",
                allowed="knots farther apart, or smaller values",
            )

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the fields from which a pickle makes the profile again."""
        return reduce_fields(self)

    @property
    def t_end(self) -> float:
        """Time of the last knot [s]."""
        return float(self.time[-1])

    @cached_property
    def pieces(self) -> Pieces:
        """The polynomials between knots, of all values in one row each, in the order of `values`."""
        rows = [array.reshape(len(self.time), -1) for array in self.values.values()]
        with np.errstate(all="ignore"):  # what is not finite is refused
            return BUILD[self.kind](self.time, np.concatenate(rows, axis=1))

    def __call__(self, time: float) -> dict[str, FloatArray]:
        """Return the values at a time [s] by name; at a jump those after it."""
        if not is_number(time):
            raise InvalidValueError("not a time", where="time", given=time, allowed="a finite number [s]")
        row, values, start = self.pieces.at(time), {}, 0
        for name, array in self.values.items():
            shape = array.shape[1:]
            size = int(np.prod(shape))
            values[name] = row[start : start + size].reshape(shape)
            start += size
        return values


def _read_numbers(value: Any, name: str) -> FloatArray:
    """Return a read-only copy of an array of finite numbers with one row or more."""
    allowed = "numbers, one row for each knot"
    array = np.array(to_doubles(value, f"profile.{name}", allowed))
    if array.ndim == 0:
        raise InvalidValueError(
            "not an array of numbers", where=f"profile.{name}", given=value, allowed=allowed
        )
    if not np.isfinite(array).all():
        index = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        raise NonFiniteError(
            "not a finite number",
            where=f"profile.{name}",
            given=f"{array[index]} at knot {index[0]}",
            allowed="finite numbers",
        )
    array.setflags(write=False)
    return array


def _check_time(time: FloatArray) -> None:
    """Raise InvalidValueError for times (n_knots,) [s] that do not rise from 0."""
    if time.ndim != 1 or len(time) < 2:
        raise InvalidValueError(
            "too few knots", where="profile.time", given=time.shape, allowed="two times or more, from 0 on"
        )
    if time[0] != 0.0:
        raise InvalidValueError(
            "the profile does not start at 0",
            where="profile.time",
            given=float(time[0]),
            allowed="0 at the first knot",
            hint="add a knot at 0 with the value that the motion starts with",
        )
    # Rising times, of which two equal ones are a jump.
    gap = np.diff(time)
    if (gap < 0.0).any():
        k = int(np.argmax(gap < 0.0)) + 1
        raise InvalidValueError(
            "the time goes back",
            where="profile.time",
            given=f"{float(time[k])!r} at knot {k}, after {float(time[k - 1])!r}",
            allowed="rising times; two equal ones in a row for a jump",
        )
    same = gap == 0.0
    at_end = same[0] or same[-1]
    if at_end or (same[1:] & same[:-1]).any():
        k = int(np.argmax(same)) + 1
        raise InvalidValueError(
            "a jump at the start or the end" if at_end else "more than two knots at one time",
            where="profile.time",
            given=f"{float(time[k])!r} at knots {k - 1} and {k}",
            allowed="two equal times in a row, after the first knot and before the last one",
        )
