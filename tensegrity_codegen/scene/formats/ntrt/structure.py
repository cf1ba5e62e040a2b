"""The tree of NTRT structures: nodes, pairs and substructures, found by name as the toolkit finds them.

Builders say which tags make a rod or a cable of a pair, or a sphere of a node, and their parameters. Defaults
and the order of search are the toolkit's (NTRTsim, src/yamlbuilder/TensegrityModel.h and
src/tgcreator/tgStructureInfo.cpp): the builder that was added last counts, rods before cables, and a builder
matches where a pair, with the name of the structure that owns it, has all of its tags.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.ntrt.file import check_keys, parse_number, read_table
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, UnknownNameError, suggest


@dataclass(eq=False)
class NtrtNode:
    """A point; `path` is its name below the top structure, such as t1.front."""

    path: str
    position: NDArray[np.float64]  # (3,), replaced when its structure moves


@dataclass(frozen=True)
class NtrtPair:
    """Two nodes and the words that a builder is found by; `stem` names the members made of the group."""

    ends: tuple[NtrtNode, NtrtNode]
    tags: frozenset[str]
    stem: str
    where: str


@dataclass(eq=False)
class NtrtStructure:
    """One structure of the tree; its own name counts among the tags of its pairs."""

    name: str
    path: str
    nodes: dict[str, NtrtNode] = field(default_factory=dict)
    pairs: list[NtrtPair] = field(default_factory=list)
    children: "dict[str, NtrtStructure]" = field(default_factory=dict)
    _found: dict[str, NtrtNode] = field(default_factory=dict)

    def walk(self) -> "Iterator[NtrtStructure]":
        """Yield this structure and all below it, breadth first."""
        queue = deque([self])
        while queue:
            structure = queue.popleft()
            yield structure
            queue.extend(structure.children.values())

    def find_node(self, name: str, where: str) -> NtrtNode:
        """Return the node `name` or `child.name`; the nearest one below counts."""
        *owners, node_name = name.split(".")
        structure = self
        for owner in owners:
            structure = structure.find_child(owner, where)
        if node_name in structure._found:  # pairs are many and name few nodes
            return structure._found[node_name]
        for candidate in structure.walk():
            if node_name in candidate.nodes:
                structure._found[node_name] = candidate.nodes[node_name]
                return candidate.nodes[node_name]
        node_names = {node for candidate in structure.walk() for node in candidate.nodes}
        problem = f"no node of this name in {structure.name or 'the structure'}"
        allowed = "the name of a node, or child.node"
        hint = suggest(node_name, node_names)
        raise UnknownNameError(problem, where=where, given=name, allowed=allowed, hint=hint)

    def find_child(self, name: str, where: str) -> "NtrtStructure":
        """Return the nearest substructure called `name`; raises UnknownNameError."""
        for candidate in self.walk():
            if name in candidate.children:
                return candidate.children[name]
        problem, allowed = "no substructure of this name", "the name of a substructure that has a path"
        hint = suggest(name, self.children)
        raise UnknownNameError(problem, where=where, given=name, allowed=allowed, hint=hint)

    def transform(self, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> None:
        """Replace every node position below by `change` of it."""
        for structure in self.walk():
            for node in structure.nodes.values():
                node.position = change(node.position)

    def centroid(self, where: str) -> NDArray[np.float64]:
        """Return the mean of all node positions below; raises StructureError if there is none."""
        points = [node.position for structure in self.walk() for node in structure.nodes.values()]
        if not points:
            raise StructureError("a structure without nodes has no centroid", where=where)
        mean: NDArray[np.float64] = np.mean(points, axis=0)
        return mean


_ROD = {"radius": 0.5, "density": 1.0, "friction": 1.0, "roll_friction": 0.0, "restitution": 0.2}
_CABLE = {
    "stiffness": 1000.0,
    "damping": 10.0,
    "pretension": 0.0,
    "history": 0.0,
    "max_tension": 1000.0,
    "target_velocity": 100.0,
    "min_actual_length": 0.1,
    "min_rest_length": 0.1,
    "rotation": 0.0,
}
_FLAGS = ("moveCablePointAToEdge", "moveCablePointBToEdge")
_MOTOR = {"radius": 1.0, "motor_friction": 0.0, "motor_inertia": 1.0, "back_drivable": 0.0}
_SPHERE = {"radius": 0.5, "density": 1.0, "friction": 1.0, "roll_friction": 0.0, "restitution": 0.2}
_BOX = ("width", "height", "density", "friction", "roll_friction", "restitution")
_USED = ("radius", "density", "stiffness", "damping", "pretension")

Kind = Literal["rod", "cable", "box", "sphere"]

_CLASSES: Mapping[str, tuple[Kind, dict[str, float], tuple[str, ...]]] = {
    "tgRodInfo": ("rod", _ROD, ()),
    "tgBasicActuatorInfo": ("cable", _CABLE, _FLAGS),
    "tgBasicContactCableInfo": ("cable", _CABLE, _FLAGS),
    "tgKinematicActuatorInfo": ("cable", _CABLE | _MOTOR, ()),
    "tgKinematicContactCableInfo": ("cable", _CABLE | _MOTOR, ()),
    "tgSphereInfo": ("sphere", _SPHERE, ()),
    "tgBoxInfo": ("box", dict.fromkeys(_BOX, 1.0), ()),
}


@dataclass(frozen=True)
class NtrtBuilder:
    """One builder: its tags, what it makes, and the values that count here, in the file's own units."""

    key: str
    kind: Kind
    class_name: str
    values: Mapping[str, float]
    ignored: tuple[str, ...]
    where: str

    @cached_property
    def tags(self) -> frozenset[str]:
        """The tags that a pair must have."""
        return frozenset(self.key.split())


class BuilderBook:
    """All builders of a structure and its substructures, in the order in which the toolkit adds them."""

    def __init__(self) -> None:
        self._builders: list[NtrtBuilder] = []
        self._places: set[str] = set()
        defaults = (
            *(("rod", "tgRodInfo"), ("string", "tgBasicActuatorInfo")),
            *(("box", "tgBoxInfo"), ("sphere", "tgSphereInfo")),
        )
        for key, class_name in defaults:
            self._builders.append(_read_builder(key, {"class": class_name}, "the toolkit's default builders"))

    def add(self, builders: dict[str, Any], where: str) -> None:
        """Add the builders section of one file; raises InvalidValueError or UnknownKeyError."""
        self._builders += [
            _read_builder(key, value, f"{where}.{key}")
            for key, value in builders.items()
            if f"{where}.{key}" not in self._places
        ]
        self._places |= {f"{where}.{key}" for key in builders}

    def __len__(self) -> int:
        return len(self._builders)

    def find(self, pair: NtrtPair, owner: str) -> NtrtBuilder | None:
        """Return the builder of a pair that the structure `owner` holds, or None."""
        tags = pair.tags | {owner}
        matching = [option for option in self._last_first("rod", "cable", "box") if option.tags <= tags]
        rigid = [option for option in matching if option.kind != "cable"]
        builder = rigid[0] if rigid else matching[0] if matching else None
        if builder is not None and builder.kind == "box":
            problem, allowed = "boxes (tgBoxInfo) are not supported", "rods (tgRodInfo) and cables"
            hint = "replace the box by rods"
            raise InvalidValueError(problem, where=pair.where, given=builder.key, allowed=allowed, hint=hint)
        return builder

    def is_rod(self, pair: NtrtPair, owner: str) -> bool:
        """Return whether a pair that the structure `owner` holds becomes a rod, by the builders so far."""
        builder = self.find(pair, owner)
        return builder is not None and builder.kind == "rod"

    def find_sphere(self, node: str, owner: str) -> NtrtBuilder | None:
        """Return the builder that makes a sphere of a node of the structure `owner`, or None."""
        tags = {*node.split(), owner}
        return next((option for option in self._last_first("sphere") if option.tags <= tags), None)

    def _last_first(self, *kinds: Kind) -> Iterator[NtrtBuilder]:
        return (builder for builder in reversed(self._builders) if builder.kind in kinds)


def _read_builder(key: str, value: Any, where: str) -> NtrtBuilder:
    table = read_table(value, where)
    check_keys(table, ("class", "parameters"), where)
    class_name = table.get("class")
    if not isinstance(class_name, str) or class_name not in _CLASSES:
        raise InvalidValueError(
            "not a builder class that is supported",
            where=f"{where}.class",
            given=class_name if isinstance(class_name, str) else None,
            allowed=", ".join(_CLASSES),
        )
    if not key.split():
        raise InvalidValueError("a builder without tags", where=where, allowed="one tag or more")
    kind, defaults, flags = _CLASSES[class_name]
    stated = read_table(table.get("parameters"), f"{where}.parameters")
    check_keys(stated, (*defaults, *flags), f"{where}.parameters")
    numbers = {
        name: parse_number(text, f"{where}.parameters.{name}")
        for name, text in stated.items()
        if name not in flags
    }
    values = {name: number for name, number in {**defaults, **numbers}.items() if name in _USED}
    _check_ranges(kind, values, f"{where}.parameters")
    used = _USED[2:] if kind == "cable" else _USED
    ignored = tuple(name for name in stated if name not in used)
    return NtrtBuilder(key, kind, class_name, values, ignored, where)


def _check_ranges(kind: str, values: Mapping[str, float], where: str) -> None:
    positive = {"cable": ("stiffness",), "box": ()}.get(kind, ("radius",))
    not_negative = {"cable": ("damping",), "box": ()}.get(kind, ("density",))
    for name in positive:
        if not values[name] > 0:
            problem, location = "the value is out of range", f"{where}.{name}"
            raise InvalidValueError(problem, where=location, given=values[name], allowed="greater than 0")
    for name in not_negative:
        if values[name] < 0:
            problem = "the value is out of range"
            raise InvalidValueError(problem, where=f"{where}.{name}", given=values[name], allowed="0 or more")
