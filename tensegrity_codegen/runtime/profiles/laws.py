"""What a profile must not change: lengths of rigid bars and, for radau, laws of members with own tensions."""

from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR


def find_changing(model: CompiledModel, schedule: DrivenArguments) -> tuple[str, ...]:
    """Return the members whose laws radau holds constant and this profile changes.

    "masses" where these change; () for a library without radau.
    """
    tensions = next(
        (spec.tensions for spec in model.manifest.integrators if spec.name == STIFF_INTEGRATOR), ()
    )
    if not model.has("member_law") or not model.has("mass_matrix"):
        return ()
    chosen = list(tensions)
    law, mass = _evaluate(model, schedule, 0.0)
    changed, masses = np.zeros(len(chosen), dtype=bool), False
    for time in _list_times(schedule):
        other, other_mass = _evaluate(model, schedule, time)
        changed |= (other[chosen] != law[chosen]).any(axis=1)
        masses |= bool((other_mass != mass).any())
    names = [model.manifest.member_name[chosen[k]] for k in np.flatnonzero(changed)]
    return (*names, "masses") if masses else tuple(names)


def check_laws(model: CompiledModel, schedule: Any) -> None:
    """Raise InvalidValueError where radau cannot follow a profile, naming the members that it changes."""
    names = find_changing(model, schedule)
    if names:
        shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        raise InvalidValueError(
            "radau holds masses, and rest lengths and stiffnesses of members without slack, constant",
            where="schedule",
            given=f"a profile that changes {shown}",
            allowed="profiles of cables that can go slack, loads and forces",
            hint='method="auto" or an explicit method follows this profile',
        )


def check_rigid(model: CompiledModel, schedule: DrivenArguments) -> None:
    """Raise InvalidValueError for a profile that changes the length of a rigid bar.

    The equations of motion know constraints that stand still: they lack velocities and accelerations of a
    bar that grows.
    """
    name = "consistent_coordinate"
    if not model.has(name) or not set(schedule.base) & set(model.function(name).spec.arguments):
        return
    place = model.nominal("coordinate")
    first = model.compute(name, coordinate=place, **schedule(0.0))
    for time in _list_times(schedule):
        if (model.compute(name, coordinate=place, **schedule(time)) != first).any():
            raise InvalidValueError(
                "rigid bars keep their lengths during a motion",
                where="schedule",
                given=f"a profile that changes them at t = {time:.6g} s",
                allowed="profiles of members with a stiffness, loads and forces",
                hint="give the bar an axial_stiffness",
            )


def _list_times(schedule: DrivenArguments) -> list[float]:
    """Return times [s] of every piece; a polynomial that is constant at so many points is constant."""
    pieces = schedule.pieces
    start, end = pieces.time[:-1], pieces.time[1:]
    rows = pieces.coefficient.shape[1]
    shares = np.arange(rows) / rows
    return list(np.sort(np.concatenate([start + share * (end - start) for share in shares])).tolist())


def _evaluate(model: CompiledModel, schedule: DrivenArguments, time: float) -> tuple[Any, Any]:
    """Return laws (n_members, ...) and the entries of the mass matrix at a time [s]."""
    given = schedule(time)
    return np.asarray(model.compute("member_law", **given)), model.compute("mass_matrix", **given).data
