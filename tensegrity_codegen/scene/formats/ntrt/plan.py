"""The parts of an NTRT structure by its pairs and nodes: rods, cables, spheres, rigid bodies of these."""

import math
from dataclasses import dataclass, field

from tensegrity_codegen.scene.formats.ntrt.bodies import Position, find_bodies
from tensegrity_codegen.scene.formats.ntrt.builders import BuilderBook, NtrtBuilder
from tensegrity_codegen.scene.formats.ntrt.structure import NtrtNode, NtrtPair, NtrtStructure
from tensegrity_codegen.system.errors import DuplicateNameError, StructureError
from tensegrity_codegen.system.summaries import describe_count


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


_MOST_POINTS = 100  # of one rigid body
_MOST_BRACES = 50_000


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

    def find_stiffest(self) -> float:
        """Return the largest spring constant of a cable [N/m], 0 where there is no cable."""
        return max((cable.builder.values["stiffness"] for cable in self.cables), default=0.0)


def find_position(node: NtrtNode) -> Position:
    """Return a node's position as a key: minus zero is zero."""
    x, y, z = (value + 0.0 for value in node.position.tolist())
    return x, y, z


def make_plan(structure: NtrtStructure, builders: BuilderBook, where: str) -> Plan:
    """Sort all pairs into rods and cables, nodes into spheres, and rods and spheres into rigid bodies.

    Raises StructureError or DuplicateNameError for what makes no structure.
    """
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
                raise StructureError(
                    "the pair joins a point to itself", where=pair.where, given=pair.ends[0].path
                )
            (plan.rods if builder.kind == "rod" else plan.cables).append(built)
    if not plan.rods and not plan.cables:
        problem = "the file defines no rod and no cable"
        raise StructureError(problem, where=where, allowed="pairs of nodes whose tags match a builder")
    if unbuilt:
        plan.notes.append(f"{describe_count(unbuilt, 'pair')} without a builder left out, as in the toolkit")
    plan.bodies = find_bodies([rod.ends for rod in plan.rods], [sphere.center for sphere in plan.spheres])
    largest = max(map(len, plan.bodies), default=0)
    braces = sum(len(points) * (len(points) - 1) // 2 for points in plan.bodies)
    if largest > _MOST_POINTS or braces > _MOST_BRACES:
        raise StructureError(
            "too many points on rigid bodies: bars between all points of a body keep its shape",
            where=where,
            given=f"{largest} points on one body, {braces} bars in all",
            allowed=f"up to {_MOST_POINTS} points on one body, {_MOST_BRACES} bars",
        )
    _drop_inner_cables(plan)
    _check_pairs(plan)
    return plan


def _drop_inner_cables(plan: Plan) -> None:
    """Leave out cables within one rigid body: they act on nothing; raise for ends that are on no body."""
    body = {point: number for number, points in enumerate(plan.bodies) for point in points}
    kept = []
    for cable in plan.cables:
        for point, node in zip(cable.ends, cable.pair.ends, strict=True):
            if point not in body:
                problem, allowed = "a cable ends where no rod is", "cables between ends of rods, or spheres"
                raise StructureError(problem, where=cable.pair.where, given=node.path, allowed=allowed)
        if body[cable.ends[0]] != body[cable.ends[1]]:
            kept.append(cable)
    if len(kept) < len(plan.cables):
        count = len(plan.cables) - len(kept)
        plan.notes.append(
            f"{describe_count(count, 'cable')} between points of one rigid body left out: no effect"
        )
    plan.cables = kept


def _check_pairs(plan: Plan) -> None:
    seen: dict[frozenset[Position], Built] = {}
    for built in (*plan.rods, *plan.cables):
        first = seen.setdefault(frozenset(built.ends), built)
        if first is not built:
            raise DuplicateNameError(
                "two pairs join the same two points",
                where=built.pair.where,
                given=f"{built.pair.ends[0].path} and {built.pair.ends[1].path}",
                allowed=f"one pair ({first.pair.where} joins them too)",
            )
