"""Keys that name entries of the arrays of a library, which take their values as they are.

By the schema of scenes these are loads, gravity, masses, velocities, damping, stiffnesses and rest lengths,
and all keys of arrays. Rest lengths of linear members follow by the formulas with which scenes are assembled:

    prestress t   l - t / k, or EA l / (EA + t)
    strain s      l / (1 + s)

The prestress of a shape gives each of its members a fixed part of itself, rounded to 13 digits when a scene
is assembled, so that these rest lengths are the same to a part of 1e-12; all other entries are the same to
the last bit. Every other key needs the scene assembled again.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.assemble import list_parts
from tensegrity_codegen.scene.assemble.member_values import ALTERNATIVES, STIFFNESS
from tensegrity_codegen.scene.schema.body_schema import Tendon
from tensegrity_codegen.scene.schema.part_schema import Load, Member, TemperatureInput
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.rigid_bars import find_rigid_bars
from tensegrity_codegen.sweeps.apply.array_keys import ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import OF_MEMBERS, AssembledCase, FileKey, list_slots
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.laws import LINEAR

STATED = ("prestress", "strain", *STIFFNESS)  # sources of rest lengths, besides lengths
Entry = tuple[str, int]  # slot, and place in it as one row


@dataclass(frozen=True, eq=False)
class StatedValues:
    """One number of each of some members, NaN without one: factor * key, or a constant."""

    keys: IntArray  # (n,) of int, -1 for a constant
    factors: FloatArray  # (n,), the constant there

    def compute(self, values: FloatArray) -> FloatArray:
        """Return the numbers in cases with these values (n_cases, n_keys), (n_cases, n)."""
        return np.where(self.keys < 0, 1.0, values[:, self.keys]) * self.factors


@dataclass(frozen=True, eq=False)
class RestLengths:
    """Rest lengths that follow from prestress, strain and stiffness of members that keep their lengths."""

    members: IntArray  # (n,) of int
    length: FloatArray  # (n,) [m]
    stated: Mapping[str, StatedValues]  # numbers of STATED, (n,) each
    tension_only: NDArray[np.bool_]  # (n,) of bool

    def compute(self, values: FloatArray) -> FloatArray:
        """Return rest lengths [m] of cases, (n_cases, n); NaN where there is none."""
        numbers = {name: stated.compute(values) for name, stated in self.stated.items()}
        tension, strain = numbers["prestress"], numbers["strain"]
        length = np.broadcast_to(self.length, tension.shape)
        with np.errstate(all="ignore"):
            rest_length = LINEAR.find_rest_length(length, np.nan_to_num(tension), numbers)
            rest_length = np.where(np.isnan(strain), rest_length, length / (1 + strain))
            allowed = (rest_length > 0) & np.isfinite(rest_length) & ~(self.tension_only & (tension < 0))
        return np.where(allowed, rest_length, np.nan)


@dataclass(frozen=True, eq=False)
class DirectKeys:
    """Values that follow from keys without the scene being assembled."""

    entries: Mapping[Entry, int]  # the key of each entry that takes the value of one
    rest_lengths: RestLengths | None  # those by formulas, None without
    keys: frozenset[int]  # all that are served

    def find_used_keys(self, slots: Collection[str]) -> set[int]:
        """Return the keys that some of these slots follow from."""
        used = {key for (slot, _), key in self.entries.items() if slot in slots}
        if self.rest_lengths is not None and "rest_length" in slots:
            for stated in self.rest_lengths.stated.values():
                used |= set(stated.keys.tolist()) - {-1}
        return used


NO_DIRECT_KEYS = DirectKeys({}, None, frozenset())


def find_direct_keys(
    case: AssembledCase, keys: Sequence[FileKey | ArrayKey], values: FloatArray, chosen: Sequence[int]
) -> DirectKeys:
    """Return those of the chosen keys that name entries.

    Keys that rest lengths follow from count only if all chosen keys are direct, since others change lengths.

    case: a case of the group; keys: all keys; values (n_keys,): their values in the case; chosen: the keys
    that vary.
    """
    reader = _KeyReader(case)
    of_file = {k: key for k in chosen if isinstance(key := keys[k], FileKey)}
    of_array = {k: key for k in chosen if isinstance(key := keys[k], ArrayKey)}
    direct: dict[int, list[Entry]] = {k: reader.find_array_entries(key) for k, key in of_array.items()}
    direct |= {k: reader.find_entries(key.path.steps) for k, key in of_file.items()}
    stated = {k: reader.find_stated(key.path.steps, values[k]) for k, key in of_file.items()}
    stated = {k: multiples for k, multiples in stated.items() if multiples}
    served = {k for k in chosen if direct[k] or k in stated}
    rest_lengths = None
    if len(served) < len(chosen):
        served -= stated.keys()
    elif stated:
        rest_lengths = reader.build_rest_lengths(stated)
    # Keys of arrays come last: they replace values of the scene.
    entries = {entry: k for k in (*of_file, *of_array) if k in served for entry in direct[k]}
    return DirectKeys(entries, rest_lengths, frozenset(served))


class _KeyReader:
    """Entries that keys name in the scene of one case."""

    def __init__(self, case: AssembledCase) -> None:
        assert case.scene is not None
        self.scene: Scene = case.scene
        self.subject, self.slots = case.subject, list_slots(case)
        self.has_node_state = not isinstance(case.subject, BodySystem) and (
            find_formulation(case.request.formulation).in_nodes
        )
        # Positions change the lengths of rigid bars, which are constants of a library.
        self.rigid = np.zeros(len(case.subject.member_name), dtype=np.bool_)
        if not isinstance(case.subject, BodySystem):
            self.rigid = find_rigid_bars(case.subject, case.request)
        self.members: Mapping[str, Member | Tendon] = self.scene.tendons
        if not isinstance(case.subject, BodySystem):
            self.members = list_parts(self.scene, "scene").members
        # Gains of temperature follow from rest lengths, pieces and masses of cables from those of the whole.
        stated = [*self.scene.classes.values(), *self.members.values()]
        self.has_derived = any(isinstance(entry, TemperatureInput) for entry in self.scene.inputs) or any(
            entry.segments is not None or entry.mass_per_length is not None for entry in stated
        )
        names = self.subject.member_name
        # Of members of other laws the constants depend on stiffness and rest length.
        law_flags = [np.asarray(entry) != 0 for entry in self.subject.law_parameter.values()]
        is_other = np.any([np.zeros(len(names), dtype=np.bool_), *law_flags], axis=0)
        self.other_law = {name for name, flag in zip(names, is_other.tolist(), strict=True) if flag}

    def find_array_entries(self, key: ArrayKey) -> list[Entry]:
        """Return the entries of a key of arrays, none if they do not take its value alone."""
        if key.array in ("node_position", "node_velocity"):
            return [entry for row in key.rows for entry in self._find_state(key.array, row, key.axis)]
        if key.array == "node_mass" and not self.has_node_state:
            return []
        if key.axis < 0:
            is_rigid = self.rigid if key.array in OF_MEMBERS else np.zeros(1 + max(key.rows), dtype=np.bool_)
            return [(key.array, row) for row in key.rows if not is_rigid[row]]
        return [entry for row in key.rows for entry in self._in_vectors(key.array, row, key.axis)]

    def find_entries(self, steps: Sequence[str | int]) -> list[Entry]:
        """Return the entries that take the value of a number of the scene, none if there are none."""
        if self.scene.ground is not None and (steps[0] == "gravity" or steps[-1] in ("mass", "node_mass")):
            return []  # the stiffness and damping of the ground can follow from weights
        if self.has_derived and steps[0] != "loads":
            return []
        match steps:
            case ("gravity", int(place)):
                axis = self._axis(place, len(self.scene.gravity or ()))
                return self._in_vectors("gravity", 0, axis)
            case ("loads", int(number), "force", int(place)):
                load = self.scene.loads[number]
                # Loads on one node add up.
                index = {name: row for row, name in enumerate(self.subject.node_name)}
                nodes = [str(entry.node) for entry in self.scene.loads if isinstance(entry, Load)]
                rows = [index.get(node.replace(".", "_"), -1) for node in nodes]  # -1: several nodes
                if not isinstance(load, Load) or nodes.count(str(load.node)) > 1 or -1 in rows:
                    return []
                row = index[str(load.node).replace(".", "_")]
                return self._in_vectors("node_load", row, self._axis(place, len(load.force)))
            case ("nodes", str(name), "mass") if self.has_node_state:
                return [("node_mass", self.subject.node_name.index(name))]
            case ("shape", "node_mass") if self.has_node_state and self.scene.shape is not None:
                made = enumerate(self.subject.node_name)
                return [("node_mass", row) for row, name in made if name not in self.scene.nodes]
            case ("nodes", str(name), "velocity", int(place)):
                velocity = self.scene.nodes[name].velocity or ()
                row = self.subject.node_name.index(name)
                return self._find_state("node_velocity", row, self._axis(place, len(velocity)))
            case ("ground", str(word)) if self._is_direct_of_ground(word):
                return [("ground", CHANGEABLE.index(word))]
            case (_, str(name), str(word)) if word in OF_MEMBERS:
                return [(word, row) for row in self._find_rows(steps[0], name, word)]
        return []

    def _is_direct_of_ground(self, word: str) -> bool:
        """Return whether a number of the ground is stated, and no other one follows from it."""
        stated, ground = self.scene.ground, getattr(self.subject, "ground", None)
        if word not in CHANGEABLE or ground is None or getattr(stated, word, None) is None:
            return False
        following = {"stiffness": ("stick_stiffness", "stick_damping"), "stick_stiffness": ("stick_damping",)}
        is_free = all(getattr(stated, name) is not None for name in following.get(word, ()))
        return is_free and bool(ground.friction > 0) and ground.static_friction is None

    def find_stated(self, steps: Sequence[str | int], value: float) -> list[tuple[str, int, float]]:
        """Return which number of STATED of which members is which multiple of a number of the scene."""
        names = self.subject.member_name
        if self.has_derived:
            return []
        if tuple(steps) == ("shape", "prestress") and self.scene.shape is not None:
            made = {
                name: member.prestress
                for name, member in self.members.items()
                if name not in self.scene.members and member.prestress is not None
            }
            if made.keys() & self.other_law:
                return []
            factors = {names.index(name): prestress / value for name, prestress in made.items()}
            return [("prestress", row, factor) for row, factor in factors.items() if not self.rigid[row]]
        match steps:
            case (_, str(name), str(word)) if word in STATED:
                rows = self._find_rows(steps[0], name, word)
                values = {row: self._read_stated(row) for row in rows}
                follows = [row for row in rows if {"prestress", "strain"} & values[row].keys()]
                return [(word, row, 1.0) for row in follows]
        return []

    def build_rest_lengths(self, stated: Mapping[int, list[tuple[str, int, float]]]) -> RestLengths:
        """Return the rest lengths of the members that keys state something of."""
        rows = {row for factors in stated.values() for _, row, _ in factors}
        members = np.array(sorted(rows), dtype=np.int64)
        index = {row: number for number, row in enumerate(members.tolist())}
        # Lengths are those of the scene, without the changes of keys of arrays.
        subject, _ = assemble_scene(self.scene)
        position = (
            compute_node_position(subject) if isinstance(subject, BodySystem) else subject.node_position
        )
        columns = {
            name: StatedValues(np.full(len(members), -1), np.full(len(members), np.nan)) for name in STATED
        }
        for name in STIFFNESS:
            columns[name].factors[:] = getattr(subject, name)[members]
        for row, number in index.items():
            for name, value in self._read_stated(row).items():
                columns[name].factors[number] = value
        for key, factors in stated.items():
            for name, row, factor in factors:
                columns[name].keys[index[row]], columns[name].factors[index[row]] = key, factor
        length = subject.strands.lengths(position)[members]
        return RestLengths(members, length, columns, subject.tension_only[members])

    def _find_rows(self, section: object, name: str, word: str) -> list[int]:
        """Return the linear members that take this value from there; none with another law or rings."""
        if not isinstance(self.subject, BodySystem) and self.subject.sliding:
            return []
        group = next((keys for keys in ALTERNATIVES if word in keys), (word,))
        rows = []
        for row, other_name in enumerate(self.subject.member_name):
            if other_name not in self.members:  # an edge of a body
                continue
            member = self.members[other_name]
            stated = any(getattr(member, key, None) is not None for key in group)
            of_class = section == "classes" and member.class_name == name and not stated
            is_named = section in ("members", "tendons") and other_name == name
            if (of_class or is_named) and not self.rigid[row]:
                rows.append(row)
        is_linear = word == "damping" or not {self.subject.member_name[row] for row in rows} & self.other_law
        return rows if is_linear else []

    def _read_stated(self, row: int) -> dict[str, float]:
        """Return prestress [N] or strain of a member, by its own or its class's values."""
        member = self.members[self.subject.member_name[row]]
        has_value = any(getattr(member, key) is not None for key in ("rest_length", "prestress", "strain"))
        source = member if has_value or member.class_name is None else self.scene.classes[member.class_name]
        values = {name: getattr(source, name) for name in ("prestress", "strain")}
        return {name: value for name, value in values.items() if value is not None}

    def _find_state(self, array: str, row: int, axis: int) -> list[Entry]:
        """Return the entry of a position or velocity of a node along an axis."""
        if not self.has_node_state or isinstance(self.subject, BodySystem):
            return []
        is_position = array == "node_position"
        if is_position and self.rigid.any():
            return []
        if is_position and self.subject.node_anchored[row, axis]:
            return self._in_vectors("anchor_position", row, axis)
        same = (self.subject.coordinate_node_axis == (row, axis)).all(axis=1)
        slot = "coordinate" if is_position else "velocity"
        return [(slot, index) for index in np.flatnonzero(same).tolist()]

    def _in_vectors(self, slot: str, row: int, axis: int) -> list[Entry]:
        """Return the entry of an axis of a row of vectors, none of an axis that is not modelled."""
        axes = (0, 1, 2) if isinstance(self.subject, BodySystem) else self.subject.axes
        return [(slot, row * len(axes) + axes.index(axis))] if axis in axes and slot in self.slots else []

    def _axis(self, place: int, width: int) -> int:
        """Return the axis of a number of a vector, of 3 numbers or of one for each modelled axis."""
        return place if width == 3 or isinstance(self.subject, BodySystem) else self.subject.axes[place]
