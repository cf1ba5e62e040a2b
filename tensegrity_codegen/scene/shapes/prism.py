"""The tensegrity prism: p bars between two rings of p nodes.

Seen from above (p = 3); b1 is at angle 0, the rings run anticlockwise, the bottom ring at z = 0:

            b2 . . . . t1            bar i       from b_i to t_i, turned by `twist`
             \\         |            vertical i  from b_i to t_(i-1), turned by `twist` - 360/p
              \\   z    |            bottom i    from b_i to b_(i+1)
               o ----- b1 -> x      top i       from t_i to t_(i+1)

`twist` is the angle from b_i to t_i about +z. Equal and opposite moments of bars and verticals ask for
sin(twist) = sin(twist - 360/p), hence twist = 90 + 180/p [deg] whatever the radii and the height: 150 deg
for p = 3, where the verticals are turned by 30 deg. A negative twist gives the mirror image.

With the opposite cables, opposite i from b_i to t_(i+1), the mirror image of the verticals, there are self-
stresses with all cables in tension for every twist between 90 + 180/p and 270 - 180/p. The shape has the
symmetrical one; the members of a kind have the same tension in it.
"""

import math
from typing import Any, Literal

from pydantic import Field

from tensegrity_codegen.scene.shapes.parts import (
    Anchored,
    Angle,
    ClassName,
    Parts,
    Positive,
    ShapeModel,
    ring,
)
from tensegrity_codegen.system.errors import InvalidValueError, StructureError


def selfstress_twist(bars: int) -> float:
    """Return the twist [deg] at which a prism of `bars` bars has a self-stress: 90 + 180/p."""
    return 90 + 180 / bars


class PrismShape(ShapeModel):
    """A prism: nodes b1.., t1..; members bar1.., bottom1.., top1.., vertical1.., opposite1.."""

    kind: Literal["prism"] = Field("prism", description="Name of the shape.")
    bars: int = Field(3, ge=3, le=1000, description="Number of bars.")
    bottom_radius: Positive = Field(description="Radius of the ring of bottom nodes [m].")
    top_radius: Positive | None = Field(
        None, description="Radius of the top ring [m]; default bottom_radius."
    )
    height: Positive = Field(description="Distance between the rings [m]; the bottom ring lies at z = 0.")
    twist: Angle | None = Field(
        None,
        description="Angle from a bar's bottom node to its top node [deg]; default 90 + 180/bars, the "
        "angle of self-stress; negative: mirrored.",
    )
    anchor_bottom: Anchored = Field(
        False, description='Hold the bottom nodes: true (all axes), false, or the held axes, such as "z".'
    )
    bar_class: ClassName = Field("bar", description="Class of the bars.")
    bottom_class: ClassName = Field("cable", description="Class of the bottom cables.")
    top_class: ClassName = Field("cable", description="Class of the top cables.")
    vertical_class: ClassName = Field("cable", description="Class of the cables between the rings.")
    opposite_class: ClassName | None = Field(
        None,
        description="Class of the opposite cables from b_i to t_(i+1), which mirror the verticals from b_i "
        "to t_(i-1); none: there are none. With them the symmetrical self-stress has all cables in tension "
        "for every `twist` from 90 + 180/bars to 270 - 180/bars (or minus these), which is then required.",
    )
    prestress: Positive | None = Field(
        None, description="Largest cable tension [N] of the self-stress that the members are given."
    )

    def expand(self, where: str) -> dict[str, Any]:
        """Return the prism as a plain document."""
        if self.opposite_class is not None and self.twist is None:
            raise InvalidValueError(
                "a prism with opposite cables has no default twist",
                where=f"{where}.twist",
                allowed="with a prestress, angles between "
                f"{selfstress_twist(self.bars):g} and {360 - selfstress_twist(self.bars):g} deg",
                hint="add 'twist'",
            )
        shape = Parts(self.node_mass)
        numbers = range(1, self.bars + 1)
        for letter, points in zip("bt", self._rings(), strict=True):
            for number, point in zip(numbers, points, strict=True):
                shape.add_node(f"{letter}{number}", point, anchored=letter == "b" and self.anchor_bottom)
        for i in numbers:
            shape.add_bar(f"bar{i}", self.bar_class, (f"b{i}", f"t{i}"))
        # Word, class, ring of either end, and how many nodes the second end is ahead of the first.
        cables = [("bottom", self.bottom_class, "b", "b", 1), ("top", self.top_class, "t", "t", 1)]
        cables.append(("vertical", self.vertical_class, "b", "t", -1))
        if self.opposite_class is not None:
            cables.append(("opposite", self.opposite_class, "b", "t", 1))
        for kind, class_name, ring_letter, second, ahead in cables:
            for i in numbers:
                ends = (f"{ring_letter}{i}", f"{second}{(i - 1 + ahead) % self.bars + 1}")
                shape.add_cable(f"{kind}{i}", class_name, ends, f"{kind}_cables")
        if self.opposite_class is None:
            return shape.document(self.prestress, where)
        kinds = len(shape.members) // self.bars
        try:
            return shape.document(self.prestress, where, alike=[k for k in range(kinds) for _ in numbers])
        except StructureError as error:
            min_twist = selfstress_twist(self.bars)
            error.hint = f"choose a twist between {min_twist:g} and {360 - min_twist:g} deg; or {error.hint}"
            raise

    def _rings(self) -> tuple[list[tuple[float, float, float]], list[tuple[float, float, float]]]:
        twist = selfstress_twist(self.bars) if self.twist is None else self.twist
        step = math.copysign(2 * math.pi / self.bars, twist)
        top_radius = self.bottom_radius if self.top_radius is None else self.top_radius
        bottom = ring(self.bars, self.bottom_radius, 0.0, 0.0, step)
        return bottom, ring(self.bars, top_radius, self.height, math.radians(twist), step)
