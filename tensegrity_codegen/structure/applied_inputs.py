"""Inputs of a structure: effects of their values, and actuators for structures that have none."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.bodies import BodyInput, BodySystem
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, UnknownNameError, suggest


def add_inputs_to_rest_length(
    subject: Structure | BodySystem, values: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return the rest lengths [m] with these values [m, K] of inputs, by name, (n_members,)."""
    rest_length = np.array(subject.rest_length)
    for entry in subject.inputs:
        for e, gain in entry.rest_length_gain.items() if entry.name in values else ():
            rest_length[e] += gain * values[entry.name]
    return rest_length


def find_input_force(structure: Structure, values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the forces of these values [N] of force inputs, by name, on all nodes, (n_nodes, 3) [N]."""
    force = np.zeros((structure.n_nodes, 3))
    for entry in structure.inputs:
        if entry.kind == "force" and entry.name in values:
            force[list(entry.targets)] += values[entry.name] * np.array(entry.direction)
    return force


ALL, CABLES = "all", "cables"

Subject = Structure | BodySystem


def actuate_members(structure: Subject, names: Sequence[str]) -> tuple[Subject, tuple[str, ...]]:
    """Return a structure with an actuator for each of some members, and the names of these actuators.

    names: names of actuators, members, groups or classes; ``"cables"`` stands for all cables, ``"all"`` for
    all members that are not rigid.
    Returns structure: the structure with an actuator of the name of the member for each member that is named,
    without limits of rate and range. Members that have an actuator of their own keep it; chosen: names of the
    actuators that were named.
    """
    chosen: list[str] = []
    members: list[int] = []
    for name in names:
        if any(name == actuator.name for actuator in structure.actuators):
            chosen.append(name)
        else:
            members += _find_members(structure, name)
    own_name = {
        actuator.members[0]: actuator.name for actuator in structure.actuators if len(actuator.members) == 1
    }
    fresh = [e for e in members if e not in own_name]
    chosen += [own_name.get(e, structure.member_name[e]) for e in members]
    for name in chosen:
        if chosen.count(name) > 1:
            problem = "a member or actuator is named twice"
            raise InvalidValueError(problem, where="actuate", given=name, allowed="each once")
    _check_names(structure, fresh)
    added = tuple(Actuator(structure.member_name[e], (e,)) for e in fresh)
    actuators = (*structure.actuators, *added)
    if isinstance(structure, BodySystem):
        moved = (BodyInput(actuator.name, "rest_length", actuator.members) for actuator in added)
        return structure.with_changes(actuators=actuators, inputs=(*structure.inputs, *moved)), tuple(chosen)
    pulled = (ActuatedInput(actuator.name, "rest_length", actuator.members) for actuator in added)
    return structure.with_changes(actuators=actuators, inputs=(*structure.inputs, *pulled)), tuple(chosen)


def _find_members(structure: Subject, name: str) -> list[int]:
    """Return the members that a name stands for, without rigid ones where it stands for many."""
    rigid = np.asarray(structure.mu) == 0
    if name in structure.member_name:
        e = structure.member_name.index(name)
        if rigid[e]:
            problem = "a rigid bar has no rest length to change"
            raise InvalidValueError(problem, where="actuate", given=name, allowed="members with stiffness")
        return [e]
    sets = {ALL: np.ones(len(rigid), dtype=bool), CABLES: ~np.asarray(structure.is_bar)}
    for class_name in (*structure.groups, *structure.member_class):
        rows = list(structure.groups.get(class_name, ()))
        rows += [e for e, owner in enumerate(structure.member_class) if owner == class_name and e not in rows]
        sets.setdefault(class_name, np.isin(np.arange(len(rigid)), rows))
    if name not in sets:
        valid = [*(actuator.name for actuator in structure.actuators), *structure.member_name, *sets]
        problem = "unknown member or actuator"
        allowed, hint = ("names of actuators, members, groups and classes; cables; all", suggest(name, valid))
        raise UnknownNameError(problem, where="actuate", given=name, allowed=allowed, hint=hint)
    return [int(e) for e in np.flatnonzero(sets[name] & ~rigid)]


def _check_names(structure: Subject, members: list[int]) -> None:
    input_names = {entry.name for entry in structure.inputs}
    for e in members:
        if structure.member_name[e] in input_names:
            problem = "an input has the name of the member already"
            allowed, hint = "a member without an input of its name", "add it to [[actuators]] in the scene"
            value = structure.member_name[e]
            raise StructureError(problem, where="actuate", given=value, allowed=allowed, hint=hint)
