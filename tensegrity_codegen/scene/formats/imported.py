"""The result of every importer, and how foreign names become names of a scene.

Importers of nodes and members share names, references, rules of members and control sections. In all checks
of a member `member` has the values by the names of a scene, and `where` returns the place of one of them in
the file, for messages.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.checks.limits import check_regular
from tensegrity_codegen.scene.names import check_known, check_scene_name, is_name, is_scene_name, key_path
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    describe_reason,
    name_list,
)

_MAX_NAME_LENGTH = 63
_TABLE_KEY = re.compile(r": ((?:limits[.])?members[.]\w+)(?:[.](\w+))?")  # of a member, and behind it


@dataclass(frozen=True)
class ImportResult:
    """A scene document made from foreign files, with notes on changes, assumptions and omissions.

    places: by the path of a table of the document, "members.m1", what finds its values in the files.
    """

    document: dict[str, Any]
    notes: tuple[str, ...]
    places: Mapping[str, "Where"] = field(default_factory=dict, compare=False)

    @contextmanager
    def locate_errors(self) -> Iterator[None]:
        """Let errors of the document name the places of values in the files."""
        try:
            yield
        except SceneError as error:
            found = _TABLE_KEY.search(error.where)
            if found and found[1] in self.places:
                error.where = self.places[found[1]](found[2] or "")
            raise


class NameBook:
    """Turns foreign names into names of a scene, each into its own, and remembers what was renamed.

    A name that is fine stays; otherwise letters that are not allowed become `_`, several of them one, none at
    the end; a name that does not start with a letter gets `prefix`, and a name that is taken gets a number.
    """

    def __init__(self, prefix: str, reserved: Iterable[str] = ()) -> None:
        self.prefix = prefix
        self.renamed: dict[str, str] = {}
        self._taken = set(reserved)
        self._last: dict[str, int] = {}  # the last number that a stem got

    def add(self, foreign: str) -> str:
        """Return the scene name of a new foreign name."""
        stem = self._clean(foreign)
        name, number = stem, self._last.get(stem, 1)
        while name in self._taken:
            number += 1
            ending = f"_{number}"
            name = stem[: _MAX_NAME_LENGTH - len(ending)] + ending
        self._last[stem] = number
        self._taken.add(name)
        if name != foreign:
            self.renamed[foreign] = name
        return name

    def _clean(self, foreign: str) -> str:
        if is_name(foreign):
            return foreign
        name = re.sub(r"(?:[^A-Za-z0-9]|_)+", "_", foreign[:1000])[:_MAX_NAME_LENGTH].rstrip("_")
        if not name[:1].isalpha():
            name = (self.prefix + name.lstrip("_"))[:_MAX_NAME_LENGTH].rstrip("_")
        return name if is_name(name) else f"{self.prefix.rstrip('_')}_{name}"[:_MAX_NAME_LENGTH].rstrip("_")

    def notes(self, what: str) -> list[str]:
        """Return a note about the renamed things, at most one."""
        if not self.renamed:
            return []
        shown = [f"{old!r} is {new}" for old, new in self.renamed.items()]
        return [
            f"{what} renamed, since names start with a letter and hold letters, digits and _ only: "
            + name_list(shown)
        ]


def name_all(foreign: Iterable[str], prefix: str, what: str) -> tuple[dict[str, str], list[str]]:
    """Return scene names by foreign names, valid ones as they are, and a note; prefix: as in NameBook."""
    foreign, book = list(foreign), NameBook(prefix)
    unchanged = {name: book.add(name) for name in foreign if NameBook(prefix).add(name) == name}
    return {name: unchanged.get(name) or book.add(name) for name in foreign}, book.notes(what)


def read_bytes(path: Path, largest: int, what: str) -> bytes:
    """Return the content of a foreign file; raises SceneError, or SceneSyntaxError if it is too large."""
    where = str(path)
    check_regular(path, where)
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except (OSError, ValueError) as error:
        problem = f"the file cannot be read: {describe_reason(error)}"
        raise SceneError(problem, where=where, hint="check the path and its permissions") from None
    if len(data) > largest:
        problem = f"the file is too large for {what}"
        raise SceneSyntaxError(problem, where=where, allowed=f"up to {largest >> 10} KB")
    return data


def read_text(path: Path, largest: int, what: str, fallback: str = "") -> str:
    """Return the text of a foreign file with plain newlines; fallback: encoding in place of UTF-8."""
    where, data = str(path), read_bytes(path, largest, what)
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        if fallback:
            return data.decode(fallback).replace("\r\n", "\n").replace("\r", "\n")
        problem = "the file is not UTF-8 text"
        raise SceneSyntaxError(problem, where=where, allowed=what, hint="save it as UTF-8") from None
    if not text.strip():
        raise SceneSyntaxError("the file is empty", where=where, allowed=what)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def scene_name(given: str | None, path: Path, fallback: str) -> tuple[str, list[str]]:
    """Return the scene's name and notes: the given one (checked), else one made from the file's stem."""
    if given is not None:
        check_scene_name(given, "name")
        return given, []
    name = NameBook(fallback).add(path.stem)
    name = name if is_scene_name(name) else f"{fallback}{name}"
    return name, [] if name == path.stem else [
        f"the scene is named {name} (the file's name is {path.stem!r})"
    ]


Where = Callable[[str], str]
STIFFNESSES = ("spring_constant", "axial_stiffness", "youngs_modulus")
# Numbers of a member that must be above zero.
POSITIVE = (*("rest_length", *STIFFNESSES, "mass", "density", "radius"), *("inner_radius", "mass_per_length"))


def check_ends(first: str, second: str, given: object, where: str) -> None:
    """Raise StructureError if a member joins a node to itself."""
    if first == second:
        problem = "the member joins a node to itself"
        raise StructureError(problem, where=where, given=given, allowed="two different nodes")


def check_member(member: Mapping[str, Any], where: Where) -> None:
    """Raise InvalidValueError for values out of range, given twice, or that the member cannot have."""
    _check_ranges(member, where)
    _check_stiffness(member, where)
    for key, alternative in (
        *(("rest_length", "prestress"), ("mass", "density"), ("mass", "mass_per_length")),
        *(("section", "radius"), ("section", "inner_radius")),
    ):
        if key in member and alternative in member:
            problem = f"the member has {key} and {alternative}, which define the same value"
            allowed = f"at most one of {key} and {alternative}"
            location = where(alternative)
            raise InvalidValueError(problem, where=location, given=member[alternative], allowed=allowed)
    _check_mass(member, where)
    if "prestress" in member:
        _check_prestress(member, where)


def _check_ranges(member: Mapping[str, Any], where: Where) -> None:
    for key in (*POSITIVE, "damping"):
        value = member.get(key)
        if value is not None and not (value >= 0 if key == "damping" else value > 0):
            allowed = "0 or more" if key == "damping" else "greater than 0, or no value"
            problem = "the value is out of range"
            raise InvalidValueError(problem, where=where(key), given=value, allowed=allowed)


def _check_stiffness(member: Mapping[str, Any], where: Where) -> None:
    stiffness = [key for key in STIFFNESSES if key in member]
    if len(stiffness) > 1:
        problem = "the member has two stiffnesses"
        value = ", ".join(f"{key} {member[key]}" for key in stiffness)
        allowed = "at most one of spring_constant [N/m], axial_stiffness [N] and youngs_modulus [Pa]"
        raise InvalidValueError(problem, where=where(stiffness[1]), given=value, allowed=allowed)
    if member["kind"] == "cable" and not stiffness:
        allowed = "one of spring_constant [N/m], axial_stiffness [N] and youngs_modulus [Pa]"
        raise InvalidValueError("a cable without stiffness", where=where("spring_constant"), allowed=allowed)
    if "youngs_modulus" in member and not {"radius", "section"} & member.keys():
        problem, location = "Young's modulus without a section", where("youngs_modulus")
        allowed = "youngs_modulus [Pa] with a section, or a radius [m]"
        raise InvalidValueError(problem, where=location, given=member["youngs_modulus"], allowed=allowed)


def _check_mass(member: Mapping[str, Any], where: Where) -> None:
    is_cable = member["kind"] == "cable"
    key = "density" if is_cable else "mass_per_length"
    if key in member:
        problem = f"a {member['kind']} has no {key}"
        allowed = "mass or mass_per_length of cables, mass or density of bars"
        raise InvalidValueError(problem, where=where(key), given=member[key], allowed=allowed)
    if "density" in member and not {"radius", "section"} & member.keys():
        problem, allowed = "a density without a radius", "density [kg/m3] and radius [m], or mass [kg] alone"
        raise InvalidValueError(problem, where=where("density"), given=member["density"], allowed=allowed)


def _check_prestress(member: Mapping[str, Any], where: Where) -> None:
    """Check that a member of this kind and stiffness can have its prestress."""
    if not set(STIFFNESSES) & member.keys():
        problem = "a rigid bar has no prestress"
        allowed = "no prestress, or a bar with spring_constant [N/m] or axial_stiffness [N]"
        raise InvalidValueError(problem, where=where("prestress"), given=member["prestress"], allowed=allowed)
    if member["kind"] == "cable" and member["prestress"] < 0 and member.get("tension_only", True):
        problem, allowed = "a cable cannot push", "0 or more [N]; less with tension_only = no"
        raise InvalidValueError(problem, where=where("prestress"), given=member["prestress"], allowed=allowed)


def note_defaults(members: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return notes on the meaning of missing values of members."""
    members, notes = list(members), []
    present = sum(not {"rest_length", "prestress"} & member.keys() for member in members)
    if present:
        notes.append(f"members without a rest length, which is their present length: {present}")
    rigid = sum(not set(STIFFNESSES) & member.keys() for member in members)
    if rigid:
        notes.append(f"bars without a stiffness, which are rigid: {rigid}")
    return notes


CONTROL_SECTIONS = ("actuators", "sensors", "limits")
Names = Mapping[str, str]


@dataclass(frozen=True)
class NetworkMember:
    """One member: its name in the file, its nodes, its values by the keys of a scene, its place.

    ends: two nodes; of a cable through rings also the rings between them, in order.

    place_of: the place of a value in the file by its key; else the key behind the member's place.
    """

    name: str
    ends: tuple[str, ...]
    values: Mapping[str, Any]
    where: str
    place_of: Where | None = None

    def find_place(self, key: str) -> str:
        """Return the place of a value in the file by its key, of the member itself without one."""
        return self.place_of(key) if self.place_of and key else key_path(self.where, key)


@dataclass
class Network:
    """Nodes, bodies and members under their names in a file.

    nodes, bodies: values by the keys of a scene; points: body and point by the name of the file, which
    stands for a node; loads: forces [N] by node; inputs, control: as in a scene, with names of the file;
    control: the sections CONTROL_SECTIONS; ground: as in a scene, contacts are nodes, or bodies and points;
    parallel: whether several members may join the same nodes.
    """

    nodes: dict[str, dict[str, Any]] = field(default_factory=dict)
    members: list[NetworkMember] = field(default_factory=list)
    loads: list[tuple[str, Sequence[float]]] = field(default_factory=list)
    inputs: list[dict[str, Any]] = field(default_factory=list)
    control: dict[str, Any] = field(default_factory=dict)
    gravity: Sequence[float] | None = None
    notes: list[str] = field(default_factory=list)
    bodies: dict[str, dict[str, Any]] = field(default_factory=dict)
    points: dict[str, tuple[str, str]] = field(default_factory=dict)
    ground: dict[str, Any] | None = None
    parallel: bool = False
    _given: set[str] = field(default_factory=set)

    def has_node(self, name: str) -> bool:
        """Return whether a name is that of a node or of a point of a body."""
        return name in self.nodes or name in self.points

    def name_member(self, name: str) -> str:
        """Return a name for a member without one: `name`, with a number if other nodes gave it before."""
        candidate, number = name, 1
        while candidate in self._given:
            number += 1
            candidate = f"{name}_{number}"
        self._given.add(candidate)
        return candidate


def build_result(
    network: Network, path: Path, name: str | None, gravity: Sequence[float] | None
) -> ImportResult:
    """Return the scene document of a network, and notes; name, gravity: in place of those of the file."""
    title, notes = scene_name(name, path, "scene_")
    for section, entries in (("nodes", network.nodes), ("members", network.members)):
        if not entries and not network.bodies:
            raise StructureError(f"the file has no {section}", where=str(path), allowed="one at least")
    node_names, node_notes = name_all(network.nodes, "n", "nodes were")
    _check_names(network.members)
    member_names, member_notes = name_all(
        [member_entry.name for member_entry in network.members], "m", "members were"
    )
    document: dict[str, Any] = {"name": title}
    chosen = network.gravity if gravity is None else gravity
    if chosen is not None:
        document["gravity"] = [float(value) for value in chosen]
    if network.nodes or not network.bodies:
        document["nodes"] = {node_names[key]: dict(values) for key, values in network.nodes.items()}
    points, body_names = _name_bodies(network, document, node_names, node_notes)
    owners = dict.fromkeys(
        member_entry.values["class"] for member_entry in network.members if "class" in member_entry.values
    )
    class_names, class_notes = name_all(owners, "c", "classes were")
    classes: dict[str, dict[str, Any]] = {}
    members = _build_members(network.members, member_names, node_names, network.parallel)
    for member_entry, member in zip(network.members, members.values(), strict=True):
        if "class" in member:
            member["class"] = class_names[member["class"]]
            class_table = classes.setdefault(member["class"], {"kind": member["kind"]})
            if class_table["kind"] != member.pop("kind"):
                where, value = member_entry.find_place("class"), member_entry.values["class"]
                problem, allowed = "a class with bars and cables", "classes of one kind"
                raise InvalidValueError(problem, where=where, given=value, allowed=allowed)
    document |= {"classes": classes} if classes else {}
    if members or not network.bodies:
        document["members"] = members
    if network.ground is not None:
        contacts = [
            points[name] if isinstance(name, tuple) else node_names[name]
            for name in network.ground["contacts"]
        ]
        document["ground"] = {**network.ground, "contacts": contacts}
    loads = [
        {"node": node_names[node], "force": [float(value) for value in force]}
        for node, force in network.loads
    ]
    document |= {"loads": loads} if loads else {}
    input_names, input_notes = name_all(
        [str(input_entry["name"]) for input_entry in network.inputs], "u", "inputs were"
    )
    tables = {"nodes": node_names, "members": member_names, "name": input_names}
    inputs = [_rename_entry(input_entry, tables) for input_entry in network.inputs]
    document |= {"inputs": inputs} if inputs else {}
    document |= _rename_control(network.control, node_names, member_names, body_names)
    notes += [*node_notes, *member_notes, *class_notes, *input_notes]
    defaults = note_defaults(members.values())
    places = {f"members.{member_names[entry.name]}": entry.find_place for entry in network.members}
    return ImportResult(document, (*notes, *network.notes, *defaults), places)


def _name_bodies(
    network: Network, document: dict[str, Any], nodes: dict[str, str], notes: list[str]
) -> tuple[dict[tuple[str, str], str], Names]:
    """Add the bodies to a document, their points to the names of nodes; return names of points, of bodies."""
    named: dict[tuple[str, str], str] = {}
    body_names, body_notes = name_all(network.bodies, "b", "bodies were")
    notes += body_notes
    for body, values in network.bodies.items():
        point_names, point_notes = name_all(values["points"], "p", f"points of {body_names[body]} were")
        notes += point_notes
        points = {point_names[key]: point for key, point in values["points"].items()}
        document.setdefault("bodies", {})[body_names[body]] = {**values, "points": points}
        named |= {(body, key): f"{body_names[body]}.{name}" for key, name in point_names.items()}
    nodes |= {name: named[place] for name, place in network.points.items()}
    return named, body_names


def _check_names(members: Sequence[NetworkMember]) -> None:
    seen: dict[str, str] = {}
    for member in members:
        if member.name in seen:
            problem, allowed = "two members with one name", f"each name once ({seen[member.name]} has it too)"
            raise DuplicateNameError(problem, where=member.where, given=member.name[:80], allowed=allowed)
        seen[member.name] = member.where


def _build_members(
    members: Sequence[NetworkMember], names: Mapping[str, str], nodes: Mapping[str, str], parallel: bool
) -> dict[str, dict[str, Any]]:
    built: dict[str, dict[str, Any]] = {}
    seen: dict[frozenset[str], str] = {}
    for entry in members:
        for end in entry.ends:
            check_known(end, nodes, "unknown node", "a node of the file", entry.where)
        for first, second in pairwise(entry.ends):
            check_ends(first, second, second, entry.where)
        pair = frozenset(entry.ends)
        if pair in seen and not parallel:
            problem, location = "two members join the same nodes", entry.where
            allowed = f"one member for each pair ({seen[pair]} joins them too)"
            raise DuplicateNameError(problem, where=location, given=" and ".join(entry.ends), allowed=allowed)
        seen[pair] = entry.where
        member = {"kind": entry.values["kind"], "nodes": [nodes[end] for end in entry.ends], **entry.values}
        check_member(member, entry.find_place)
        built[names[entry.name]] = member
    return built


def _rename_control(
    content: Mapping[str, Any], nodes: Names, members: Names, bodies: Names
) -> dict[str, Any]:
    """Return the sections `actuators`, `sensors` and `limits` of a file with the scene's names.

    nodes, members, bodies: names of the scene by those of the file, which may be numbers. What is not there,
    or not of the right kind, stays as it is: the checks of the scene name it.
    """
    renamed: dict[str, Any] = {}
    tables = {"members": members, "nodes": nodes, "bodies": bodies}
    for section in ("actuators", "sensors"):
        value = content.get(section)
        if value is not None:
            entries = value if isinstance(value, list) else [value]
            renamed_entries = [_rename_entry(entry, tables) for entry in entries]
            renamed[section] = renamed_entries if isinstance(value, list) else renamed_entries[0]
    limits = content.get("limits")
    if isinstance(limits, dict) and isinstance(limits.get("members"), dict):
        of_members: dict[str, Any] = {}
        for key, value in limits["members"].items():
            name = members.get(key, key)
            of_members[key if name in of_members else name] = value
        limits = {**limits, "members": of_members}
    return renamed | ({} if limits is None else {"limits": limits})


def _rename_entry(entry: Any, tables: Mapping[str, Names]) -> Any:
    """Return an entry with names of the scene under the keys of `tables`."""
    if not isinstance(entry, dict):
        return entry
    return {key: _rename(value, tables[key]) if key in tables else value for key, value in entry.items()}


def _rename(value: Any, names: Names) -> Any:
    """Return the scene's name of a name or number, or of each of a list of them."""
    if isinstance(value, list):
        return [_rename(entry, names) if not isinstance(entry, list) else entry for entry in value]
    if isinstance(value, bool) or not isinstance(value, str | int):
        return value
    return names.get(str(value) if isinstance(value, str) or abs(value) < 10**18 else "", value)
