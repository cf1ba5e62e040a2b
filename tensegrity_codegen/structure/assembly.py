"""In which order the members of a structure are worked through, and in which order they add up on nodes.

Sums of floating-point numbers depend on their order. It is decided here once, from the structure: who adds
forces, energies or matrix blocks of members, as unrolled expressions or in loops over tables, follows this
plan, so that all of them return the same bits.

Members of one class obey the same law with the same of its values changeable at run time: one loop, one
kernel. Within a class, members whose nodes are all free come apart from those that an anchor holds.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.laws import LAW_PARAMETERS, MEMBER_VALUES

# How a value of a member class comes about: it is zero for all, it is baked in, it is a run-time argument.
ABSENT, CONSTANT, ARGUMENT = 0, 1, 2


@dataclass(frozen=True)
class MemberClass:
    """The law of some members, the sources of its values (ABSENT, ...), and their number of inputs."""

    tension_only: bool
    spring_constant: int
    axial_stiffness: int
    rest_length: int
    damping: int
    n_inputs: int
    law_parameters: tuple[int, ...] = ()

    def source(self, name: str) -> int:
        """Return where a value of MEMBER_VALUES comes from; what no class knows is a constant."""
        if name in LAW_PARAMETERS:
            return self.law_parameters[LAW_PARAMETERS.index(name)]
        source: int = getattr(self, name, CONSTANT)
        return source

    @property
    def is_elastic(self) -> bool:
        """Whether the members have a stiffness; rigid bars have none."""
        return self.spring_constant != ABSENT or self.axial_stiffness != ABSENT

    @property
    def is_stiffness_constant(self) -> bool:
        """Whether mu = k + EA / rho is known when the code is made."""
        if ARGUMENT in (self.spring_constant, self.axial_stiffness):
            return False
        return self.axial_stiffness == ABSENT or (self.rest_length == CONSTANT and self.n_inputs == 0)


@dataclass(frozen=True)
class MemberGroup:
    """Members of one loop, in its order; is_interior: whether all their nodes are free on all axes."""

    member_class: MemberClass
    member: IntArray
    is_interior: bool

    @property
    def ends(self) -> IntArray:
        """(2 n, 2): (member, end) in the order in which a loop adds; end 0 is node i, 1 is node j."""
        member = np.repeat(self.member, 2)
        return np.stack([member, np.tile([0, 1], len(self.member))], axis=1)


@dataclass(frozen=True)
class AssemblyPlan:
    """All members of a structure in groups, one loop each."""

    groups: tuple[MemberGroup, ...]

    @cached_property
    def member(self) -> IntArray:
        """(n_members,): members in the order in which energies are summed."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *[group.member for group in self.groups]])

    @cached_property
    def ends(self) -> IntArray:
        """(2 n_members, 2): (member, end) in the order in which forces and blocks add to their nodes."""
        ends = [group.ends for group in self.groups]
        return np.concatenate([np.zeros((0, 2), dtype=np.int64), *ends])


def plan_assembly(structure: Structure, parameters: Mapping[str, tuple[int, ...]]) -> AssemblyPlan:
    """Return the plan of a structure with changeable `parameters` (argument -> indices), in its order."""
    features = _features(structure, parameters)
    _, first_row, class_of = np.unique(_number(features), return_index=True, return_inverse=True)
    groups = []
    for number in dict.fromkeys(class_of.tolist()):
        row = features[first_row[number]].tolist()
        groups.append(MemberGroup(_class_of_row(row), np.flatnonzero(class_of == number), bool(row[-1])))
    return AssemblyPlan(tuple(groups))


def _number(features: IntArray) -> IntArray:
    """Return one number for each row of small ones, equal for equal rows."""
    number = np.zeros(len(features), dtype=np.int64)
    for column in features.T:
        number = number * (int(column.max(initial=0)) + 1) + column
    return number


def _features(structure: Structure, parameters: Mapping[str, tuple[int, ...]]) -> IntArray:
    """Return (n_members, 7 or more): the values of MemberClass, and whether a member is interior."""
    anchored = np.any(structure.node_anchored[:, list(structure.axes)], axis=1)
    n_inputs = np.zeros(structure.n_members, dtype=np.int64)
    for entry in structure.inputs:
        n_inputs[list(entry.rest_length_gain)] += 1
    sources = [_source(structure.member_value(name), parameters.get(name, ())) for name in MEMBER_VALUES]
    interior = ~np.any(anchored[structure.connectivity.reshape(-1, 2)], axis=1)
    columns = [structure.tension_only, *sources, n_inputs, interior]
    return np.stack([np.asarray(column, dtype=np.int64) for column in columns], axis=1)


def _class_of_row(row: list[int]) -> MemberClass:
    tension_only, spring, axial, rest_length, damping, *law, n_inputs, _ = row
    return MemberClass(bool(tension_only), spring, axial, rest_length, damping, n_inputs, tuple(law))


def _source(values: NDArray[np.float64], changeable: tuple[int, ...]) -> IntArray:
    source = np.where(values == 0, ABSENT, CONSTANT)
    source[list(changeable)] = ARGUMENT
    return source
