"""Targets of a list of names: members, groups and classes; nodes; and changeable parameters."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.members import spread_vectors
from tensegrity_codegen.scene.checks.check_members import find_fully_anchored
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.schema.model_schema import Parameters
from tensegrity_codegen.scene.schema.part_schema import ForceInput, RestLengthInput, TemperatureInput
from tensegrity_codegen.scene.schema.schema_types import Selection
from tensegrity_codegen.structure.free_bodies import FreeBody
from tensegrity_codegen.structure.ground import CHANGEABLE, Ground
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    UnknownNameError,
    check_choice,
    name_list,
    suggest,
)


class Targets:
    """Indices by names of members, groups and classes, each of one meaning; share: of its cable."""

    def __init__(
        self,
        node_name: Sequence[str],
        member_name: Sequence[str],
        member_class: Sequence[str],
        class_name: Iterable[str],
        groups: Mapping[str, Sequence[str]],
        where: str,
        share: FloatArray | None = None,
    ) -> None:
        self.share = np.ones(len(member_name)) if share is None else share
        self.where = where
        self.node_name, self.member_name = node_name, member_name
        self._node = {name: row for row, name in enumerate(node_name)}
        self._member = {name: row for row, name in enumerate(member_name)}
        of_class: dict[str, list[int]] = {name: [] for name in class_name}
        self._refuse_clashes(of_class, "classes", {"member": self._member})
        self._refuse_clashes(groups, "groups", {"member": self._member, "class": of_class})
        for row, name in enumerate(member_class):
            if name:
                of_class[name].append(row)
        self.groups = {name: self._find_group(name, names) for name, names in groups.items()}
        self._set = {name: tuple(rows) for name, rows in of_class.items()} | self.groups

    def find_members(self, names: Iterable[str], *place: str | int) -> tuple[int, ...]:
        """Return the indices of the members that `names` (members, groups, classes) stand for, each once."""
        members: dict[int, None] = {}
        for name in names:
            if name in self._member:
                members[self._member[name]] = None
            elif name in self._set:
                members.update(dict.fromkeys(self._set[name]))
            else:
                self._refuse_unknown(name, [*self._member, *self._set], "members, groups or classes", place)
        return tuple(members)

    def find_nodes(self, names: Iterable[str], *place: str | int) -> tuple[int, ...]:
        """Return the indices of the nodes of these names, each once."""
        nodes: dict[int, None] = {}
        for name in names:
            if name not in self._node:
                self._refuse_unknown(name, self._node, "nodes", place)
            nodes[self._node[name]] = None
        return tuple(nodes)

    def _find_group(self, name: str, names: Sequence[str]) -> tuple[int, ...]:
        for member in names:
            if member not in self._member:
                self._refuse_unknown(member, self._member, "members", ("groups", name))
        return tuple(dict.fromkeys(self._member[member] for member in names))

    def _refuse_clashes(
        self, names: Iterable[str], section: str, taken: Mapping[str, Mapping[str, Any]]
    ) -> None:
        for name, (kind, names_of_kind) in itertools.product(names, taken.items()):
            if name in names_of_kind:
                raise DuplicateNameError(
                    f"the name stands for {'an' if kind[0] in 'aeiou' else 'a'} {kind} too, so a list that "
                    "uses it has two meanings",
                    where=key_path(self.where, section, name),
                    given=name,
                    allowed="different names for members, groups and classes",
                    hint="rename one of the two",
                )

    def _refuse_unknown(
        self, name: str, known: Iterable[str], what: str, place: tuple[str | int, ...]
    ) -> None:
        is_all = name == "all" and place[0] == "parameters"
        hint = 'write "all", not in a list' if is_all else suggest(name, known)
        location, allowed = key_path(self.where, *place), f"names of {what}"
        problem = "the name is not defined"
        raise UnknownNameError(problem, where=location, given=name, allowed=allowed, hint=hint)


def check_new_name(name: str, built: Iterable[Any], section: str, where: str) -> None:
    """Raise DuplicateNameError for the name of an entry that is built already."""
    if any(name == earlier.name for earlier in built):
        problem, hint = f"two {section} under one name", "rename one of the two"
        raise DuplicateNameError(problem, where=where, given=name, allowed="each name once", hint=hint)


def build_inputs(
    inputs: Sequence[RestLengthInput | TemperatureInput | ForceInput],
    targets: Targets,
    member: Mapping[str, Any],
    axes: tuple[int, ...],
) -> tuple[ActuatedInput, ...]:
    """Return the actuated inputs; member: arrays of `build_member_arrays`."""
    built: list[ActuatedInput] = []
    for number, entry in enumerate(inputs):
        check_new_name(entry.name, built, "inputs", key_path(targets.where, "inputs", number, "name"))
        if isinstance(entry, ForceInput):
            nodes = targets.find_nodes(entry.nodes, "inputs", number, "nodes")
            keys = ("inputs", number, "direction")
            vector = spread_vectors([entry.direction], axes, [keys], targets.where)[0]
            direction = normalise(vector, entry.direction, key_path(targets.where, *keys))
            built.append(ActuatedInput(entry.name, "force", nodes, direction))
        else:
            members = targets.find_members(entry.members, "inputs", number, "members")
            if not members:
                _refuse_empty(targets.where, ("inputs", number, "members"), entry.members)
            rigid = (member["spring_constant"] == 0) & (member["axial_stiffness"] == 0)
            problem = "a rigid bar has no rest length to change"
            refuse_members(members, rigid, problem, targets, ("inputs", number, "members"))
            expanded = member["rest_length"], member["thermal_expansion"]
            gain = find_gain(entry, members, targets, ("inputs", number), *expanded)
            built.append(ActuatedInput(entry.name, entry.kind, members, gain=gain))
    return tuple(built)


def find_gain(
    item: RestLengthInput | TemperatureInput,
    members: tuple[int, ...],
    targets: Targets,
    place: tuple[str | int, ...],
    rest_length: FloatArray,
    expansion: FloatArray | None,
) -> tuple[float, ...]:
    """Return the gain of an input on each member (rho alpha of temperature), () if all are 1."""
    if isinstance(item, TemperatureInput):
        slope = rest_length * (np.zeros(len(rest_length)) if expansion is None else expansion)
        problem = "a member without thermal_expansion does not change with temperature"
        refuse_members(members, slope == 0, problem, targets, (*place, "members"))
        return tuple(slope[list(members)].tolist())
    stated = (1.0,) * len(item.members) if item.gain is None else item.gain
    if len(stated) != len(item.members):
        location = key_path(targets.where, *place, "gain")
        allowed = f"{len(item.members)} numbers, one for each of `members`"
        raise InvalidValueError(
            "not one gain for each name", where=location, given=list(stated), allowed=allowed
        )
    gain: dict[int, float] = {}
    for name, value in zip(item.members, stated, strict=True):
        for e in targets.find_members([name], *place, "members"):
            gain.setdefault(e, value * (1.0 if targets.member_name[e] == name else float(targets.share[e])))
    return () if set(gain.values()) == {1.0} else tuple(gain[e] for e in members)


def build_parameters(
    parameters: Parameters,
    targets: Targets,
    *,
    spring_constant: NDArray[np.float64],
    axial_stiffness: NDArray[np.float64],
    anchored: BoolArray,
    axes: tuple[int, ...],
    bodies: Sequence[FreeBody] = (),
) -> dict[str, tuple[int, ...]]:
    """Return the indices that stay changeable by argument name; "all": those for which it has meaning."""
    springs, axials = spring_constant > 0, axial_stiffness > 0
    all_nodes = np.ones(len(targets.node_name), dtype=np.bool_)
    some_free = ~find_fully_anchored(anchored, axes)
    is_point = np.array(["." in name for name in targets.node_name], dtype=np.bool_)
    of_scene = ~is_point
    of_scene[[node for body in bodies for node in body.corner]] = False
    some_held = np.isin(np.arange(len(all_nodes)), np.nonzero(anchored[:, axes])[0])
    rules: dict[str, tuple[Literal["member", "node"], BoolArray, BoolArray, str]] = {
        "rest_length": ("member", springs | axials, springs | axials, "a rigid bar has no rest length"),
        "spring_constant": ("member", springs, springs, "the member has no spring_constant"),
        "axial_stiffness": ("member", axials, axials, "the member has no axial_stiffness"),
        "damping": ("member", springs | axials, springs | axials, "damping of a rigid bar has no effect"),
        "node_mass": ("node", some_free & of_scene, of_scene, "a body has one mass, not one of each node"),
        "node_load": ("node", some_free & (of_scene | is_point), all_nodes, ""),
        "anchor_position": ("node", some_held, some_held, "the node is not anchored"),
    }
    built: dict[str, tuple[int, ...]] = {}
    for key, (target_kind, usual, possible, problem) in rules.items():
        chosen: Literal["all"] | tuple[str, ...] | None = getattr(parameters, key)
        if chosen is None:
            continue
        keys = ("parameters", key)
        if chosen == "all":
            targets_of_key = tuple(np.flatnonzero(usual).tolist())
        elif target_kind == "member":
            targets_of_key = targets.find_members(chosen, *keys)
            refuse_members(targets_of_key, ~possible, problem, targets, keys)
        else:
            targets_of_key = targets.find_nodes(chosen, *keys)
            _refuse_rows(targets_of_key, ~possible, problem, targets.node_name, targets.where, keys)
        if not targets_of_key:
            _refuse_empty(targets.where, keys, chosen)
        built[key] = tuple(sorted(targets_of_key))
    names = [body.name for body in bodies]
    for key in ("body_mass", "body_inertia"):
        chosen_bodies: Literal["all"] | tuple[str, ...] | None = getattr(parameters, key)
        if chosen_bodies is None:
            continue
        for name in () if chosen_bodies == "all" else chosen_bodies:
            problem, allowed = "the body is not defined", "names of rigid bodies beside nodes and members"
            check_known(name, names, problem, allowed, targets.where, "parameters", key)
        rows = range(len(names)) if chosen_bodies == "all" else map(names.index, chosen_bodies)
        built[key] = tuple(sorted(set(rows)))
        if not built[key]:
            _refuse_empty(targets.where, ("parameters", key), chosen_bodies)
    return built | ({"gravity": ()} if parameters.gravity else {})


def find_ground_numbers(
    given: Selection | None, ground: Ground | None, where: str
) -> dict[str, tuple[int, ...]]:
    """Return the places of the ground's numbers that stay changeable, as the parameter "ground"."""
    if given is None:
        return {}
    location = key_path(where, "parameters", "ground")
    if ground is None:
        raise InvalidValueError("the scene has no ground", where=location, given=given, hint="add [ground]")
    valid_names = CHANGEABLE if ground.friction else CHANGEABLE[:2]
    chosen = valid_names if given == "all" else given
    for name in chosen:
        check_choice(name, CHANGEABLE, "number of the ground", location)
        if name not in valid_names:
            problem = "the ground has no friction, so that nothing would follow this number"
            hint = "give the ground a friction above 0"
            allowed = ", ".join(valid_names)
            raise InvalidValueError(problem, where=location, given=name, allowed=allowed, hint=hint)
    return {"ground": tuple(sorted({CHANGEABLE.index(name) for name in chosen}))}


def normalise(vector: NDArray[np.float64], given: Sequence[float], where: str) -> tuple[float, float, float]:
    """Return v / |v| of a vector (3,), of any size; `given` and `where` are for the error."""
    largest = np.abs(vector).max()
    if largest == 0:
        problem = "a direction of length zero"
        raise InvalidValueError(problem, where=where, given=list(given), allowed="a vector that is not zero")
    vector = vector / largest
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return (x, y, z)


def refuse_members(
    rows: tuple[int, ...], bad: BoolArray, problem: str, targets: Targets, place: tuple[str | int, ...]
) -> None:
    """Raise InvalidValueError if one of the members `rows` is `bad` (n_members,)."""
    _refuse_rows(rows, bad, problem, targets.member_name, targets.where, place)


def _refuse_rows(
    rows: tuple[int, ...],
    bad: BoolArray,
    problem: str,
    names: Sequence[str],
    where: str,
    place: tuple[str | int, ...],
) -> None:
    wrong = [names[row] for row in rows if bad[row]]
    if wrong:
        location, allowed = key_path(where, *place), '"all", or the names of those for which it has a meaning'
        hint = "take it out of the list"
        raise InvalidValueError(
            f"{problem}: {name_list(wrong)}", where=location, given=wrong[0], allowed=allowed, hint=hint
        )


def _refuse_empty(where: str, place: tuple[str | int, ...], given: Any) -> None:
    problem, value = "the selection is empty", given if isinstance(given, str) else list(given)
    allowed, hint = "one member or node or more for which it has a meaning", "remove the key"
    raise InvalidValueError(problem, where=key_path(where, *place), given=value, allowed=allowed, hint=hint)
