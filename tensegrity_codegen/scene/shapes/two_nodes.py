"""Two nodes and one member: the smallest scene, for first steps and for checks by hand."""

from typing import Any, Literal

from pydantic import Field

from tensegrity_codegen.scene.shapes.parts import ClassName, Parts, Positive, ShapeModel

_DIRECTION = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class TwoNodeShape(ShapeModel):
    """Nodes n1 (at the origin) and n2 (`length` away along an axis), joined by member1."""

    kind: Literal["two_nodes"] = Field("two_nodes", description="Name of the shape.")
    length: Positive = Field(description="Distance of the nodes [m].")
    along: Literal["x", "y", "z", "-x", "-y", "-z"] = Field("x", description="Direction from n1 to n2.")
    anchor_first: bool = Field(True, description="Hold n1 on all axes.")
    member_class: ClassName = Field("cable", description="Class of the member.")

    def expand(self, where: str) -> dict[str, Any]:
        """Return the two nodes and their member as a plain document."""
        sign = -1.0 if self.along.startswith("-") else 1.0
        x, y, z = (sign * self.length * component + 0.0 for component in _DIRECTION[self.along[-1]])
        shape = Parts(self.node_mass)
        shape.add_node("n1", (0.0, 0.0, 0.0), anchored=self.anchor_first)
        shape.add_node("n2", (x, y, z))
        document = shape.document(None, where)
        member = {"member1": {"class": self.member_class, "nodes": ["n1", "n2"]}}
        return {**document, "members": member}
