"""From NTRT structure files to a tree of structures, placed as the toolkit places them.

Semantics after the NASA Tensegrity Robotics Toolkit (NTRTsim, Apache-2.0), src/yamlbuilder/TensegrityModel
and src/tgcreator/tgStructure: substructures are built first, then all of them rotated, then each one scaled,
offset (times its place in a key a/b/c) and translated; pairs and bonds follow, and move with their owner.

Bonds of the kind node_edge, after addNodeEdgePairs: the second structure is turned until the planes through
the first three points of both sides agree, moved until the centroids of all points agree, and turned in that
plane until the first points lie in one direction; an edge counts as its middle. Each edge is then replaced by
two pairs that lead from its ends to the node, and pairs between nodes of the bond are removed; rods stay.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.ntrt.file import (
    check_keys,
    parse_number,
    parse_pair,
    parse_vector,
    read_table,
    read_yaml,
)
from tensegrity_codegen.scene.formats.ntrt.structure import BuilderBook, NtrtNode, NtrtPair, NtrtStructure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    StructureError,
)

IsRod = Callable[[NtrtPair, str], bool]  # of a pair and the name of the structure that owns it

_FEWEST = 3
_OPPOSITE = 1e-5  # unit vectors a and b count as opposite below this |a + b|, as in the toolkit
_ON_A_LINE = 1e-9  # sine of the angle at the first of three points


@dataclass
class _Bond:
    """The pairs of one bond: nodes, the edges they meet, and the points of both structures."""

    nodes: list[NtrtNode] = field(default_factory=list)
    edges: list[tuple[NtrtNode, NtrtNode]] = field(default_factory=list)
    points: tuple[list[FloatArray], list[FloatArray]] = field(default_factory=lambda: ([], []))


def bond_nodes_to_edges(
    sides: tuple[NtrtStructure, NtrtStructure], pairs: Any, is_rod: IsRod, where: str
) -> list[tuple[NtrtNode, NtrtNode, str]]:
    """Move the second of `sides` to the first, remove the pairs that the bond replaces, return the new ones.

    pairs: list of [node, "node/node"] or ["node/node", node], the first of each in the first structure. A new
    pair is (node, node, place in the file).
    """
    if not isinstance(pairs, list) or len(pairs) < _FEWEST:
        problem = "a node_edge bond of fewer than three pairs"
        allowed = "a list of three or more [node, node/node]"
        value = len(pairs) if isinstance(pairs, list) else None
        raise InvalidValueError(problem, where=where, given=value, allowed=allowed)
    bond = _read(sides, pairs, where)
    _move(sides[1], np.array(bond.points[0]), np.array(bond.points[1]), where)
    _remove_pairs(sides, bond, is_rod, where)
    return [
        new
        for number, (node, (start, end)) in enumerate(zip(bond.nodes, bond.edges, strict=True))
        for new in ((start, node, f"{where}[{number}]"), (node, end, f"{where}[{number}]"))
    ]


def _read(sides: tuple[NtrtStructure, NtrtStructure], pairs: Sequence[Any], where: str) -> _Bond:
    bond = _Bond()
    for number, value in enumerate(pairs):
        location = f"{where}[{number}]"
        names = parse_pair(value, location)
        if sum("/" in name for name in names) != 1:
            problem = "not a bond of a node and an edge"
            allowed = "one node and one edge: [node, node/node] or [node/node, node]"
            raise InvalidValueError(problem, where=location, given=f"{names[0]}, {names[1]}", allowed=allowed)
        for structure, name, points in zip(sides, names, bond.points, strict=True):
            ends = [structure.find_node(node_name, location) for node_name in name.split("/", 1)]
            points.append(np.mean([node.position for node in ends], axis=0))
            if len(ends) == 1:
                bond.nodes.append(ends[0])
            else:
                bond.edges.append((ends[0], ends[1]))
    return bond


def _move(child: NtrtStructure, target: FloatArray, points: FloatArray, where: str) -> None:
    """Move `child` so that its `points` (n, 3) come to lie at `target` (n, 3), as the toolkit does it."""
    normals = [_normal(side, where) for side in (points, target)]
    rotation = _turn(normals[0], normals[1], points[1] - points[0])
    middle, center = points.mean(axis=0), target.mean(axis=0)
    arms = (rotation @ (points[0] - middle), target[0] - center)
    if not all(np.linalg.norm(arm) > 0 for arm in arms):
        problem = "the first point of the bond is the centroid of all its points, so no direction is stated"
        allowed = "a first pair away from the centroid"
        raise StructureError(problem, where=where, allowed=allowed, hint="put another pair first")
    turn = _turn(arms[0], arms[1], normals[1]) @ rotation
    child.transform(lambda point: center + turn @ (point - middle))


def _normal(points: FloatArray, where: str) -> FloatArray:
    """Return the unit normal of the plane through the first three points."""
    edge, second_edge = points[1] - points[0], points[2] - points[0]
    normal: FloatArray = np.cross(edge, second_edge)
    length = float(np.linalg.norm(normal))
    if not length > _ON_A_LINE * float(np.linalg.norm(edge) * np.linalg.norm(second_edge)):
        problem = "the first three points of the bond lie on a line, so no plane is stated"
        allowed = "three points that span a triangle, in both structures"
        raise StructureError(problem, where=where, allowed=allowed, hint="put another pair first")
    return normal / length


def _turn(start: FloatArray, end: FloatArray, fallback: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) of `start` into the direction of `end`; fallback: axis of opposite ones."""
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(a, b)
    angle = math.atan2(float(np.linalg.norm(axis)), float(a @ b))
    if np.linalg.norm(a + b) < _OPPOSITE:
        axis, angle = fallback, math.pi
    length = float(np.linalg.norm(axis))
    if length == 0:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned: FloatArray = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
    return turned


def _remove_pairs(sides: tuple[NtrtStructure, NtrtStructure], bond: _Bond, is_rod: IsRod, where: str) -> None:
    """Remove the edges of the bond and the cables between its nodes from both structures."""
    edges = {_places(ends) for ends in bond.edges}
    nodes = {_locate(node) for node in bond.nodes}
    for structure in (tree for side in sides for tree in side.walk()):
        remaining_pairs = []
        for pair in structure.pairs:
            ends = _places(pair.ends)
            if ends not in edges and not ends <= nodes:
                remaining_pairs.append(pair)
            elif is_rod(pair, structure.name):
                if ends in edges:
                    problem = "the edge of a node_edge bond is a rod"
                    value = f"{pair.ends[0].path}/{pair.ends[1].path}"
                    allowed = "edges that are cables: the bond replaces each by two"
                    raise StructureError(problem, where=where, given=value, allowed=allowed)
                remaining_pairs.append(pair)
        structure.pairs[:] = remaining_pairs


def _locate(node: NtrtNode) -> tuple[float, ...]:
    return tuple(node.position.tolist())


def _places(ends: tuple[NtrtNode, NtrtNode]) -> frozenset[tuple[float, ...]]:
    return frozenset(_locate(node) for node in ends)


_MAX_STRUCTURES = 2_000
_MAX_NODES = 20_000
_MAX_PAIRS = 50_000
_MAX_BUILDERS = 200
_DEEPEST = 50  # files within files
_ATTRIBUTES = ("path", "rotation", "translation", "scale", "offset")
_SUFFIXES = (".yaml", ".yml")


class _Loading:
    """State while the files of one structure are read."""

    def __init__(self, builders: BuilderBook) -> None:
        self.builders = builders
        self.files: dict[Path, dict[str, Any]] = {}
        self.open: list[Path] = []
        self.n_structures = 0
        self.n_nodes = 0
        self.n_pairs = 0

    def check(self, path: Path) -> None:
        """Raise StructureError if all that was read so far is beyond reason."""
        for kind, count, limit in (
            ("substructures", self.n_structures, _MAX_STRUCTURES),
            ("nodes", self.n_nodes, _MAX_NODES),
            ("pairs", self.n_pairs, _MAX_PAIRS),
            ("builders", len(self.builders), _MAX_BUILDERS),
            ("levels of files", len(self.open), _DEEPEST),
        ):
            if count > limit:
                problem, allowed = "too many substructures", f"up to {limit} {kind}"
                raise StructureError(problem, where=str(path), given=f"{count} {kind}", allowed=allowed)


def load_structure(path: Path, builders: BuilderBook) -> NtrtStructure:
    """Return the tree of structures of a file and its substructures; adds their builders, children first."""
    structure = NtrtStructure("", "")
    with np.errstate(all="ignore"):  # values that are not finite are refused below
        _build(structure, path, _Loading(builders))
    for owner in structure.walk():
        for node in owner.nodes.values():
            if not np.isfinite(node.position).all():
                problem = "the position of a node is not finite once its structures are placed"
                allowed = "scales and translations that keep positions finite"
                raise NonFiniteError(problem, where=str(path), given=node.path, allowed=allowed)
    return structure


def _build(structure: NtrtStructure, path: Path, loading: _Loading) -> None:
    real = path.resolve()
    if real in loading.open:
        raise StructureError(
            "the file is a substructure of itself",
            where=str(path),
            given=" -> ".join(file.name for file in [*loading.open, real]),
            allowed="substructures that end somewhere",
        )
    if real not in loading.files:
        loading.files[real] = read_yaml(path)
    root = loading.files[real]
    loading.n_structures += 1
    loading.open.append(real)
    loading.check(path)
    _add_children(structure, read_table(root.get("substructures"), f"{path}: substructures"), path, loading)
    loading.open.pop()
    loading.builders.add(read_table(root.get("builders"), f"{path}: builders"), f"{path}: builders")
    nodes = read_table(root.get("nodes"), f"{path}: nodes")
    loading.n_nodes += len(nodes)
    loading.n_pairs += _count_pairs(root.get("pair_groups")) + _count_pairs(root.get("bond_groups"))
    loading.check(path)
    for name, value in nodes.items():
        position = np.array(parse_vector(value, f"{path}: nodes.{name}"))
        structure.nodes[name] = NtrtNode(_join(structure.path, name), position)
    where = f"{path}: pair_groups"
    for tags, pairs in read_table(root.get("pair_groups"), where).items():
        _add_pairs(structure, (structure, structure), tags, pairs, (), f"{where}.{tags}")
    _add_bond_groups(structure, root.get("bond_groups"), loading.builders, f"{path}: bond_groups")


def _count_pairs(groups: Any) -> int:
    """Return how many pairs a section of groups states, bonds between several structures counted so often."""
    if isinstance(groups, list):
        return len(groups)
    if not isinstance(groups, dict):
        return 0
    return sum(max(key.count("/") - 1, 1) * _count_pairs(group) for key, group in groups.items())


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _add_children(structure: NtrtStructure, entries: dict[str, Any], path: Path, loading: _Loading) -> None:
    rows: list[tuple[list[str], dict[str, Any], str]] = []
    for key, value in entries.items():
        where = f"{path}: substructures.{key}"
        attributes = read_table(value, where)
        check_keys(attributes, _ATTRIBUTES, where)
        names = key.split("/")
        if not all(names) or any("." in name for name in names):
            problem = "not a list of names"
            raise InvalidValueError(problem, where=where, given=key, allowed="name or name/name/...")
        rows.append((names, attributes, where))
    for names, attributes, where in rows:
        if "path" in attributes:
            for name in names:
                file = _child_path(path, attributes["path"], where)
                if name in structure.children:
                    raise DuplicateNameError("two substructures under one name", where=where, given=name)
                child = NtrtStructure(name, _join(structure.path, name))
                _build(child, file, loading)
                structure.children[name] = child
    for names, attributes, where in rows:
        for name in names:
            child = structure.find_child(name, where)
            if "rotation" in attributes:
                _rotate(child, read_table(attributes["rotation"], f"{where}.rotation"), f"{where}.rotation")
    for names, attributes, where in rows:
        for position, name in enumerate(names):
            _place(structure.find_child(name, where), position, attributes, where)


def _child_path(path: Path, value: Any, where: str) -> Path:
    """Return the file of a substructure: relative to the file that names it, YAML only."""
    if not isinstance(value, str) or not value or "\0" in value or Path(value).is_absolute():
        problem = "not a path that a substructure may have"
        allowed = "a relative path to a .yaml file; .. is fine"
        raise InvalidValueError(
            problem, where=f"{where}.path", given=value if isinstance(value, str) else None, allowed=allowed
        )
    child = path.parent / value
    if child.suffix.lower() not in _SUFFIXES or not child.is_file():
        problem = "no YAML file at the path of this substructure"
        allowed = f"a {' or '.join(_SUFFIXES)} file, relative to {path.name}"
        hint = "copy the files that the structure refers to as well, in their folders"
        raise SceneError(problem, where=f"{where}.path", given=value, allowed=allowed, hint=hint)
    return child


def _rotate(child: NtrtStructure, rotation: dict[str, Any], where: str) -> None:
    """Turn `child` about an axis through the reference point, else through its centroid; angle in degrees."""
    check_keys(rotation, ("reference", "axis", "angle"), where)
    for key in ("axis", "angle"):
        if key not in rotation:
            problem = f"a rotation needs its {key}"
            raise InvalidValueError(problem, where=where, allowed="axis and angle [deg]")
    axis = np.array(parse_vector(rotation["axis"], f"{where}.axis"))
    if not axis.any():
        raise InvalidValueError("the axis has no direction", where=f"{where}.axis", given=axis.tolist())
    axis /= np.linalg.norm(axis)
    angle = math.radians(parse_number(rotation["angle"], f"{where}.angle"))
    if "reference" in rotation:
        center = np.array(parse_vector(rotation["reference"], f"{where}.reference"))
    else:
        center = child.centroid(where)

    def turn(point: NDArray[np.float64]) -> NDArray[np.float64]:
        arm = point - center
        along = axis * (axis @ arm)
        turned: NDArray[np.float64] = (
            center + along + (arm - along) * math.cos(angle) + np.cross(axis, arm) * math.sin(angle)
        )
        return turned

    child.transform(turn)


def _place(child: NtrtStructure, place: int, attributes: dict[str, Any], where: str) -> None:
    """Scale about the centroid, then move by `place` times the offset, then by the translation."""
    if "scale" in attributes:
        factor, center = parse_number(attributes["scale"], f"{where}.scale"), child.centroid(where)
        if not factor > 0:
            problem = "the scale is out of range"
            raise InvalidValueError(problem, where=f"{where}.scale", given=factor, allowed="greater than 0")
        child.transform(lambda point: center + (point - center) * factor)
    if "offset" in attributes:
        offset = np.array(parse_vector(attributes["offset"], f"{where}.offset")) * place
        child.transform(lambda point: point + offset)
    if "translation" in attributes:
        shift = np.array(parse_vector(attributes["translation"], f"{where}.translation"))
        child.transform(lambda point: point + shift)


def _add_pairs(
    owner: NtrtStructure,
    sides: tuple[NtrtStructure, NtrtStructure],
    tags: str,
    pairs: Any,
    more_tags: Sequence[str],
    where: str,
) -> None:
    all_tags = frozenset([*tags.split(), *more_tags])
    stem = _stem(owner, (*tags.split(), *more_tags[:2]))
    if pairs in (None, ""):
        return
    if not isinstance(pairs, list):
        raise InvalidValueError("not a list of pairs", where=where, allowed="a list of [node, node]")
    for number, value in enumerate(pairs):
        location = f"{where}[{number}]"
        names = parse_pair(value, location)
        ends = (sides[0].find_node(names[0], location), sides[1].find_node(names[1], location))
        owner.pairs.append(NtrtPair(ends, all_tags, stem, location))


def _add_bond_groups(structure: NtrtStructure, groups: Any, builders: BuilderBook, where: str) -> None:
    """Add bonds a/b/.../node_node and a/b/.../node_edge; tags hold bonds or bonds hold tags."""
    for outer_key, inner in read_table(groups, where).items():
        for inner_key, pairs in read_table(inner, f"{where}.{outer_key}").items():
            location = f"{where}.{outer_key}.{inner_key}"
            if ("/" in outer_key) == ("/" in inner_key):
                problem = "bonds and tags are not nested in one another"
                allowed = "tag: {a/b/node_node: [...]} or a/b/node_node: {tag: [...]}"
                raise InvalidValueError(problem, where=location, allowed=allowed)
            bonds, tags = (outer_key, inner_key) if "/" in outer_key else (inner_key, outer_key)
            _add_bonds(structure, bonds, tags, pairs, builders, location)


def _add_bonds(
    structure: NtrtStructure, bonds: str, tags: str, pairs: Any, builders: BuilderBook, where: str
) -> None:
    *names, kind = bonds.split("/")
    if kind not in ("node_node", "node_edge") or len(names) < 2:
        allowed = "child/child/.../node_node or child/child/.../node_edge"
        raise InvalidValueError("not a bond between substructures", where=where, given=bonds, allowed=allowed)
    for start, end in itertools.pairwise(names):
        sides = (structure.find_child(start, where), structure.find_child(end, where))
        if kind == "node_node":
            _add_pairs(structure, sides, tags, pairs, (start, end, f"{start}/{end}"), where)
        elif pairs not in (None, ""):
            stem = _stem(structure, (*tags.split(), start, end))
            for start_node, end_node, location in bond_nodes_to_edges(sides, pairs, builders.is_rod, where):
                structure.pairs.append(
                    NtrtPair((start_node, end_node), frozenset(tags.split()), stem, location)
                )


def _stem(owner: NtrtStructure, words: Sequence[str]) -> str:
    """Return the first part of the names of members that a group of pairs makes."""
    return "_".join([*owner.path.split("."), *words]).lstrip("_")
