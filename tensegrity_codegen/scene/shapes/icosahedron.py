"""The tensegrity icosahedron (expanded octahedron): three pairs of parallel bars, 24 equal cables.

Bars of length L lie along x, y and z, the two of a pair L/2 apart: at this ratio the structure is in
self-stress. Every cable then measures sqrt(3/8) L, and each node joins four of them.
"""

import itertools
import math
from typing import Any, Literal

from pydantic import Field

from tensegrity_codegen.scene.shapes.parts import ClassName, Parts, Positive, ShapeModel


class IcosahedronShape(ShapeModel):
    """An icosahedron about the origin: nodes n1..n12; members bar1..bar6, cable1..cable24."""

    kind: Literal["icosahedron"] = Field("icosahedron", description="Name of the shape.")
    bar_length: Positive = Field(description="Length of the bars [m]; cables measure sqrt(3/8) of it.")
    bar_class: ClassName = Field("bar", description="Class of the bars.")
    cable_class: ClassName = Field("cable", description="Class of the cables.")
    prestress: Positive | None = Field(
        None, description="Cable tension [N] of the self-stress that the members are given."
    )

    def expand(self, where: str) -> dict[str, Any]:
        """Return the icosahedron as a plain document."""
        shape = Parts(self.node_mass)
        points = _corners(self.bar_length)
        names = [f"n{number}" for number in range(1, 13)]
        for name, point in zip(names, points, strict=True):
            shape.add_node(name, point)
        for number in range(6):
            shape.add_bar(f"bar{number + 1}", self.bar_class, names[2 * number : 2 * number + 2])
        edge = math.sqrt(3 / 8) * self.bar_length
        edges = [
            (i, j)
            for i, j in itertools.combinations(range(12), 2)
            if math.isclose(math.dist(points[i], points[j]), edge, rel_tol=1e-6)
        ]
        for number, (i, j) in enumerate(edges, start=1):
            shape.add_cable(f"cable{number}", self.cable_class, (names[i], names[j]))
        return shape.document(self.prestress, where)


def _corners(length: float) -> list[tuple[float, float, float]]:
    """Return the 12 nodes [m], bar by bar: bar axis z, x, y; two bars each."""
    points = []
    for shift in range(3):
        for side, end in itertools.product((-1, 1), (-1, 1)):
            point = (side * length / 4, 0.0, end * length / 2)
            points.append((point[-shift % 3], point[(1 - shift) % 3], point[(2 - shift) % 3]))
    return points
