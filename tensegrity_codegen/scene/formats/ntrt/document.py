"""From the plan of an NTRT structure to classes, nodes and members of a scene, with notes on the physics."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.scene.formats.imported import NameBook
from tensegrity_codegen.scene.formats.ntrt.bodies import Position, find_rigid_pairs, is_flat
from tensegrity_codegen.scene.formats.ntrt.plan import Built, Plan, find_position
from tensegrity_codegen.scene.formats.ntrt.structure import NtrtStructure
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import describe_count

_DEFAULT_STIFFNESS = 1000.0  # of a cable in the toolkit, where a structure has none
_BRACE = ""  # key of the bracing bars among builder keys


@dataclass(frozen=True)
class Conversion:
    """ratio: stiffness of bars over that of cables; scale: metres per length unit; rigid: rods are.

    pretension: factor on all pretensions.
    """

    ratio: float
    scale: float
    rigid: bool
    pretension: float


class _Bars:
    """Which bars keep each body's shape, and which of them are rigid."""

    def __init__(self, plan: Plan, conversion: Conversion) -> None:
        stiffest = plan.find_stiffest()
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
        kept = [] if anchored else find_rigid_pairs(points, rods)
        self.braces += [pair for pair in kept if frozenset(pair) not in joined]
        self.springs |= joined - {frozenset(pair) for pair in kept}


def write_document(structure: NtrtStructure, plan: Plan, conversion: Conversion) -> dict[str, Any]:
    """Return classes, nodes and members of the scene; adds to the plan's notes.

    Raises InvalidValueError for a pretension that shortens a cable to nothing.
    """
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
        rest = conversion.scale * _rest_length(cable, conversion.pretension)
        add(cable.pair.stem, class_names[cable.builder.key], cable.ends, rest_length=rest)
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
    rest = cable.length - pretension / stiffness
    if not rest > 0:
        most = stiffness * cable.length
        raise InvalidValueError(
            "the pretension shortens the cable to nothing",
            where=cable.pair.where,
            given=f"pretension {pretension:g}, stiffness {stiffness:g}",
            allowed=f"a pretension below stiffness * length = {most:g}",
            hint=f"the toolkit refuses it too: lower the pretension in the builder {cable.builder.key!r}, or "
            f"try `pretension_scale={0.95 * scale * most / pretension:.2g}`",
        )
    return rest


def _note_physics(plan: Plan, bars: _Bars, conversion: Conversion) -> list[str]:
    """Return notes on what differs from the toolkit's physics."""
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
    builders = [item.builder for item in (*plan.rods, *plan.cables)]
    builders += [sphere.builder for sphere in plan.spheres]
    used = {builder.key: builder for builder in builders}.values()
    ignored = sorted({name for builder in used for name in builder.ignored})
    if ignored:
        notes.append(f"parameters without a meaning here are left out: {', '.join(ignored)}")
    motors = sorted({item.class_name for item in used if item.kind == "cable"} - {"tgBasicActuatorInfo"})
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
