"""Checks of how members join nodes, of the freedom that they leave, and of the parameters of member laws."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    StructureError,
    UnknownNameError,
    name_list,
    suggest,
)
from tensegrity_codegen.tables.laws import LAW_PARAMETERS
from tensegrity_codegen.tables.strands import Strands

IndexArray = NDArray[np.int64]

# Nodes closer than this part of the structure's extent count as coincident.
COINCIDENT = 1e-12


def find_fully_anchored(node_anchored: NDArray[np.bool_], axes: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return which nodes (n_nodes,) are held on all modelled axes; node_anchored (n_nodes, 3)."""
    held: NDArray[np.bool_] = np.all(node_anchored[:, axes], axis=1)
    return held


def check_connectivity(
    strands: Strands,
    member_name: tuple[str, ...],
    node_name: tuple[str, ...],
    node_position: FloatArray,
    rest_length: FloatArray,
    where: str,
    is_attached: NDArray[np.bool_] | None = None,
) -> None:
    """Raise unless every strand joins two different nodes, and no two members the same pair.

    Nodes may coincide where a cable joins them that is slack there. rest_length (n_members,) [m]: NaN of
    members that cannot go slack. is_attached (n_nodes,): points of bodies, which several members may join.
    """
    start, end = strands.ends.T
    end_names = _Ends(strands.ends, node_name)
    owner = member_name if strands.is_plain else tuple(member_name[e] for e in strands.member)
    report = partial(refuse, section="members", names=owner, where=where, key="nodes", given=end_names)
    twice = "joins a node to itself" if strands.is_plain else "passes a node twice in a row"
    report(start == end, StructureError, f"the member {twice}", allowed="two different nodes")
    is_alone = np.bincount(strands.member, minlength=strands.n_members)[strands.member] == 1
    if is_attached is not None:
        is_alone &= ~is_attached[strands.ends].any(axis=1)
    straight = strands.ends[is_alone]
    _check_pairs(straight, tuple(np.array(owner, dtype=object)[is_alone]), node_name, where)
    length = strands.strand_lengths(node_position)
    problem = "the member's nodes are too far apart for its length to be a number"
    report(~np.isfinite(length), StructureError, problem, allowed="positions [m] of ordinary size")
    extent = float(np.ptp(node_position, axis=0).max()) if len(node_position) else 0.0
    is_bad = (length <= COINCIDENT * extent) & ~(rest_length > strands.add_up(length))[strands.member]
    allowed = "nodes at different positions, or a cable that is slack there"
    hint = "move one of the nodes, make the two one node, or give a cable a rest_length"
    report(is_bad, StructureError, "the member joins two nodes at one place", allowed=allowed, hint=hint)


def check_freedom(
    connectivity: IndexArray,
    node_anchored: NDArray[np.bool_],
    axes: tuple[int, ...],
    node_name: tuple[str, ...],
    where: str,
) -> None:
    """Raise StructureError without nodes, members, a free coordinate, or a member at every node."""
    problem = ""
    if not node_name:
        problem, allowed, hint = "the scene has no nodes", "two nodes or more", "add [nodes] or a [shape]"
    elif not len(connectivity):
        problem, allowed, hint = (
            "the scene has no members",
            "one member or more",
            "add [members] or a [shape]",
        )
    elif node_anchored[:, axes].all():
        problem = "no node is free to move: all are anchored on all modelled axes"
        allowed, hint = "one free axis or more", "set anchored = false on a node"
    if problem:
        key = "nodes" if node_name and len(connectivity) else ""
        raise StructureError(problem, where=key_path(where, key), allowed=allowed, hint=hint)
    degree = np.bincount(connectivity.ravel(), minlength=len(node_name))
    report = partial(refuse, section="nodes", names=node_name, where=where)
    allowed, hint = "one member or more at every node", "connect it by a member, or remove it"
    report(degree == 0, StructureError, "no member joins this node", allowed=allowed, hint=hint)


def _check_pairs(
    connectivity: IndexArray, member_name: tuple[str, ...], node_name: tuple[str, ...], where: str
) -> None:
    low, high = np.sort(connectivity, axis=1).T
    pair = low * max(len(node_name), 1) + high
    _, first_row, inverse = np.unique(pair, return_index=True, return_inverse=True)
    twin = first_row[inverse.ravel()]
    again = np.flatnonzero(twin != np.arange(len(pair)))
    if again.size:
        repeats = f" (and again {name_list(member_name[row] for row in again[1:])})" if again.size > 1 else ""
        row = int(again[0])
        raise DuplicateNameError(
            f"members {member_name[twin[row]]!r} and {member_name[row]!r} join the same two nodes{repeats}",
            where=key_path(where, "members", member_name[row], "nodes"),
            given=[node_name[node] for node in connectivity[row]],
            allowed="one member for a pair of nodes",
            hint="remove one; or make one member of both, whose stiffness and prestress are the sums of "
            "theirs; or give one of them a node of its own",
        )


class _Ends:
    """The names of a member's two nodes, made on demand."""

    def __init__(self, connectivity: IndexArray, node_name: tuple[str, ...]) -> None:
        self._connectivity, self._node_name = connectivity, node_name

    def __getitem__(self, row: int) -> list[str]:
        return [self._node_name[node] for node in self._connectivity[row]]


def check_laws(subject: Structure | BodySystem, where: str) -> None:
    """Raise for parameters of member laws that are unknown, not finite or out of range."""
    for name, values in subject.law_parameter.items():
        _check_array(subject, name, values, where)
    rigid = (subject.spring_constant == 0) & (subject.axial_stiffness == 0)
    report = partial(refuse, section="members", names=subject.member_name, where=where)
    for law, mask in subject.members_of_law[1:]:
        allowed = "only with spring_constant or axial_stiffness"
        report(mask & rigid, InvalidValueError, f"a rigid bar cannot be {law.name}", allowed=allowed)
        for rule in law.check(subject.member_values(), subject.tension_only):
            is_bad, value = mask & rule.is_broken, subject.member_value(rule.key)
            report(is_bad, InvalidValueError, rule.problem, key=rule.key, given=value, allowed=rule.allowed)


def _check_array(subject: Structure | BodySystem, name: str, values: object, where: str) -> None:
    """Check the name of a parameter, its shape, and that its values are finite."""
    location, array = key_path(where, "law_parameter", name), np.asarray(values)
    if name not in LAW_PARAMETERS:
        problem = "no member law has this parameter"
        raise UnknownNameError(problem, where=location, given=name, hint=suggest(name, LAW_PARAMETERS))
    if array.shape != (subject.n_members,) or array.dtype.kind != "f":
        problem = "an array of the wrong shape or kind of number"
        allowed = f"float64 array of shape ({subject.n_members},)"
        value = f"{array.dtype} {array.shape}"
        raise InvalidValueError(problem, where=location, given=value, allowed=allowed)
    refuse(
        ~np.isfinite(array),
        NonFiniteError,
        "not a finite number",
        section="members",
        names=subject.member_name,
        where=where,
        key=name,
        given=array,
        allowed="finite numbers",
    )
