"""Rest lengths of linear members for many cases at once, by the formulas with which scenes are assembled.

    prestress t   l - t / k, or EA l / (EA + t)
    strain s      l / (1 + s)
    neither       l, the length at the stated positions

Positions and stiffnesses come from entries that are known already; t and s follow from one key each. The
prestress of a shape is rounded to 13 digits when a scene is assembled, so that a multiple of its key is the
same to a part of 1e-12.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.assemble import list_parts
from tensegrity_codegen.scene.assemble.member_values import Columns, resolve_values
from tensegrity_codegen.scene.schema.part_schema import Member
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.assembler import AssembledCase
from tensegrity_codegen.sweeps.apply.relations import Relations, find_relations
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.laws import LINEAR

SAME = 1e-12  # part by which a rest length may differ from that of the assembled scene
ROUNDED = 3e-12  # part by which prestresses may differ, two of which are rounded to 13 digits
STATED = ("prestress", "strain")


@dataclass(frozen=True, eq=False)
class RestLengths:
    """How rest lengths of some members follow from keys and other entries.

    Attributes
    ----------
    members : ndarray of int, shape (n,)
        The members.
    connectivity : ndarray of int, shape (n, 2)
        Their nodes.
    position : ndarray, shape (n_nodes, 3) [m]
        Positions where they do not vary.
    moved : mapping of str to tuple
        Of the slots that hold positions: indices of node and axis of each entry.
    stated : mapping of str to ndarray, shape (n,)
        Prestress [N] and strain in a case of the group, NaN where a member has none.
    relations : mapping of str to Relations
        How these follow from keys.
    tension_only : ndarray of bool, shape (n,)
        Members without compression.
    """

    members: IntArray
    connectivity: IntArray
    position: FloatArray
    moved: Mapping[str, tuple[IntArray, IntArray]]
    stated: Mapping[str, FloatArray]
    relations: Mapping[str, Relations]
    tension_only: NDArray[np.bool_]

    @property
    def slots(self) -> tuple[str, ...]:
        """Slots that the formulas need."""
        return ("spring_constant", "axial_stiffness", *self.moved)

    def without_moved_nodes(self, case: AssembledCase) -> "RestLengths":
        """Return the same with the positions of the scene, where keys of arrays alone move nodes."""
        if case.scene is None or case.scene.bodies:
            return self
        subject, _ = assemble_scene(case.scene)
        assert isinstance(subject, Structure)
        return replace(self, position=subject.node_position, moved={})

    def compute(self, values: FloatArray, slots: Mapping[str, FloatArray]) -> FloatArray:
        """Return rest lengths [m] of cases, (n_cases, n); NaN where there is none.

        values: (n_cases, n_keys); slots: the values of each of `slots`, (n_cases, ...).
        """
        length = self._lengths(len(values), slots)
        tension, strain = (self._stated(name, values) for name in STATED)
        given = {name: slots[name][:, self.members] for name in ("spring_constant", "axial_stiffness")}
        with np.errstate(all="ignore"):
            by_tension = LINEAR.find_rest_length(length, np.where(np.isnan(tension), 0.0, tension), given)
            rest = np.where(np.isnan(tension), length, by_tension)
            rest = np.where(np.isnan(strain), rest, length / (1 + np.where(np.isnan(strain), 0.0, strain)))
            allowed = (rest > 0) & np.isfinite(rest) & ~(self.tension_only & (tension < 0))
        return np.where(allowed, rest, np.nan)

    def _lengths(self, count: int, slots: Mapping[str, FloatArray]) -> FloatArray:
        if not self.moved:
            position = self.position[None]
        else:
            position = np.repeat(self.position[None], count, axis=0)
            for name, (node, axis) in self.moved.items():
                position[:, node, axis] = slots[name].reshape(count, -1)
        ends = position[:, self.connectivity]
        length: FloatArray = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=-1)
        return np.broadcast_to(length, (count, len(self.members)))

    def _stated(self, name: str, values: FloatArray) -> FloatArray:
        result = np.repeat(self.stated[name][None], len(values), axis=0)
        relations = self.relations[name]
        result[:, relations.entries] = relations.compute(values)
        return result


def read_stated(case: AssembledCase) -> Columns:
    """Return what the scene of a case states of its members, NaN where it does not, (n_members,) each."""
    assert case.scene is not None
    members: Mapping[str, Member]
    if case.scene.bodies:
        members = {
            name: Member.model_construct(
                **{key: getattr(item, key) for key in type(item).model_fields if key != "points"}
                | {"kind": None if item.class_name else "cable", "nodes": ("", "")}
            )
            for name, item in case.scene.tendons.items()
        }
    else:
        members = list_parts(case.scene, "scene").members
    return resolve_values(case.scene.classes, members, "scene")[0]


def find_rest_lengths(
    cases: Sequence[AssembledCase], x: FloatArray, members: IntArray, slots: Mapping[str, FloatArray]
) -> RestLengths | None:
    """Return how rest lengths of these members follow, None where these formulas do not explain them.

    cases: probes of one group, with the values x (n_probes, n_keys); slots: those of the first probe.
    """
    subject = cases[0].subject
    bilinear = [np.asarray(values) != 0 for values in subject.law_parameter.values()]
    if any(mask[members].any() for mask in bilinear):
        return None
    stated = [read_stated(case) for case in cases]
    columns = {name: np.array([item[name][members] for item in stated]) for name in STATED}
    relations = {name: _relate_stated(x, columns[name]) for name in STATED}
    if any(item is None for item in relations.values()):
        return None
    return RestLengths(
        members,
        subject.connectivity[members],
        compute_node_position(subject) if isinstance(subject, BodySystem) else subject.node_position,
        _find_moved(cases, slots),
        {name: column[0] for name, column in columns.items()},
        {name: item for name, item in relations.items() if item is not None},
        subject.tension_only[members],
    )


def _relate_stated(x: FloatArray, column: FloatArray) -> Relations | None:
    """Return the relations of the entries that vary, (n_probes, n); None if there is none for one of them."""
    missing = np.isnan(column)
    if (missing != missing[0]).any():
        return None
    varying = np.flatnonzero((column != column[0]).any(axis=0) & ~missing[0])
    found = find_relations(x, column[:, varying], ROUNDED)
    if len(found.entries) < len(varying):
        return None
    return Relations(varying[found.entries], found.keys, found.factors, found.offsets)


def _find_moved(
    cases: Sequence[AssembledCase], slots: Mapping[str, FloatArray]
) -> dict[str, tuple[IntArray, IntArray]]:
    """Return node and axis of each entry of the slots that hold node positions, where these vary."""
    subject = cases[0].subject
    if not isinstance(subject, Structure) or len(slots["coordinate"]) != subject.n_coordinates:
        return {}
    positions = [item.subject.node_position for item in cases if isinstance(item.subject, Structure)]
    if all(np.array_equal(item, positions[0]) for item in positions):
        return {}
    node, axis = subject.coordinate_node_axis.T
    found = {"coordinate": (node, axis)}
    if "anchor_position" in slots:
        column, row = np.meshgrid(np.array(subject.axes), np.arange(subject.n_nodes))
        found = {"anchor_position": (row.ravel(), column.ravel()), **found}
    return found
