"""The actuators of a plan: which inputs they are, how far and how fast they move, ranges of their members."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.interface import Described
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, check_choice


@dataclass(frozen=True)
class Actuation:
    """The actuators that a plan moves.

    actuators: with names, members, rates and ranges.
    place (n_actuators,): indices of their inputs.
    rest_length (n_actuators,) [m]: rest length of the first member of each in the scene.
    least_change, most_change (n_actuators,) [m]: bounds of their inputs, from the ranges of rest lengths.
    rate (n_actuators,) [m/s]: largest rates.
    """

    actuators: tuple[Actuator, ...]
    place: NDArray[np.int64]
    rest_length: FloatArray
    least_change: FloatArray
    most_change: FloatArray
    rate: FloatArray

    @property
    def members(self) -> dict[str, tuple[int, ...]]:
        """Indices of the members of each actuator."""
        return {actuator.name: actuator.members for actuator in self.actuators}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the actuators."""
        return tuple(actuator.name for actuator in self.actuators)


def find_actuation(model: Described, names: Sequence[str] | None = None) -> Actuation:
    """Return the actuators of a model that a plan moves.

    model: with its structure.
    names: names of some of its actuators; by default all.
    Returns: their inputs, ranges and rates.
    Raises StructureError: the structure has no actuators.
    Raises UnknownNameError, InvalidValueError: an unknown actuator, or one named twice.
    """
    structure, scene = model.structure, model.manifest.name
    known = () if structure is None else structure.actuators
    if structure is None or not known:
        raise StructureError(
            "no actuators",
            where=f"{scene}: actuators",
            given="none",
            allowed="at least one table [[actuators]] with a name and members",
            hint="add [[actuators]] to the scene, or let each cable have one: `actuate=cables`",
        )
    by_name = {actuator.name: actuator for actuator in known}
    check_instance([] if names is None else names, (list, tuple), "actuators", "a list of names")
    wanted = list(by_name) if names is None else list(names)
    for name in wanted:
        check_choice(name, by_name, "actuator", "actuators")
        if wanted.count(name) > 1:
            raise InvalidValueError(
                "an actuator is named twice", where="actuators", given=name, allowed="each actuator once"
            )
    chosen = tuple(by_name[name] for name in wanted)
    rest = [np.array([structure.rest_length[e] for e in item.members]) for item in chosen]
    return Actuation(
        chosen,
        np.array([model.manifest.input_name.index(item.name) for item in chosen], dtype=np.int64),
        np.array([lengths[0] for lengths in rest]),
        np.array([item.range[0] - lengths.min() for item, lengths in zip(chosen, rest, strict=True)]),
        np.array([item.range[1] - lengths.max() for item, lengths in zip(chosen, rest, strict=True)]),
        np.array([item.rate for item in chosen]),
    )


@dataclass(frozen=True)
class MemberRanges:
    """A row for each actuator with a range and each of its members that the plan moves.

    name: names of the actuators.
    member (n,): members.
    rest_length (n,) [m]: rest lengths of the members where the actuators of the plan are at 0.
    least, most (n,) [m]: bounds of the rest lengths.
    pull (n, n_actuators): 1 where an actuator of the plan moves the member.
    """

    name: tuple[str, ...]
    member: NDArray[np.int64]
    rest_length: FloatArray
    least: FloatArray
    most: FloatArray
    pull: FloatArray

    def of_member(self, index: int) -> tuple[float, float]:
        """Return the least and the largest rest length that the ranges permit a member [m]."""
        rows = self.member == index
        return float(self.least[rows].max(initial=-np.inf)), float(self.most[rows].min(initial=np.inf))

    def of_actuators(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the inputs (n_actuators,) by members that one actuator alone moves [m]."""
        alone = self.pull[self.pull.sum(axis=1) == 1] > 0
        kept = self.pull.sum(axis=1) == 1
        low, high = ((bound - self.rest_length)[kept, None] for bound in (self.least, self.most))
        return (
            np.where(alone, low, -np.inf).max(axis=0, initial=-np.inf),
            np.where(alone, high, np.inf).min(axis=0, initial=np.inf),
        )


def find_member_ranges(
    structure: Structure | BodySystem, incidence: FloatArray, held: Mapping[str, float]
) -> MemberRanges:
    """Return the ranges of the members that the actuators of a plan move.

    structure: with its actuators, also those that the plan does not move.
    incidence (n_members, n_actuators): 1 where an actuator of the plan moves a member.
    held: values of the inputs that the plan does not move [m].
    Returns: a row for each actuator with a range and each of its members that moves.
    """
    rest = add_inputs_to_rest_length(structure, held)
    rows = [
        (item, e)
        for item in structure.actuators
        for e in item.members
        if incidence[e].any() and (np.isfinite(item.range[0]) or np.isfinite(item.range[1]))
    ]
    member = np.array([e for _, e in rows], dtype=np.int64)
    return MemberRanges(
        tuple(item.name for item, _ in rows),
        member,
        rest[member],
        np.array([item.range[0] for item, _ in rows], dtype=float),
        np.array([item.range[1] for item, _ in rows], dtype=float),
        incidence[member],
    )
