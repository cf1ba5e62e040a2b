"""In which order the members of a structure are worked through, and in which order they add up on nodes.

Sums of floating-point numbers depend on their order. It is decided here once, from the structure: who adds
forces, energies or matrix blocks of members, as unrolled expressions or in loops over tables, follows this
plan, so that all of them return the same bits.

Members of one class obey the same law with the same of its values changeable at run time: one loop, one
kernel. Within a class, members whose nodes are all free come apart from those that an anchor holds, and those
of repeated modules come first: they are added up node by node, the others member by member.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.repeated_modules import Module, find_modules
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.laws import LAW_PARAMETERS, MEMBER_VALUES

# An order of the nodes that follows the structure, whatever order they were listed in.
#
# From an end of the structure outwards, as Cuthill and McKee (1969) number the nodes of a sparse matrix; the
# neighbours of a node come in an order that depends on what is around them and not on their names. A
# structure that repeats itself along its length is then numbered alike in every repetition.


ROUNDS = 3  # how far around a node its surroundings are looked at, in members


def spread(ends: IntArray, order: IntArray) -> float:
    """Return the mean distance of the two nodes (n, 2) of members in an order of the nodes."""
    rank = np.argsort(order)
    return float(np.abs(np.diff(rank[ends], axis=1)).mean()) if len(ends) else 0.0


def order_nodes(ends: IntArray, kind: IntArray, n_nodes: int) -> IntArray:
    """Return all nodes; ends: (n, 2) nodes of members, kind: (n,) members of other kinds look different."""
    own, other = np.concatenate([ends[:, 0], ends[:, 1]]), np.concatenate([ends[:, 1], ends[:, 0]])
    label = np.concatenate([kind, kind])
    look = _surroundings(own, other, label, n_nodes)
    sort = np.lexsort((look[other], label, own))
    start = np.searchsorted(own[sort], np.arange(n_nodes + 1)).tolist()
    number = np.unique(look, return_inverse=True)[1].reshape(-1)  # of the different surroundings, from 0 on
    neighbour, names = other[sort].tolist(), np.stack([label[sort], number[other[sort]]], 1).tolist()
    found: list[int] = []
    seen = np.zeros(n_nodes, dtype=bool)
    for node in range(n_nodes):
        if not seen[node]:
            first = _walk(_walk(node, start, neighbour, names)[-1], start, neighbour, names)[-1]
            found += _walk(first, start, neighbour, names)
            seen[found] = True
    return np.array(found, dtype=np.int64)


def _walk(first: int, start: list[int], neighbour: list[int], names: list[list[int]]) -> list[int]:
    """Return all nodes that can be reached from the first one, nearer ones first."""
    found, number = [first], {first: 0}
    for node in found:
        new: dict[int, tuple[object, ...]] = {}
        for place in range(start[node], start[node + 1]):
            other = neighbour[place]
            if other not in number and other not in new:
                known = [number.get(k, -1) for k in neighbour[start[other] : start[other + 1]]]
                new[other] = (*names[place], sorted(k for k in known if k >= 0))
        for other in sorted(new, key=lambda k: new[k]):
            number[other] = len(found)
            found.append(other)
    return found


def _surroundings(own: IntArray, other: IntArray, label: IntArray, n_nodes: int) -> NDArray[np.uint64]:
    """Return a number for each node, equal for nodes with equal surroundings."""
    look = np.ones(n_nodes, dtype=np.uint64)
    for _ in range(ROUNDS):
        seen = _mix(look[other] + _mix(label.astype(np.uint64) + np.uint64(1)))
        total = np.zeros(n_nodes, dtype=np.uint64)
        np.add.at(total, own, seen)
        look = _mix(look + total)
    return look


def _mix(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return scattered bits (the finalizer of splitmix64)."""
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        value = (value ^ (value >> np.uint64(shift))) * np.uint64(factor)
    return value ^ (value >> np.uint64(31))


# How a value of a member class comes about: it is zero for all, it is baked in, it is a run-time argument.
ABSENT, CONSTANT, ARGUMENT = 0, 1, 2

MIN_MODULE_SHARE = 0.8  # of the members in modules: no other order of the nodes is tried
LEAST_TO_ORDER = 48  # members for which another order of the nodes is tried
LEAST_TO_SORT = 400  # members whose coordinates may leave the fastest memory


@dataclass(frozen=True)
class MemberClass:
    """The law of some members, and where its values come from: ABSENT, CONSTANT or ARGUMENT.

    n_inputs: number of inputs that change the rest length of each of them.
    """

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
    def is_rest_length_constant(self) -> bool:
        """Whether rest lengths are baked in and no input changes them."""
        return self.rest_length == CONSTANT and self.n_inputs == 0

    @property
    def is_stiffness_constant(self) -> bool:
        """Whether mu = k + EA / rho is known when the code is made."""
        if ARGUMENT in (self.spring_constant, self.axial_stiffness):
            return False
        return self.axial_stiffness == ABSENT or self.is_rest_length_constant


@dataclass(frozen=True)
class MemberGroup:
    """Members that one loop works through, in its order.

    is_interior: whether all their nodes are free on all modelled axes; in_module: whether modules hold them.
    """

    member_class: MemberClass
    member: IntArray
    is_interior: bool
    in_module: bool = False

    @property
    def ends(self) -> IntArray:
        """(2 n, 2): (member, end) in the order in which a loop adds; end 0 is node i, 1 is node j."""
        member = np.repeat(self.member, 2)
        return np.stack([member, np.tile([0, 1], len(self.member))], axis=1)


@dataclass(frozen=True)
class AssemblyPlan:
    """All members of a structure in groups, one loop each; some of them in modules.

    modules: their kinds are places in `classes`; connectivity: (n_members, 2) nodes (i, j).
    """

    groups: tuple[MemberGroup, ...]
    modules: tuple[Module, ...]
    classes: tuple[MemberClass, ...]
    connectivity: IntArray

    @cached_property
    def member(self) -> IntArray:
        """(n_members,): members in the order in which energies are summed."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *[group.member for group in self.groups]])

    @cached_property
    def ends(self) -> IntArray:
        """(2 n_members, 2): (member, end) in the order in which forces and blocks add to their nodes."""
        modules = [self._ends_of_module(module) for module in self.modules]
        others = [group.ends for group in self.groups if not group.in_module]
        return np.concatenate([np.zeros((0, 2), dtype=np.int64), *modules, *others])

    def _ends_of_module(self, module: Module) -> IntArray:
        """Return the ends of a module's members column by column: each node adds up strand by strand."""
        found = []
        for column, nodes in enumerate(module.column):
            for strand, _, offset in module.entries(column):
                member = module.member[strand]
                here = nodes[offset : offset + len(member)]
                found.append(np.stack([member, self.connectivity[member, 1] == here], axis=1))
        return np.concatenate(found)


def plan_assembly(structure: Structure, parameters: Mapping[str, tuple[int, ...]]) -> AssemblyPlan:
    """Return the plan of a structure that keeps `parameters` (argument name -> indices) changeable.

    Groups of members in modules come first, repetition by repetition; then the others, in the order of the
    scene, or along the structure where that brings members that share nodes much nearer to each other.
    Groups of either sort come in the order of their first members.
    """
    features = _features(structure, parameters)
    _, first, class_of = np.unique(_number(features), return_index=True, return_inverse=True)
    classes = [(_class_of_row(row), bool(row[-1])) for row in features[first].tolist()]
    ends = structure.connectivity.reshape(-1, 2)
    kind = np.where((features[:, -1] == 1) & ~structure.passes_rings, class_of, -1)
    keys = (ends.tobytes(), class_of.tobytes(), kind.tobytes())
    modules, order = _search_modules(*keys, structure.n_nodes)
    held = np.concatenate([np.zeros(0, dtype=np.int64), *[module.member.T.ravel() for module in modules]])
    left = np.setdiff1d(np.arange(structure.n_members), held, assume_unique=True)
    if order is not None:
        left = left[np.argsort(np.argsort(order)[ends[left]].min(axis=1, initial=len(order)), kind="stable")]
    groups = [
        MemberGroup(classes[number][0], member[class_of[member] == number], classes[number][1], in_module)
        for member, in_module in ((held, True), (left, False))
        for number in dict.fromkeys(class_of[member].tolist())
    ]
    return AssemblyPlan(tuple(groups), modules, tuple(item for item, _ in classes), ends)


@lru_cache(maxsize=4)  # one structure is planned many times: with what it leaves out, too
def _search_modules(
    ends_bytes: bytes, class_bytes: bytes, kind_bytes: bytes, n_nodes: int
) -> tuple[tuple[Module, ...], IntArray | None]:
    """Return the modules, and the order of nodes for the other members, None for the scene's."""
    class_of, kind = np.frombuffer(class_bytes, dtype=np.int64), np.frombuffer(kind_bytes, dtype=np.int64)
    ends = np.frombuffer(ends_bytes, dtype=np.int64).reshape(-1, 2)
    natural = np.arange(n_nodes)
    modules = find_modules(ends, kind, natural)
    n_held = _count(modules)
    if n_held >= MIN_MODULE_SHARE * len(ends) or len(ends) < LEAST_TO_ORDER:
        return tuple(modules), None
    order = order_nodes(ends, class_of, n_nodes)
    others = find_modules(ends, kind, order)
    is_nearer = 2 * spread(ends, order) < spread(ends, natural) and len(ends) >= LEAST_TO_SORT
    return tuple(others if _count(others) > n_held else modules), (order if is_nearer else None)


def _count(modules: list[Module]) -> int:
    return sum(module.member.size for module in modules)


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
    for item in structure.inputs:
        n_inputs[list(item.rest_length_gain)] += 1
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
