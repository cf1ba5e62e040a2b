"""A profile bound to a model: its arguments over time, in Python and as the C integrators read them.

A profile must not change lengths of rigid bars, nor laws of members with own tensions in the implicit method.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np

from tensegrity_codegen.runtime.model.arguments import INPUT, unify_name
from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.pieces import Pieces
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import InvalidValueError, name_list
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR
from tensegrity_codegen.tables.manifest import Manifest

SAME_TIME = 1e-12  # of t_end, by which rounding may have a profile end before it
EXTRA_TIME = 1e-12  # of the last time, by which n steps of a fixed length may end beyond it


@dataclass(frozen=True, eq=False)
class DrivenArguments:
    """Run-time arguments of one model that change with time; call it with a time [s] for their values."""

    pieces: Pieces  # of all values that change
    place: tuple[tuple[str, int], ...]  # argument of each value, and its index among its numbers
    base: Mapping[str, FloatArray]  # value of each argument, where no piece changes it

    def __call__(self, time: float) -> dict[str, FloatArray]:
        """Return the arguments that change, by name, at a time [s]."""
        return self.put(self.pieces.at(time))

    def put(self, values: FloatArray) -> dict[str, FloatArray]:
        """Return the arguments that change, by name, with these values (n_values,)."""
        arguments = {name: array.copy() for name, array in self.base.items()}
        for name, (index, column) in self._columns.items():
            arguments[name].reshape(-1)[index] = values[column]
        return arguments

    @cached_property
    def _columns(self) -> dict[str, tuple[IntArray, IntArray]]:
        """Of each argument, the indices of its numbers that change, and their columns among the values."""
        rows = {
            name: [(k, at) for at, (argument, k) in enumerate(self.place) if argument == name]
            for name in self.base
        }
        pairs = {name: np.array(row, dtype=np.int64) for name, row in rows.items()}
        return {name: (pair[:, 0], pair[:, 1]) for name, pair in pairs.items()}


def bind_profile(
    model: CompiledModel, profile: Profile, arguments: Mapping[str, Any], t_end: float
) -> DrivenArguments:
    """Return the arguments of a model that a profile changes up to t_end [s], others as in `arguments`."""
    check_end(profile, t_end)
    base, numbers = {}, []
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
        start = model.manifest.input_name.index(name) if argument != name else 0
        numbers += [(argument, start + k) for k in range(int(np.prod(shape)))]
    if len(set(numbers)) < len(numbers):
        raise InvalidValueError(
            "an input is given twice",
            where="profile",
            given=", ".join(profile.values),
            allowed=f"names of inputs, or {INPUT}: {', '.join(model.manifest.input_name)}",
        )
    pieces = profile.pieces
    if pieces.time[-1] < t_end:  # by rounding
        pieces = replace(pieces, time=np.append(pieces.time[:-1], t_end))
    return DrivenArguments(pieces, tuple(numbers), base)


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
    """Raise InvalidValueError for an input that has a profile and a constant value."""
    driven = (*profile.values, *(input_name if INPUT in profile.values else ()))
    named = [name for name in driven if name in arguments]
    if named:
        raise InvalidValueError(
            "an input has a profile and a constant value",
            where=where or f"arguments.{named[0]}",
            given=f"{named[0]} in the profile, and {arguments[named[0]]!r}",
            allowed="one of them",
        )


class KnotsInC:
    """The struct that an integration in C follows, and its arrays; KeyError for arguments not in C."""

    def __init__(self, ffi: Any, manifest: Manifest, driven: DrivenArguments) -> None:
        # Where each argument begins among the numbers that can change with time
        start_of, position = {}, 0
        for name in manifest.driven:
            start_of[name] = position
            position += len(manifest.argument(name).nominal) if name != "pull" else 0  # which stands last
        pieces = driven.pieces
        time = pieces.time.copy()
        time[-1] += EXTRA_TIME * abs(time[-1])
        n_pieces, rows, n_values = pieces.coefficient.shape
        self._arrays = (
            np.array([start_of[name] + k for name, k in driven.place], dtype=np.int32),
            time,
            np.ascontiguousarray(pieces.coefficient, dtype=np.float64),
            np.ascontiguousarray(pieces.is_kink, dtype=np.int32),
        )
        kinds = ("int[]", "double[]", "double[]", "int[]")
        names = ("place", "time", "coefficient", "is_kink")
        self._kept = [ffi.from_buffer(kind, array) for kind, array in zip(kinds, self._arrays, strict=True)]
        self.struct = ffi.new("integrator_profile *")
        self.struct.n_pieces, self.struct.degree, self.struct.n_values = n_pieces, rows - 1, n_values
        for name, pointer in zip(names, self._kept, strict=True):
            setattr(self.struct, name, pointer)


def follows_in_c(schedule: Any, manifest: Manifest) -> TypeGuard[DrivenArguments]:
    """Return whether the C integrators of a library can follow a schedule."""
    if not isinstance(schedule, DrivenArguments):
        return False
    return all(name in manifest.driven for name, _ in schedule.place)


def find_changing(model: CompiledModel, schedule: DrivenArguments) -> tuple[str, ...]:
    """Return the members, or "masses", that the implicit method holds constant and a profile changes."""
    tensions = next(
        (spec.tensions for spec in model.manifest.integrators if spec.name == STIFF_INTEGRATOR), ()
    )
    if not model.has("member_law") or not model.has("mass_matrix"):
        return ()
    chosen = list(tensions)
    law, mass = _evaluate(model, schedule, 0.0)
    changed, masses = np.zeros(len(chosen), dtype=bool), False
    for time in _list_times(schedule):
        new_law, new_mass = _evaluate(model, schedule, time)
        changed |= (new_law[chosen] != law[chosen]).any(axis=1)
        masses |= bool((new_mass != mass).any())
    names = [model.manifest.member_name[chosen[k]] for k in np.flatnonzero(changed)]
    return (*names, "masses") if masses else tuple(names)


def check_laws(model: CompiledModel, schedule: Any) -> None:
    """Raise InvalidValueError if the implicit method cannot follow a profile; names the members."""
    names = find_changing(model, schedule)
    if names:
        shown = name_list(names)
        raise InvalidValueError(
            f"{STIFF_INTEGRATOR} holds masses, and rest lengths and stiffnesses of members without slack, "
            "constant",
            where="schedule",
            given=f"a profile that changes {shown}",
            allowed="profiles of cables that can go slack, loads and forces",
            hint='method="auto" or an explicit method follows this profile',
        )


def check_rigid(model: CompiledModel, schedule: DrivenArguments) -> None:
    """Raise InvalidValueError for a profile that changes the length of a rigid bar, a fixed constraint."""
    name = "consistent_coordinate"
    if not model.has(name) or not set(schedule.base) & set(model.function(name).spec.arguments):
        return
    nominal = model.nominal("coordinate")
    _check_constant(
        schedule,
        lambda time: model.compute(name, coordinate=nominal, **schedule(time)),
        "rigid bars keep their lengths during a motion",
        allowed="profiles of members with a stiffness, loads and forces",
        hint="give the bar an axial_stiffness",
    )


def check_memory(model: CompiledModel, schedule: DrivenArguments) -> None:
    """Raise InvalidValueError for a profile that changes rest lengths or laws of plastic members."""
    if not model.has("yield_margin"):
        return
    _check_constant(
        schedule,
        lambda time: model.compute("yield_margin", **schedule(time)),
        "rest lengths and laws of plastic members are constant during a motion",
        allowed="profiles of elastic members, loads and forces",
        hint="simulate in parts, each from where the last one ended",
    )


def _check_constant(
    schedule: DrivenArguments, compute: Callable[[float], FloatArray], problem: str, **advice: str
) -> None:
    """Raise InvalidValueError if a profile changes a result that is computed at times [s]."""
    initial = compute(0.0)
    for time in _list_times(schedule):
        if (compute(time) != initial).any():
            given = f"a profile that changes them at t = {time:.6g} s"
            raise InvalidValueError(problem, where="schedule", given=given, **advice)


def _list_times(schedule: DrivenArguments) -> list[float]:
    """Return times [s] of every piece; a polynomial that is constant at so many points is constant."""
    pieces = schedule.pieces
    start, end = pieces.time[:-1], pieces.time[1:]
    rows = pieces.coefficient.shape[1]
    fractions = np.arange(rows) / rows
    return list(
        np.sort(np.concatenate([start + fraction * (end - start) for fraction in fractions])).tolist()
    )


def _evaluate(model: CompiledModel, schedule: DrivenArguments, time: float) -> tuple[Any, Any]:
    """Return laws (n_members, ...) and the entries of the mass matrix at a time [s]."""
    arguments = schedule(time)
    return np.asarray(model.compute("member_law", **arguments)), model.compute(
        "mass_matrix", **arguments
    ).data
