"""Import of a structure file of the NASA Tensegrity Robotics Toolkit (NTRT, YAML).

A rod becomes a bar of mass density * pi * radius^2 * length; rods are rigid there, here a bar is `ratio`
times as stiff as the stiffest cable. Rods that share nodes are one rigid body there, so here all nodes of
such a body are joined by massless bracing bars. A cable becomes a tension-only spring of rest length
length - pretension / stiffness. The coordinates of such files are seldom in equilibrium.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.errors import DuplicateNameError, InvalidValueError, StructureError
from tensegrity_codegen.scene.imported import ImportResult, NameBook, scene_name
from tensegrity_codegen.scene.ntrt_bodies import find_bodies, is_flat
from tensegrity_codegen.scene.ntrt_builders import BuilderBook, NtrtBuilder
from tensegrity_codegen.scene.ntrt_load import load_structure
from tensegrity_codegen.scene.ntrt_structure import NtrtNode, NtrtPair, NtrtStructure

__all__ = ["import_ntrt"]

Position = tuple[float, float, float]


@dataclass(frozen=True)
class _Built:
    """A pair that became a rod or a cable; its ends are positions, by which the toolkit tells nodes apart."""

    pair: NtrtPair
    builder: NtrtBuilder
    ends: tuple[Position, Position]

    @property
    def length(self) -> float:
        return math.dist(*self.ends)


@dataclass
class _Plan:
    """The rods, cables and bodies of a structure, and the notes on it so far."""

    rods: list[_Built] = field(default_factory=list)
    cables: list[_Built] = field(default_factory=list)
    bodies: list[list[Position]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def import_ntrt(
    path: str | Path,
    *,
    bar_stiffness_ratio: float = 1000.0,
    name: str | None = None,
    gravity: Sequence[float] | None = None,
    length_scale: float = 1.0,
) -> ImportResult:
    """Return the scene document of an NTRT structure file, and notes on what was changed or left out.

    bar_stiffness_ratio: spring constant of bars over that of the stiffest cable. name: the scene's name,
    else the file's stem. gravity (3,) [m/s2]. length_scale: metres per length unit of the file; units of
    mass and time stay, so stiffness and damping keep their numbers and forces scale like lengths.
    Raises SceneError or a subclass of it that names file and key.
    """
    for key, value in (("bar_stiffness_ratio", bar_stiffness_ratio), ("length_scale", length_scale)):
        if not (math.isfinite(value) and value > 0):
            raise InvalidValueError("the value is out of range", where=key, given=value, allowed="above 0")
    path = Path(path)
    title, notes = scene_name(name, path, "scene_")
    builders = BuilderBook()
    structure = load_structure(path, builders.add)
    plan = _plan(structure, builders, str(path))
    document: dict[str, Any] = {"name": title}
    if gravity is not None:
        document["gravity"] = [float(value) for value in gravity]
    document |= _write(structure, plan, bar_stiffness_ratio, length_scale)
    if length_scale != 1:
        plan.notes.append(f"lengths are scaled by {length_scale:g}; units of mass and time are the file's")
    return ImportResult(document, (*notes, *plan.notes))


def _plan(structure: NtrtStructure, builders: BuilderBook, where: str) -> _Plan:
    """Sort all pairs into rods and cables, and the rods into rigid bodies; check that they make sense."""
    plan, unbuilt = _Plan(), 0
    for owner in structure.walk():
        for pair in owner.pairs:
            builder = builders.find(pair, owner.name)
            if builder is None:
                unbuilt += 1
                continue
            built = _Built(pair, builder, (_position(pair.ends[0]), _position(pair.ends[1])))
            if built.ends[0] == built.ends[1]:
                raise StructureError(
                    "the pair joins a point to itself", where=pair.where, given=pair.ends[0].path
                )
            (plan.rods if builder.kind == "rod" else plan.cables).append(built)
    if not plan.rods and not plan.cables:
        raise StructureError(
            "the file makes no rod and no cable",
            where=where,
            allowed="pairs of nodes whose tags match a builder",
        )
    if unbuilt:
        plan.notes.append(f"{unbuilt} pairs match no builder and are left out, as in the toolkit")
    plan.bodies = find_bodies([rod.ends for rod in plan.rods])
    _drop_inner_cables(plan)
    _check_pairs(plan)
    return plan


def _position(node: NtrtNode) -> Position:
    x, y, z = (value + 0.0 for value in node.position.tolist())
    return x, y, z


def _drop_inner_cables(plan: _Plan) -> None:
    """Leave out cables within one rigid body: they act on nothing; raise for ends that are on no rod."""
    body = {point: number for number, points in enumerate(plan.bodies) for point in points}
    kept = []
    for cable in plan.cables:
        for point, node in zip(cable.ends, cable.pair.ends, strict=True):
            if point not in body:
                raise StructureError(
                    "a cable ends where no rod is",
                    where=cable.pair.where,
                    given=node.path,
                    allowed="cables between ends of rods",
                )
        if body[cable.ends[0]] != body[cable.ends[1]]:
            kept.append(cable)
    if len(kept) < len(plan.cables):
        count = len(plan.cables) - len(kept)
        plan.notes.append(f"{count} cables between points of one rigid body act on nothing and are left out")
    plan.cables = kept


def _check_pairs(plan: _Plan) -> None:
    seen: dict[frozenset[Position], _Built] = {}
    for built in (*plan.rods, *plan.cables):
        first = seen.setdefault(frozenset(built.ends), built)
        if first is not built:
            raise DuplicateNameError(
                "two pairs join the same two points",
                where=built.pair.where,
                given=f"{built.pair.ends[0].path} and {built.pair.ends[1].path}",
                allowed=f"one pair ({first.pair.where} joins them too)",
            )


def _write(structure: NtrtStructure, plan: _Plan, ratio: float, scale: float) -> dict[str, Any]:
    """Return classes, nodes and members of the scene; adds to the plan's notes."""
    names = _name_nodes(structure, plan)
    stiffest = max((cable.builder.values["stiffness"] for cable in plan.cables), default=0.0)
    classes, class_names = _write_classes(plan, ratio * stiffest, scale)
    members: dict[str, dict[str, Any]] = {}
    book = NameBook("m", reserved=classes)
    counts: dict[str, int] = {}

    def add(stem: str, class_name: str, ends: Sequence[Position], **values: float) -> None:
        counts[stem] = counts.get(stem, 0) + 1
        member = {"class": class_name, "nodes": [names[point] for point in ends], **values}
        members[book.add(f"{stem}_{counts[stem]}")] = member

    for rod in plan.rods:
        add(rod.pair.stem, class_names[rod.builder.key], rod.ends)
    joined = {frozenset(rod.ends) for rod in plan.rods}
    for points in plan.bodies:
        for ends in itertools.combinations(points, 2):
            if frozenset(ends) not in joined:
                add("brace", class_names[""], ends)
    for cable in plan.cables:
        rest = _rest_length(cable)
        add(cable.pair.stem, class_names[cable.builder.key], cable.ends, rest_length=scale * rest)
    held = _static_points(plan)
    nodes = {
        name: {"position": [scale * value for value in point]} | ({"anchored": True} if point in held else {})
        for point, name in names.items()
    }
    plan.notes += [*book.notes("members were"), *_note_physics(plan, ratio, stiffest, len(held), counts)]
    return {"classes": classes, "nodes": nodes, "members": members}


def _name_nodes(structure: NtrtStructure, plan: _Plan) -> dict[Position, str]:
    """Return scene names by position, in the order of the tree; nodes at one place are one."""
    used = {point for body in plan.bodies for point in body}
    book, names, merged, unused = NameBook("n"), {}, 0, 0
    for owner in structure.walk():
        for node in owner.nodes.values():
            point = _position(node)
            if point not in used:
                unused += 1
            elif point in names:
                merged += 1
            else:
                names[point] = book.add(node.path.replace(".", "_"))
    if unused:
        plan.notes.append(f"{unused} nodes belong to no rod or cable and are left out")
    if merged:
        plan.notes.append(f"{merged} nodes lie exactly on another one and are one with it, as in the toolkit")
    plan.notes += book.notes("nodes were")
    return names


def _write_classes(
    plan: _Plan, bar_stiffness: float, scale: float
) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Return the member classes, and their names by builder key ("" for the bracing bars)."""
    book, classes, by_key = NameBook("c"), {}, {}
    stiffness = {"spring_constant": bar_stiffness} if bar_stiffness else {}
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
    if any(len(points) > 2 for points in plan.bodies):
        by_key[""] = book.add("brace")
        classes[by_key[""]] = {"kind": "bar", **stiffness}
    plan.notes += book.notes("classes were")
    return classes, by_key


def _rest_length(cable: _Built) -> float:
    values = cable.builder.values
    rest = cable.length - values["pretension"] / values["stiffness"]
    if not rest > 0:
        raise InvalidValueError(
            "the pretension shortens the cable to nothing",
            where=cable.pair.where,
            given=f"pretension {values['pretension']:g}, stiffness {values['stiffness']:g}",
            allowed=f"a pretension below stiffness * length = {values['stiffness'] * cable.length:g}",
        )
    return rest


def _static_points(plan: _Plan) -> set[Position]:
    """Return the nodes of bodies without mass, which stand still in the toolkit."""
    heavy = {point for rod in plan.rods if rod.builder.values["density"] for point in rod.ends}
    return {point for body in plan.bodies if heavy.isdisjoint(body) for point in body}


def _note_physics(
    plan: _Plan, ratio: float, stiffest: float, n_held: int, counts: dict[str, int]
) -> list[str]:
    """Return notes on what differs from the toolkit's physics."""
    notes = []
    if stiffest and plan.rods:
        notes.append(
            f"rods are rigid in the toolkit; here bars have {ratio:g} times the stiffest cable's constant"
        )
    elif plan.rods:
        notes.append("there are no cables to scale the bars' stiffness by: the bars are rigid")
    compounds = [points for points in plan.bodies if len(points) > 2]
    if compounds:
        notes.append(
            f"{len(compounds)} groups of rods that share nodes are rigid bodies in the toolkit; here "
            f"{counts.get('brace', 0)} massless bracing bars keep their shape"
        )
    flat = sum(is_flat(np.array(points)) for points in compounds)
    if flat:
        notes.append(
            f"{flat} of these bodies lie in a plane: bracing bars do not hold them flat to first order"
        )
    if n_held:
        notes.append(f"{n_held} nodes belong to bodies without mass, which stand still: they are anchored")
    if plan.cables:
        notes.append("cables end on the axes of the rods; the toolkit moves their ends to the rods' surface")
    used = {built.builder.key: built.builder for built in (*plan.rods, *plan.cables)}.values()
    ignored = sorted({name for builder in used for name in builder.ignored})
    if ignored:
        notes.append(f"parameters without a meaning here are left out: {', '.join(ignored)}")
    motors = sorted({item.class_name for item in used} - {"tgRodInfo", "tgBasicActuatorInfo"})
    if motors:
        notes.append(f"{', '.join(motors)}: imported as plain cables, without motor and contact")
    return notes
