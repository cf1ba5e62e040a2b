"""A profile bound to a model: the arguments of the model over time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT, unify_name
from tensegrity_codegen.runtime.profiles.pieces import Pieces
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import InvalidValueError

SAME_TIME = 1e-12  # of t_end, by which rounding may have a profile end before it


@dataclass(frozen=True, eq=False)
class DrivenArguments:
    """Run-time arguments that change with time, of one model; call it with a time [s] for their values.

    pieces: of all values that change; place (n_values,): argument of each, and its index among the numbers of
    that argument; base: value of each argument that changes, where no piece changes it.
    """

    pieces: Pieces
    place: tuple[tuple[str, int], ...]
    base: Mapping[str, FloatArray]

    def __call__(self, time: float) -> dict[str, FloatArray]:
        """Return the arguments that change, by name, at a time [s]."""
        return self.put(self.pieces.at(time))

    def put(self, values: FloatArray) -> dict[str, FloatArray]:
        """Return the arguments that change, by name, with these values (n_values,)."""
        found = {name: array.copy() for name, array in self.base.items()}
        for name, (index, column) in self._columns.items():
            found[name].reshape(-1)[index] = values[column]
        return found

    @cached_property
    def _columns(self) -> dict[str, tuple[IntArray, IntArray]]:
        """Of each argument, the indices of its numbers that change, and their columns among the values."""
        rows = {
            name: [(k, at) for at, (own, k) in enumerate(self.place) if own == name] for name in self.base
        }
        pairs = {name: np.array(row, dtype=np.int64) for name, row in rows.items()}
        return {name: (pair[:, 0], pair[:, 1]) for name, pair in pairs.items()}


def bind_profile(
    model: CompiledModel, profile: Profile, arguments: Mapping[str, Any], t_end: float
) -> DrivenArguments:
    """Return the arguments of a model that a profile changes, the others as in `arguments`.

    arguments: constant ones, inputs in one array; t_end [s]: of the motion. Raises InvalidValueError for
    another shape, an input that is given twice, and a profile that ends before t_end.
    """
    check_end(profile, t_end)
    base, place = {}, []
    for name, values in profile.values.items():
        argument = unify_name(model.manifest, name)
        if argument not in base:
            nominal = model.nominal(argument)
            base[argument] = to_sized(arguments.get(argument, nominal), nominal.shape, argument)
            base[argument] = base[argument].reshape(nominal.shape)
        shape = () if argument != name else base[argument].shape
        if values.shape[1:] != shape:
            raise InvalidValueError(
                "wrong shape",
                where=f"profile.{name}",
                given=values.shape,
                allowed=f"shape {(len(profile.time), *shape)}, one row for each knot",
            )
        first = model.manifest.input_name.index(name) if argument != name else 0
        place += [(argument, first + k) for k in range(int(np.prod(shape)))]
    if len(set(place)) < len(place):
        raise InvalidValueError(
            "an input is given twice",
            where="profile",
            given=", ".join(profile.values),
            allowed=f"names of inputs, or {INPUT}: {', '.join(model.manifest.input_name)}",
        )
    pieces = profile.pieces
    if pieces.time[-1] < t_end:  # by rounding
        pieces = replace(pieces, time=np.append(pieces.time[:-1], t_end))
    return DrivenArguments(pieces, tuple(place), base)


def check_end(profile: Profile, t_end: float, where: str = "profile.time") -> None:
    """Raise InvalidValueError for a profile that ends before t_end [s]; where: it is from."""
    if profile.t_end < t_end * (1.0 - SAME_TIME):
        raise InvalidValueError(
            "the profile ends before the motion",
            where=where,
            given=f"last knot at {profile.t_end!r} s, end of the motion at {t_end!r} s",
            allowed="a last knot at the end of the motion or later",
            hint="add a knot, or simulate a shorter time",
        )


def check_not_constant(
    profile: Profile, arguments: Mapping[str, Any], input_name: Sequence[str] = (), where: str = ""
) -> None:
    """Raise InvalidValueError for an input that has a profile and a constant value.

    arguments: as given, names of inputs included; input_name: of the model, all of which the array `input`
    stands for in a profile; where: the profile is from, the argument if not given.
    """
    driven = (*profile.values, *(input_name if INPUT in profile.values else ()))
    named = [name for name in driven if name in arguments]
    if named:
        raise InvalidValueError(
            "an input has a profile and a constant value",
            where=where or f"arguments.{named[0]}",
            given=f"{named[0]} in the profile, and {arguments[named[0]]!r}",
            allowed="one of them",
        )
