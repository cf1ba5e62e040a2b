"""Members whose laws a profile changes: radau holds those of the tensions that it solves for."""

from __future__ import annotations

from typing import Any

import numpy as np

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments

__all__ = ["check_laws", "find_changing"]


def find_changing(model: CompiledModel, schedule: DrivenArguments) -> tuple[str, ...]:
    """Return the members whose laws radau holds constant and this profile changes.

    "masses" where these change; () for a library without radau.
    """
    tensions = next((spec.tensions for spec in model.manifest.integrators if spec.name == "radau"), ())
    if not model.has("member_law") or not model.has("mass_matrix"):
        return ()
    chosen, pieces = list(tensions), schedule.pieces
    start, end = pieces.time[:-1], pieces.time[1:]
    rows = pieces.coefficient.shape[1]
    # A polynomial that is constant at so many points is constant.
    times = np.concatenate([start + share * (end - start) for share in np.arange(rows) / rows])
    law, mass = _evaluate(model, schedule, 0.0)
    changed, masses = np.zeros(len(chosen), dtype=bool), False
    for time in times.tolist():
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


def _evaluate(model: CompiledModel, schedule: DrivenArguments, time: float) -> tuple[Any, Any]:
    """Return laws (n_members, ...) and the entries of the mass matrix at a time [s]."""
    given = schedule(time)
    return np.asarray(model.compute("member_law", **given)), model.compute("mass_matrix", **given).data
