"""Memory of a structure: the kinds of internal states z, and their order in a state.

An internal state has a rate, or it is a number that events set: 0 while a margin is positive, else 1. Those
with rates come first, kind by kind; those that events set are the last ones, in the order of their margins.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tensegrity_codegen.structure.ground import ENERGY_STATES
from tensegrity_codegen.structure.sliding import name_rings
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.laws import LAWS
from tensegrity_codegen.tables.laws.law import Law
from tensegrity_codegen.tables.manifest import SET_STATES, SLID_END, VISCOUS_WORK
from tensegrity_codegen.tables.request import ModelRequest

Names = tuple[str, ...]


@dataclass(frozen=True)
class MemoryKind:
    """One kind of internal states; its expressions are those of a `Memory` in symbolic/memory.py.

    states: structure -> names of the states with rates; set_at: kind of events that set the other ones, ""
    without any; subjects: structure -> what each margin of these events is of.
    """

    states: Callable[[Any], Names]
    set_at: str = ""
    subjects: Callable[[Any], Names] = lambda structure: ()

    def set_states(self, structure: Any) -> Names:
        """Return the names of the states that events set."""
        return tuple(f"{name}_{SET_STATES[self.set_at]}" for name in self.subjects(structure))


def _name_bristles(structure: Any) -> Names:
    """Return a name for each tangent of each contact with friction."""
    ground = structure.ground
    if ground is None or not ground.friction or ground.stick_point is not None:
        return ()
    tangents = range(1, len(structure.axes))
    return tuple(f"{name}_stick{k}" for name in structure.contact_name for k in tangents)


def _find_sliding(structure: Any) -> Names:
    """Return the contacts whose slip jumps: those with a static friction."""
    ground = getattr(structure, "ground", None)
    return structure.contact_name if ground is not None and ground.has_static_friction else ()


def _name_energies(structure: Any) -> Names:
    """Return the names of the energies of a balance, where it is asked for, and of what time takes."""
    of_ground = ENERGY_STATES if structure.ground is not None and structure.ground.balances_energy else ()
    return (*of_ground, *((VISCOUS_WORK,) if structure.relaxes.any() else ()))


def _find_kind(law: Law) -> MemoryKind:
    """Return the internal states of the members of a law."""

    def name_each(structure: Any, words: Names) -> Names:
        selected = next((mask for candidate, mask in structure.members_of_law if candidate is law), ())
        return tuple(f"{structure.member_name[e]}_{end}" for e in np.flatnonzero(selected) for end in words)

    return MemoryKind(partial(name_each, words=law.states), law.set_at, partial(name_each, words=law.flags))


# Those that events set stand in the order of their kinds here, as their margins do in EVENT_KINDS.
MEMORY_KINDS = (
    MemoryKind(_name_bristles, "stick", _find_sliding),
    *(_find_kind(law) for law in LAWS if law.states),
    MemoryKind(lambda structure: tuple(item.state_name for item in structure.lagging_actuators.values())),
    MemoryKind(lambda structure: name_rings(structure.sliding)),
    MemoryKind(_name_energies),
)


# Ends of the names of what members remember that changes in flow alone, between events that set flags.
CONSTANT_ENDS = tuple(
    end
    for law in LAWS
    if law.set_at
    for end in (*(f"_{name}" for name in law.states), f"_{SET_STATES[law.set_at]}")
)


def name_internal_states(structure: Any) -> Names:
    """Return the names of all internal states of a structure, in their order."""
    rated = [name for kind in MEMORY_KINDS for name in kind.states(structure)]
    return (*rated, *(name for kind in MEMORY_KINDS for name in kind.set_states(structure)))


def find_start(structure: Any) -> FloatArray:
    """Return the start of internal states, (n_internal,): zero, of viscous members that of the scene."""
    start = dict.fromkeys(name_internal_states(structure), 0.0)
    x = structure.member_length() - structure.rest_length
    x = np.where(structure.tension_only, np.maximum(x, 0.0), x)
    for law, mask in structure.members_of_law:
        if law.states and not law.set_at:
            values = {p.name: structure.member_value(p.name)[mask] for p in law.parameters}
            names = [f"{structure.member_name[e]}_{law.states[0]}" for e in np.flatnonzero(mask)]
            start |= dict(zip(names, law.settle(x[mask], values, np.where)[0].tolist(), strict=True))
    return np.array(list(start.values()))


def find_setting_events(structure: Any) -> Names:
    """Return the kinds of events that set internal states of a structure: motions need these events."""
    return tuple(kind.set_at for kind in MEMORY_KINDS if kind.set_states(structure))


def is_constant(name: str) -> bool:
    """Return whether linear models do without an internal state: constant, or nothing depends on it."""
    return name in (*ENERGY_STATES, VISCOUS_WORK) or name.endswith((*CONSTANT_ENDS, SLID_END))


def lack_setting_events(subject: Any, request: ModelRequest) -> dict[str, bool]:
    """Return what cannot follow the events that set internal states -> whether a request wants it."""
    needed = find_setting_events(subject)
    return {
        f"emitter {request.emitter!r}": request.emitter not in ("auto", "unrolled"),
        "batch functions": bool(request.batch_width),
        "interfaces": bool(request.interfaces),
        "single precision": request.precision != "double",
        f"model.events without {' and '.join(needed)}": request.lacks_events(*needed),
    }
