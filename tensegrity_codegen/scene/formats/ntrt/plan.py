"""The members of a scene from the pairs and nodes of an NTRT structure: rods, cables, spheres, rigid bodies.

Rods that share points, directly or through others, move as one; bracing bars keep the shape of such a body.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.imported import NameBook
from tensegrity_codegen.scene.formats.ntrt.structure import (
    BuilderBook,
    NtrtBuilder,
    NtrtNode,
    NtrtPair,
    NtrtStructure,
)
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, StructureError
from tensegrity_codegen.system.summaries import describe_count

Position = tuple[float, float, float]
Pair = tuple[Position, Position]

# Parts of a bar's direction that the bars before it leave free, for three rounds of choosing.
_INDEPENDENT = (0.1, 1e-3, 1e-6)


def find_bodies(rods: Sequence[Pair], points: Iterable[Position] = ()) -> list[list[Position]]:
    """Return the points of each rigid body, bodies and points in the order of the rods, then of `points`."""
    parent: dict[Position, Position] = {}

    def root(point: Position) -> Position:
        parent.setdefault(point, point)
        while parent[point] != point:
            parent[point] = parent[parent[point]]
            point = parent[point]
        return point

    for start, end in rods:
        parent[root(end)] = root(start)
    for point in points:
        root(point)
    bodies: dict[Position, list[Position]] = {}
    for point in list(parent):
        bodies.setdefault(root(point), []).append(point)
    return list(bodies.values())


def is_flat(points: NDArray[np.float64]) -> bool:
    """Return whether more than three points (n, 3) lie in a plane, or three on a line."""
    return find_dimension(points) < min(3, len(points) - 1)


def find_dimension(points: NDArray[np.float64]) -> int:
    """Return the dimension of the span of points (n, 3): 0 a point, 1 a line, 2 a plane, 3 space."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return int(np.sum(spread > 1e-9 * spread[0]))


def find_rigid_pairs(points: Sequence[Position], rods: Sequence[Pair]) -> list[Pair]:
    """Return pairs of `points` that bars of fixed length can join, so that none follows from the others.

    Rods come first, then other pairs, until the body keeps its shape to first order (a flat one: in its
    plane) or no pair is left. A rod that is not among them follows from the others.
    """
    row = {point: number for number, point in enumerate(points)}
    position = np.array(points, dtype=np.float64)
    joined = {frozenset(rod) for rod in rods}
    unjoined = [pair for pair in itertools.combinations(points, 2) if frozenset(pair) not in joined]
    dimension = find_dimension(position)
    max_count = dimension * len(points) - dimension * (dimension + 1) // 2
    basis = np.zeros((0, 3 * len(points)))
    pairs: dict[Pair, None] = {}
    for min_size, pair in itertools.product(_INDEPENDENT, (*rods, *unjoined)):
        if len(pairs) == max_count:
            break
        if pair in pairs:
            continue
        direction = _direction(position, row[pair[0]], row[pair[1]])
        for _ in range(2):  # twice is enough
            direction = direction - basis.T @ (basis @ direction)
        size = float(np.linalg.norm(direction))
        if size > min_size:
            basis = np.vstack([basis, direction / size])
            pairs[pair] = None
    return list(pairs)


def _direction(place: NDArray[np.float64], i: int, j: int) -> NDArray[np.float64]:
    """Return the unit change of all coordinates (3 n,) that lengthens the pair most."""
    arm = place[i] - place[j]
    direction = np.zeros(place.shape)
    direction[i], direction[j] = arm, -arm
    unit: NDArray[np.float64] = (direction / np.linalg.norm(direction)).ravel()
    return unit


@dataclass(frozen=True)
class Built:
    """A pair that became a rod or a cable; its ends are positions, by which the toolkit tells nodes apart."""

    pair: NtrtPair
    builder: NtrtBuilder
    ends: tuple[Position, Position]

    @property
    def length(self) -> float:
        """Distance of the ends, in the file's unit."""
        return math.dist(*self.ends)


_MAX_POINTS = 100  # of one rigid body
_MAX_BRACES = 50_000


@dataclass(frozen=True)
class Sphere:
    """A node that became a sphere; here a point mass."""

    builder: NtrtBuilder
    center: Position

    @property
    def mass(self) -> float:
        """Mass, in the file's unit."""
        return self.builder.values["density"] * 4 / 3 * math.pi * self.builder.values["radius"] ** 3


@dataclass
class Plan:
    """The rods, cables, spheres and bodies of a structure, and the notes on it so far."""

    rods: list[Built] = field(default_factory=list)
    cables: list[Built] = field(default_factory=list)
    spheres: list[Sphere] = field(default_factory=list)
    bodies: list[list[Position]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def find_held(self) -> set[Position]:
        """Return the nodes of bodies without mass, which stand still in the toolkit."""
        heavy = {point for rod in self.rods if rod.builder.values["density"] for point in rod.ends}
        heavy |= {sphere.center for sphere in self.spheres if sphere.mass}
        return {point for body in self.bodies if heavy.isdisjoint(body) for point in body}


def find_position(node: NtrtNode) -> Position:
    """Return a node's position as a key: minus zero is zero."""
    x, y, z = (value + 0.0 for value in node.position.tolist())
    return x, y, z


def make_plan(structure: NtrtStructure, builders: BuilderBook, where: str) -> Plan:
    """Sort all pairs into rods and cables, nodes into spheres, and rods and spheres into rigid bodies."""
    plan, unbuilt = Plan(), 0
    for owner in structure.walk():
        for node in owner.nodes.values():
            name = node.path.rpartition(".")[2]
            sphere = builders.find_sphere(name, owner.name)
            if sphere is not None:
                plan.spheres.append(Sphere(sphere, find_position(node)))
        for pair in owner.pairs:
            builder = builders.find(pair, owner.name)
            if builder is None:
                unbuilt += 1
                continue
            built = Built(pair, builder, (find_position(pair.ends[0]), find_position(pair.ends[1])))
            if built.ends[0] == built.ends[1]:
                problem = "the pair joins a point to itself"
                raise StructureError(problem, where=pair.where, given=pair.ends[0].path)
            (plan.rods if builder.kind == "rod" else plan.cables).append(built)
    if not plan.rods and not plan.cables:
        problem = "the file defines no rod and no cable"
        raise StructureError(problem, where=where, allowed="pairs of nodes whose tags match a builder")
    if unbuilt:
        plan.notes.append(f"{describe_count(unbuilt, 'pair')} without a builder left out, as in the toolkit")
    plan.bodies = find_bodies([rod.ends for rod in plan.rods], [sphere.center for sphere in plan.spheres])
    largest = max(map(len, plan.bodies), default=0)
    braces = sum(len(points) * (len(points) - 1) // 2 for points in plan.bodies)
    if largest > _MAX_POINTS or braces > _MAX_BRACES:
        problem = "too many points on rigid bodies: bars between all points of a body keep its shape"
        allowed = f"up to {_MAX_POINTS} points on one body, {_MAX_BRACES} bars"
        value = f"{largest} points on one body, {braces} bars in all"
        raise StructureError(problem, where=where, given=value, allowed=allowed)
    _drop_inner_cables(plan)
    _check_pairs(plan)
    return plan


def _drop_inner_cables(plan: Plan) -> None:
    """Leave out cables within one rigid body: they act on nothing; raise for ends that are on no body."""
    body = {point: number for number, points in enumerate(plan.bodies) for point in points}
    outer_cables = []
    for cable in plan.cables:
        for point, node in zip(cable.ends, cable.pair.ends, strict=True):
            if point not in body:
                problem, allowed = "a cable ends where no rod is", "cables between ends of rods, or spheres"
                raise StructureError(problem, where=cable.pair.where, given=node.path, allowed=allowed)
        if body[cable.ends[0]] != body[cable.ends[1]]:
            outer_cables.append(cable)
    if len(outer_cables) < len(plan.cables):
        count = len(plan.cables) - len(outer_cables)
        plan.notes.append(
            f"{describe_count(count, 'cable')} between points of one rigid body left out: no effect"
        )
    plan.cables = outer_cables


def _check_pairs(plan: Plan) -> None:
    seen: dict[frozenset[Position], Built] = {}
    for built in (*plan.rods, *plan.cables):
        earlier = seen.setdefault(frozenset(built.ends), built)
        if earlier is not built:
            problem = "two pairs join the same two points"
            value = f"{built.pair.ends[0].path} and {built.pair.ends[1].path}"
            allowed = f"one pair ({earlier.pair.where} joins them too)"
            raise DuplicateNameError(problem, where=built.pair.where, given=value, allowed=allowed)


_DEFAULT_STIFFNESS = 1000.0  # of a cable in the toolkit, where a structure has none
_BRACE = ""  # key of the bracing bars among builder keys


@dataclass(frozen=True)
class Conversion:
    """Stiffness of bars over cables, metres per length unit, whether rods are rigid, pretension factor."""

    ratio: float
    scale: float
    rigid: bool
    pretension: float


class _Bars:
    """Which bars keep each body's shape, and which of them are rigid."""

    def __init__(self, plan: Plan, conversion: Conversion) -> None:
        stiffest = max((cable.builder.values["stiffness"] for cable in plan.cables), default=0.0)
        self.rigid = conversion.rigid or not stiffest
        self.spring_constant = conversion.ratio * (stiffest or _DEFAULT_STIFFNESS)
        self.braces: list[tuple[Position, Position]] = []
        self.springs: set[frozenset[Position]] = set()  # rods that are springs where others are rigid
        held = plan.find_held()
        rods: dict[Position, list[tuple[Position, Position]]] = {}
        owner = {point: body[0] for body in plan.bodies for point in body}
        for rod in plan.rods:
            rods.setdefault(owner[rod.ends[0]], []).append(rod.ends)
        for body in plan.bodies:
            self._add_body(body, rods.get(body[0], []), anchored=body[0] in held)

    def _add_body(
        self, points: list[Position], rods: list[tuple[Position, Position]], *, anchored: bool
    ) -> None:
        joined = {frozenset(rod) for rod in rods}
        if not self.rigid:
            pairs = itertools.combinations(points, 2)
            self.braces += [pair for pair in pairs if frozenset(pair) not in joined]
            return
        rigid_pairs = [] if anchored else find_rigid_pairs(points, rods)
        self.braces += [pair for pair in rigid_pairs if frozenset(pair) not in joined]
        self.springs |= joined - {frozenset(pair) for pair in rigid_pairs}


def write_document(structure: NtrtStructure, plan: Plan, conversion: Conversion) -> dict[str, Any]:
    """Return classes, nodes and members of the scene; adds to the plan's notes."""
    names = _name_nodes(structure, plan)
    bars = _Bars(plan, conversion)
    classes, class_names = _write_classes(plan, bars, conversion.scale)
    members: dict[str, dict[str, Any]] = {}
    book = NameBook("m", reserved=classes)
    counts: dict[str, int] = {}

    def add(stem: str, class_name: str, ends: Sequence[Position], **values: float) -> None:
        counts[stem] = counts.get(stem, 0) + 1
        member = {"class": class_name, "nodes": [names[point] for point in ends], **values}
        members[book.add(f"{stem}_{counts[stem]}")] = member

    for rod in plan.rods:
        spring = {"spring_constant": bars.spring_constant} if frozenset(rod.ends) in bars.springs else {}
        add(rod.pair.stem, class_names[rod.builder.key], rod.ends, **spring)
    for ends in bars.braces:
        add("brace", class_names[_BRACE], ends)
    for cable in plan.cables:
        rest_length = conversion.scale * _rest_length(cable, conversion.pretension)
        add(cable.pair.stem, class_names[cable.builder.key], cable.ends, rest_length=rest_length)
    plan.notes += [*book.notes("members were"), *_note_physics(plan, bars, conversion)]
    return {"classes": classes, "nodes": _write_nodes(plan, names, conversion.scale), "members": members}


def _name_nodes(structure: NtrtStructure, plan: Plan) -> dict[Position, str]:
    """Return scene names by position, in the order of the tree; nodes at one place are one."""
    used = {point for body in plan.bodies for point in body}
    book, names, merged, unused = NameBook("n"), {}, 0, 0
    for owner in structure.walk():
        for node in owner.nodes.values():
            point = find_position(node)
            if point not in used:
                unused += 1
            elif point in names:
                merged += 1
            else:
                names[point] = book.add(node.path.replace(".", "_"))
    if unused:
        plan.notes.append(f"{describe_count(unused, 'node')} of no rod or cable left out")
    if merged:
        plan.notes.append(
            f"{describe_count(merged, 'node')} exactly on another one made one with it, as in the toolkit"
        )
    plan.notes += book.notes("nodes were")
    return names


def _write_nodes(plan: Plan, names: dict[Position, str], scale: float) -> dict[str, dict[str, Any]]:
    held = plan.find_held()
    mass: dict[Position, float] = {}
    for sphere in plan.spheres:
        mass[sphere.center] = mass.get(sphere.center, 0.0) + sphere.mass
    nodes: dict[str, dict[str, Any]] = {}
    for point, name in names.items():
        nodes[name] = {"position": [scale * value for value in point]}
        if mass.get(point):
            nodes[name]["mass"] = mass[point]
        if point in held:
            nodes[name]["anchored"] = True
    return nodes


def _write_classes(plan: Plan, bars: _Bars, scale: float) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Return the member classes, and their names by builder key ("" for the bracing bars)."""
    book, classes, by_key = NameBook("c"), {}, {}
    stiffness = {} if bars.rigid else {"spring_constant": bars.spring_constant}
    for built in (*plan.rods, *plan.cables):
        key, values = built.builder.key, built.builder.values
        if key in by_key:
            continue
        by_key[key] = book.add(key)
        if built.builder.kind == "rod":
            mass = {"density": values["density"] / scale**3} if values["density"] else {}
            row = {"kind": "bar", **stiffness, **mass, "radius": values["radius"] * scale}
        else:
            row = {"kind": "cable", "spring_constant": values["stiffness"]}
            row |= {"damping": values["damping"]} if values["damping"] else {}
        classes[by_key[key]] = row
    if bars.braces:
        by_key[_BRACE] = book.add("brace")
        classes[by_key[_BRACE]] = {"kind": "bar", **stiffness}
    plan.notes += book.notes("classes were")
    return classes, by_key


def _rest_length(cable: Built, scale: float) -> float:
    stiffness, pretension = cable.builder.values["stiffness"], scale * cable.builder.values["pretension"]
    rest_length = cable.length - pretension / stiffness
    if not rest_length > 0:
        max_pretension = stiffness * cable.length
        raise InvalidValueError(
            "the pretension shortens the cable to nothing",
            where=cable.pair.where,
            given=f"pretension {pretension:g}, stiffness {stiffness:g}",
            allowed=f"a pretension below stiffness * length = {max_pretension:g}",
            hint=f"the toolkit refuses it too: lower the pretension in the builder {cable.builder.key!r}, or "
            f"try `pretension_scale={0.95 * scale * max_pretension / pretension:.2g}`",
        )
    return rest_length


def _note_physics(plan: Plan, bars: _Bars, conversion: Conversion) -> list[str]:
    """Return notes on differences to the toolkit's physics."""
    notes = _note_bars(plan, bars, conversion)
    held = plan.find_held()
    if held:
        notes.append(f"{len(held)} nodes belong to bodies without mass, which stand still: they are anchored")
    if plan.spheres:
        notes.append(
            f"{len(plan.spheres)} spheres are point masses at their centres, "
            f"{math.fsum(sphere.mass for sphere in plan.spheres):.3g} in all: their own rotation is left out"
        )
    if plan.cables:
        notes.append("cables end on the axes of the rods; the toolkit moves their ends to the rods' surface")
    builders = [built.builder for built in (*plan.rods, *plan.cables)]
    builders += [sphere.builder for sphere in plan.spheres]
    used = {builder.key: builder for builder in builders}.values()
    ignored = sorted({name for builder in used for name in builder.ignored})
    if ignored:
        notes.append(f"parameters without a meaning here are left out: {', '.join(ignored)}")
    motors = sorted({built.class_name for built in used if built.kind == "cable"} - {"tgBasicActuatorInfo"})
    if motors:
        notes.append(f"{', '.join(motors)}: imported as plain cables, without motor and contact")
    return notes


def _note_bars(plan: Plan, bars: _Bars, conversion: Conversion) -> list[str]:
    """Return notes on the stiffness of bars and the shape of bodies."""
    notes = []
    if conversion.rigid and plan.rods:
        notes.append("rods are rigid bars, as in the toolkit")
    elif bars.rigid and plan.rods:
        notes.append("there are no cables to scale the bars' stiffness by: the bars are rigid")
    elif plan.rods:
        notes.append(
            f"rods are rigid in the toolkit; here bars have {conversion.ratio:g} times the stiffest cable's "
            "constant (`rigid=True` makes them rigid)"
        )
    compounds = [points for points in plan.bodies if len(points) > 2]
    if compounds:
        notes.append(
            f"{len(compounds)} groups of rods that share nodes are rigid bodies in the toolkit; here "
            f"{len(bars.braces)} massless bracing bars keep their shape"
        )
    if bars.springs:
        notes.append(
            f"{len(bars.springs)} rods hold nothing that rigid bars do not hold already: they are springs of "
            f"{bars.spring_constant:g}, which carry no force"
        )
    flat = sum(is_flat(np.array(points)) for points in compounds)
    if flat:
        notes.append(
            f"{flat} of these bodies lie in a plane: bracing bars do not hold them flat to first order"
        )
    return notes
