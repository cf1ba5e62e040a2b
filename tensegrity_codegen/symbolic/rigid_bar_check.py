"""Bars that may be rigid: none if every member is a spring, elsewhere those that do not contradict."""

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.structure.rigid_bars import find_rigid_bars
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, name_list
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.request import ModelRequest, complete_options

DEPENDENT = 1e-9  # part of a bar's unit vector that others leave free


def check_formulation(structure: Structure, request: ModelRequest) -> None:
    """Raise FormulationError if the requested formulation cannot have the structure's rigid bars."""
    if find_formulation(request.formulation).has_rigid_bars:
        check_rigid_bars(structure, find_rigid_bars(structure, request), request)
    else:
        check_no_rigid_bar(structure, request.formulation)


def check_no_rigid_bar(structure: Structure, formulation: str) -> None:
    """Raise FormulationError if a member has neither spring constant nor axial stiffness."""
    rigid = np.flatnonzero(structure.is_rigid)
    if rigid.size:
        names = [structure.member_name[e] for e in rigid]
        raise FormulationError(
            f"formulation {formulation!r} has no rigid bars",
            where=f"{structure.name}: members.{names[0]}",
            given=f"bar {name_list(names)} without axial_stiffness and spring_constant",
            allowed="axial_stiffness > 0 [N] or spring_constant > 0 [N/m] on every bar",
            hint='formulation = "rigid_bar", or give the bar a stiffness, 1,000 times that of the cables is '
            "nearly rigid",
        ).unless_chosen_otherwise()


def keeps_scene_lengths(options: Mapping[str, str]) -> bool:
    """Return whether rigid bars keep the lengths that they have in the scene, whatever their rest lengths."""
    return options["bars"] == "all" and options["correction"] == "none"


def check_rigid_bars(structure: Structure, rigid: NDArray[np.bool_], request: ModelRequest) -> None:
    """Raise FormulationError for rigid bars that are undetermined, or whose stiffness or length may change.

    rigid: (n_members,), the members that keep their length.
    """
    if not rigid.any():
        raise FormulationError(
            "formulation 'rigid_bar' needs a rigid bar",
            where=f"{structure.name}: model.formulation",
            given="no bar without stiffness",
            allowed='bars without axial_stiffness and spring_constant, or options.bars = "all"',
            hint='formulation = "node_position", or options = { bars = "all" }',
        ).unless_chosen_otherwise()
    _check_no_moved_bar(structure, rigid, request)
    for name in ("spring_constant", "axial_stiffness", "damping"):
        changed = [e for e in request.parameters.get(name, ()) if rigid[e]]
        if changed:
            raise FormulationError(
                f"a rigid bar has no {name} that can change at run time",
                where=f"{structure.name}: parameters.{name}",
                given=structure.member_name[changed[0]],
                allowed="members that are no rigid bars",
                hint="name the cables, or a class of them, instead of all members",
            )
    # Bars whose constraints follow from the others
    members = np.flatnonzero(rigid)
    redundant = find_redundant(structure, members)
    if redundant.size:
        names = [structure.member_name[e] for e in redundant]
        raise FormulationError(
            "rigid bars that repeat what the others hold already: their forces are not determined",
            where=f"{structure.name}: members.{names[0]}",
            given=name_list(names),
            allowed="bars of which none follows from the others and the anchors",
            hint="give these bars a stiffness, or leave out those that hold nothing",
        )


def _check_no_moved_bar(structure: Structure, rigid: NDArray[np.bool_], request: ModelRequest) -> None:
    """Raise FormulationError for an input that heats a bar that keeps its length, or changes that length."""
    problems = {"temperature": "a rigid bar keeps its length at every temperature"}
    if keeps_scene_lengths(complete_options(request.formulation, request.options)):
        problems["rest_length"] = 'bars that options.bars = "all" keeps rigid have no rest length to change'
    for source in structure.inputs:
        moved = [e for e in source.targets if rigid[e]] if source.kind in problems else []
        if moved:
            raise FormulationError(
                problems[source.kind],
                where=f"{structure.name}: inputs.{source.name}",
                given=structure.member_name[moved[0]],
                allowed="members that are no rigid bars",
                hint='formulation = "node_position", in which bars with a stiffness change their lengths',
            )


def find_redundant(structure: Structure, members: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the bars whose constraints follow from those before them, at the stated node positions.

    From the rank of the unit vectors along the bars, (n_coordinates, n_bars), by a pivoted QR factorisation.
    """
    dependent = [_find_dependent(structure, members[group]) for group in _join_bars(structure, members)]
    return np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *dependent]))


def _join_bars(structure: Structure, members: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return sets of places in `members` of bars that free nodes join, directly or through others."""
    free = np.asarray(~structure.node_anchored[:, list(structure.axes)].all(axis=1))
    ends = structure.connectivity[members]
    bar, side = np.nonzero(free[ends])
    count = len(members)
    size = count + structure.n_nodes
    graph = scipy.sparse.csr_array((np.ones(len(bar)), (bar, count + ends[bar, side])), shape=(size, size))
    number, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    label = label[:count]
    order = np.argsort(label, kind="stable")
    groups = np.split(order, np.searchsorted(label[order], np.arange(1, number)))
    return [group for group in groups if group.size]


def _find_dependent(structure: Structure, members: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the bars of one joined set that repeat others."""
    ends, axes = structure.connectivity[members], list(structure.axes)
    d = structure.node_position[ends[:, 0]] - structure.node_position[ends[:, 1]]
    unit = (d / np.linalg.norm(d, axis=1)[:, None])[:, axes]
    nodes = np.unique(ends)
    matrix = np.zeros((len(nodes), len(axes), len(members)))
    for side, sign in ((0, 1.0), (1, -1.0)):
        at = np.searchsorted(nodes, ends[:, side])
        free = ~structure.node_anchored[ends[:, side]][:, axes]
        matrix[at, :, np.arange(len(members))] += sign * unit * free
    factor, order = scipy.linalg.qr(matrix.reshape(-1, len(members)), mode="r", pivoting=True)
    size = np.abs(np.diag(factor))
    rank = int(np.sum(size > DEPENDENT * max(1.0, size.max(initial=0.0))))
    return members[order[rank:]]
