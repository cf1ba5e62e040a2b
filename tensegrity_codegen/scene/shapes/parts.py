"""Shared pieces of all shapes: their base model, their plain document, and the facet that they stand on."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag

from tensegrity_codegen.scene.names import NAME_PATTERN
from tensegrity_codegen.scene.shapes.selfstress import find_selfstress
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

FLAT = 1e-9  # of the size: nodes so near to the plane of a facet are in it


def turn_onto_facet(nodes: dict[str, dict[str, Any]], names: Sequence[str], where: str) -> None:
    """Turn the nodes of a document so that three of them lie at z = 0 about the origin, all others above."""
    for name in names:
        check_choice(name, list(nodes), "node", where)
    position = np.array([node["position"] for node in nodes.values()])
    corner, second, third = (np.array(nodes[name]["position"]) for name in names)
    normal, along = np.cross(second - corner, third - corner), second - corner
    size = float(np.ptp(position, axis=0).max())
    area = float(np.linalg.norm(normal))
    height = (position - corner) @ normal / max(area, 1e-300)
    if area <= FLAT * size**2 or height.min() < -FLAT * size < FLAT * size < height.max():
        problem = "not a facet of the shape"
        allowed = "three nodes that are not on a line, with all others on one side of their plane"
        hint = _name_facet(position, list(nodes), names)
        raise InvalidValueError(problem, where=where, given=", ".join(names), allowed=allowed, hint=hint)
    up = normal / area if height.max() > -height.min() else -normal / area
    x = along / np.linalg.norm(along)
    placed = (position - (corner + second + third) / 3) @ np.array([x, np.cross(up, x), up]).T
    for node, point in zip(nodes.values(), placed.tolist(), strict=True):
        node["position"] = point


def _name_facet(position: FloatArray, nodes: Sequence[str], names: Sequence[str]) -> str:
    """Return a facet of the hull in words, with as many of these names as any has; nothing if it is flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        facets = [[nodes[k] for k in sorted(facet)] for facet in ConvexHull(position).simplices]
    except (QhullError, ValueError):
        return ""
    return f"on_facet = {json.dumps(max(facets, key=lambda facet: len(set(facet) & set(names))))}"


Positive: TypeAlias = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Angle: TypeAlias = Annotated[float, Field(gt=-360, lt=360, allow_inf_nan=False)]
ClassName: TypeAlias = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Axes: TypeAlias = Literal["x", "y", "z", "xy", "xz", "yz", "xyz"]
Anchored: TypeAlias = Annotated[
    Annotated[bool, Tag("@flag")] | Annotated[Axes, Tag("@axes")],
    Discriminator(lambda value: "@axes" if isinstance(value, str) else "@flag"),
]
Point: TypeAlias = tuple[float, float, float]


class ShapeModel(BaseModel, ABC):
    """Base of the shape models: strict values, no unknown keys, frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, defer_build=True)

    node_mass: Positive | None = Field(None, description="Point mass of every node [kg]; bars add their own.")
    on_facet: Annotated[list[str], Field(min_length=3, max_length=3)] | None = Field(
        None,
        description="Three nodes: the shape is turned so that this facet of its hull lies at z = 0 about the "
        "origin, all other nodes above.",
    )

    @classmethod
    def kind_name(cls) -> str:
        """Return the word that `kind` must be for this shape."""
        return str(cls.model_fields["kind"].default)

    @abstractmethod
    def expand(self, where: str) -> dict[str, Any]:
        """Return the nodes, members and groups of the shape as a plain document."""


class Parts:
    """Nodes, members and groups while a shape is put together."""

    def __init__(self, node_mass: float | None) -> None:
        self.node_mass = node_mass
        self.nodes: dict[str, dict[str, Any]] = {}
        self.members: dict[str, dict[str, Any]] = {}
        self.groups: dict[str, list[str]] = {"bars": [], "cables": []}

    def add_node(self, name: str, position: Point, *, anchored: bool | str = False) -> None:
        """Add one node at `position` [m], anchored on all axes (true) or on the named ones."""
        node: dict[str, Any] = {"position": list(position)}
        if self.node_mass is not None:
            node["mass"] = self.node_mass
        if anchored:
            node["anchored"] = anchored
        self.nodes[name] = node

    def add_bar(self, name: str, class_name: str, ends: Sequence[str]) -> None:
        """Add one bar to the members and to the group `bars`."""
        self._add(name, class_name, ends, "bars")

    def add_cable(self, name: str, class_name: str, ends: Sequence[str], group: str = "") -> None:
        """Add one cable to the members, to the group `cables` and to its own `group`."""
        self._add(name, class_name, ends, "cables")
        if group:
            self.groups.setdefault(group, []).append(name)

    def _add(self, name: str, class_name: str, ends: Sequence[str], group: str) -> None:
        self.members[name] = {"class": class_name, "nodes": list(ends)}
        self.groups[group].append(name)

    def geometry(self) -> tuple[list[Point], list[tuple[int, int]], list[bool]]:
        """Return node positions, node index pairs of the members, and which members are bars."""
        index = {name: number for number, name in enumerate(self.nodes)}
        points: list[Point] = [
            (node["position"][0], node["position"][1], node["position"][2]) for node in self.nodes.values()
        ]
        pairs = [(index[m["nodes"][0]], index[m["nodes"][1]]) for m in self.members.values()]
        bars = set(self.groups["bars"])
        return points, pairs, [name in bars for name in self.members]

    def document(
        self,
        prestress: float | None,
        where: str,
        shares: Sequence[float] | None = None,
        alike: Sequence[int] | None = None,
    ) -> dict[str, Any]:
        """Return the document; with `prestress` [N] every member carries its self-stress tension.

        shares: tensions of all members over the largest one of a cable, where they are known already; alike:
        as for find_selfstress.
        """
        if prestress is not None:
            points, pairs, is_bar = self.geometry()
            tension = (
                [prestress * fraction for fraction in shares]
                if shares is not None
                else find_selfstress(points, pairs, is_bar, prestress, where, alike)
            )
            for member, value in zip(self.members.values(), tension, strict=True):
                member["prestress"] = value
        groups = {name: members for name, members in self.groups.items() if members}
        return {"nodes": self.nodes, "members": self.members, "groups": groups}


def ring(count: int, radius: float, height: float, start: float, step: float) -> list[Point]:
    """Return `count` points (x, y, z) [m] on a circle about z; angles start + i step [rad]."""

    def snap(value: float) -> float:
        return 0.0 if abs(value) < 1e-15 * radius else value

    angles = [start + number * step for number in range(count)]
    return [(snap(radius * math.cos(t)), snap(radius * math.sin(t)), height) for t in angles]
