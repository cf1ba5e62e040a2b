"""The stacked tower: k prism stages of alternating twist, joined by saddle and diagonal cables.

Saddle, vertical and diagonal cables as in C. Sultan, M. Corless and R. E. Skelton's two-stage tower, here
for any number of stages. The bottom nodes of stage s + 1 lie `overlap` * `height` below the top nodes of
stage s, turned half a step against them; no two bars share a node (tensegrity class 1).

       t3 -- t3 -- t3     top ring: top cables
         |  X  |  X       stage 3: bars and vertical cables
     ~~~ b3 ~ t2 ~ b3 ~~  saddle cables, in zigzag between the rings t(s) and b(s+1)
         |  X  |  X       stage 2, twisted the other way
     ~~~ b2 ~ t1 ~ b2 ~~  diagonal cables: b(s) to b(s+1) and t(s) to t(s+1)
         |  X  |  X       stage 1
       b1 -- b1 -- b1     bottom ring: bottom cables

For p bars a stage: k p bars, k p verticals, 2 p (k-1) saddles, 2 p (k-1) diagonals, 2 p ring cables.
At `overlap` = 0 the prism's twist 90 + 180/p gives a self-stress with untensioned diagonals. With an
overlap the diagonals take their part and the self-stress asks for a larger twist, which has no closed form:
it is the root of the determinant of the equilibrium equations of one node a ring.
"""

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tensegrity_codegen.scene.shapes.long_tower import find_bar_runs, find_long_twist, find_run_tensions
from tensegrity_codegen.scene.shapes.parts import (
    Anchored,
    Angle,
    ClassName,
    Parts,
    Positive,
    ShapeModel,
    ring,
)
from tensegrity_codegen.scene.shapes.prism import selfstress_twist
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.system.errors import StructureError

MOST_STAGES_FOR_TWIST = 30
_KNOWN_STAGES = (8, 16)  # of the towers that a longer one's twist is followed from
_SCAN_RANGE = 45.0  # deg above the prism's twist
_SCAN_STEP = 0.5  # deg


class TowerShape(ShapeModel):
    """A tower: nodes b<stage>_<i>, t<stage>_<i>; members bar<stage>_<i> and so on, counted from 1."""

    kind: Literal["tower"] = Field("tower", description="Name of the shape.")
    stages: int = Field(ge=1, le=20_000, description="Number of stages.")
    bars: int = Field(3, ge=3, le=1000, description="Number of bars in a stage.")
    radius: Positive = Field(description="Radius of every ring of nodes [m].")
    height: Positive = Field(description="Height of one stage [m]; the bottom ring lies at z = 0.")
    overlap: float = Field(
        0.2,
        ge=0,
        lt=1,
        allow_inf_nan=False,
        description="Overlap of neighbouring stages, as part of the height.",
    )
    twist: Angle | None = Field(
        None,
        description="Angle from a bar's bottom node to its top node in the first stage [deg], in turn "
        "positive and negative above; default 90 + 180/bars, with `prestress` the angle of self-stress.",
    )
    anchor_bottom: Anchored = Field(
        False, description='Hold the bottom ring: true (all axes), false, or the held axes, such as "z".'
    )
    bar_class: ClassName = Field("bar", description="Class of the bars.")
    bottom_class: ClassName = Field("cable", description="Class of the bottom ring's cables.")
    top_class: ClassName = Field("cable", description="Class of the top ring's cables.")
    vertical_class: ClassName = Field("cable", description="Class of the vertical cables.")
    saddle_class: ClassName = Field("cable", description="Class of the saddle cables.")
    diagonal_class: ClassName = Field("cable", description="Class of the diagonal cables.")
    prestress: Positive | None = Field(
        None, description="Largest cable tension [N] of the self-stress that the members are given."
    )

    def expand(self, where: str) -> dict[str, Any]:
        """Return the tower as a plain document; raises StructureError for an impossible `prestress`."""
        twist = self.twist
        if twist is None:
            twist = selfstress_twist(self.bars)
            if self.prestress is not None and self.stages > 1:
                twist = find_tower_twist(self, where)
        shares = None
        if self.prestress is not None and self.stages > MOST_STAGES_FOR_TWIST:
            shares = _find_shares(self, twist, where)
        return self._parts(twist).document(self.prestress, where, shares)

    def _parts(self, twist: float) -> Parts:
        """Return the tower at `twist` [deg]; members come in runs of `bars` equal ones."""
        parts = Parts(self.node_mass)
        step = math.copysign(2 * math.pi / self.bars, twist)
        start = 0.0
        for stage in range(1, self.stages + 1):
            base = (stage - 1) * self.height * (1 - self.overlap)
            turn = math.copysign(math.radians(twist), step)
            rings = (
                ring(self.bars, self.radius, base, start, step),
                ring(self.bars, self.radius, base + self.height, start + turn, step),
            )
            for letter, points in zip("bt", rings, strict=True):
                held = stage == 1 and letter == "b" and self.anchor_bottom
                for number, point in enumerate(points):
                    parts.add_node(_node(letter, stage, number, self.bars), point, anchored=held)
            start, step = math.remainder(start + turn + step / 2, 2 * math.pi), -step
            self._add_stage(parts, stage)
        reach = math.floor(abs(twist) * self.bars / 360 + 1 + 1e-9)
        for stage in range(1, self.stages):
            self._add_joint(parts, stage, reach)
        return parts

    def _add_stage(self, parts: Parts, stage: int) -> None:
        p = self.bars
        for i in range(p):
            ends = (_node("b", stage, i, p), _node("t", stage, i, p))
            parts.add_bar(f"bar{stage}_{i + 1}", self.bar_class, ends)
        for i in range(p):
            ends = (_node("b", stage, i, p), _node("t", stage, i - 1, p))
            parts.add_cable(f"vertical{stage}_{i + 1}", self.vertical_class, ends, "vertical_cables")
        rings = [("b", "bottom", self.bottom_class)] * (stage == 1)
        rings += [("t", "top", self.top_class)] * (stage == self.stages)
        for letter, word, class_name in rings:
            for i in range(p):
                ends = (_node(letter, stage, i, p), _node(letter, stage, i + 1, p))
                parts.add_cable(f"{word}{i + 1}", class_name, ends, f"{word}_cables")

    def _add_joint(self, parts: Parts, stage: int, reach: int) -> None:
        """Join `stage` to the next one; t_i meets b_(-i) and b_(1-i), whose rings run the other way."""
        p, above = self.bars, stage + 1
        for side in (0, 1):
            for i in range(p):
                ends = (_node("t", stage, i, p), _node("b", above, side - i, p))
                name = f"saddle{stage}_{i + 1 + side * p}"
                parts.add_cable(name, self.saddle_class, ends, "saddle_cables")
        for side, (letter, total) in enumerate((("b", reach), ("t", 1 - reach))):
            for i in range(p):
                ends = (_node(letter, stage, i, p), _node(letter, above, total - i, p))
                name = f"diagonal{stage}_{i + 1 + side * p}"
                parts.add_cable(name, self.diagonal_class, ends, "diagonal_cables")


def find_tower_twist(tower: TowerShape, where: str = "shape") -> float:
    """Return the twist [deg] at which `tower` has a self-stress with every cable in tension.

    Scans the determinant of the symmetric equilibrium equations from above and bisects its sign changes; of
    more than MOST_STAGES_FOR_TWIST stages it follows that twist from shorter towers, see long_tower.
    Raises StructureError where no such twist is found within 45 deg above the prism's.
    """
    if tower.stages > MOST_STAGES_FOR_TWIST:
        known = {k: find_tower_twist(_of_stages(tower, k), where) for k in _KNOWN_STAGES}
        found = find_long_twist(lambda twist: _four_stages(tower, twist), known, tower.stages)
        if found is None:
            raise _no_twist(tower, where)
        return found
    lowest = selfstress_twist(tower.bars)
    twists = np.arange(lowest + _SCAN_RANGE, lowest, -_SCAN_STEP)
    signs = [_determinant_sign(tower, twist) for twist in twists]
    for high, low, sign, following in zip(twists, twists[1:], signs, signs[1:], strict=False):
        if sign != following:
            root = _bisect(tower, float(low), float(high), sign)
            if _is_taut(tower, root):
                return root
    raise _no_twist(tower, where)


def _no_twist(tower: TowerShape, where: str) -> StructureError:
    return StructureError(
        "no twist was found at which this tower has a self-stress with every cable in tension",
        where=f"{where}.prestress",
        given=tower.prestress,
        allowed="an overlap above 0 that such a twist exists for",
        hint="try 3 bars and an overlap of 0.1 to 0.3; or leave out shape.prestress, give the cable "
        "classes a prestress, and settle the scene with `equilibrium`",
    )


def _of_stages(tower: TowerShape, stages: int) -> TowerShape:
    return tower.model_copy(update={"stages": stages})


def _find_shares(tower: TowerShape, twist: float, where: str) -> list[float]:
    """Return the tensions of all members over the largest one of a cable, in their order.

    Rounded to 13 digits, as in selfstress. Raises StructureError where the twist has no such self-stress.
    """
    is_bar = np.zeros(6 * tower.stages - 2, dtype=bool)
    is_bar[find_bar_runs(tower.stages)] = True
    tension = find_run_tensions(lambda angle: _four_stages(tower, angle), tower.stages, twist, is_bar)
    if tension is None:
        raise _no_twist(tower, where)
    shares = np.repeat(tension / tension[~is_bar].max(), tower.bars)
    return [float(f"{value:.12e}") for value in shares]


def _four_stages(tower: TowerShape, twist: float) -> NDArray[np.float64]:
    return _frame_equations(_of_stages(tower, 4), twist)


def _bisect(tower: TowerShape, low: float, high: float, sign: float) -> float:
    for _ in range(60):
        middle = (low + high) / 2
        if _determinant_sign(tower, middle) == sign:
            high = middle
        else:
            low = middle
    return (low + high) / 2


def _determinant_sign(tower: TowerShape, twist: float) -> float:
    return float(np.linalg.slogdet(_symmetric_equations(tower, twist))[0])


def _is_taut(tower: TowerShape, twist: float) -> bool:
    """Return whether the null vector at a root has one sign in all cables and the other in all bars."""
    _, singular, right = np.linalg.svd(_symmetric_equations(tower, twist))
    is_bar = np.array(tower._parts(twist).geometry()[2][:: tower.bars])
    forces = right[-1] * np.where(is_bar, -1, 1)
    forces *= np.sign(forces.sum())
    return bool(singular[-1] < 1e-9 * singular[0] and forces.min() > 1e-6 * forces.max())


def _symmetric_equations(tower: TowerShape, twist: float) -> NDArray[np.float64]:
    """Return the equilibrium equations (6k - 2, 6k - 2) of one node a ring for tensions equal in each run.

    Rows are radial, tangential and axial; the last ring's tangential and axial ones follow from the others
    (balance of moments about z and of forces along z) and are left out.
    """
    return _frame_equations(tower, twist)[:-2]


def _frame_equations(tower: TowerShape, twist: float) -> NDArray[np.float64]:
    """Return the equations (6k, 6k - 2): three rows a ring, radial, tangential and axial; a column a run."""
    points, pairs, _ = tower._parts(twist).geometry()
    p, position = tower.bars, np.array(points)
    matrix = equilibrium_matrix(position, pairs).reshape(len(points), 3, len(pairs))[::p]
    runs = matrix.reshape(len(matrix), 3, -1, p).sum(axis=3)
    radial = position[::p] * (1, 1, 0) / tower.radius
    tangential = radial[:, [1, 0, 2]] * (-1, 1, 0)
    axial = np.tile((0.0, 0.0, 1.0), (len(radial), 1))
    frame = np.stack((radial, tangential, axial), axis=1)
    rows: NDArray[np.float64] = np.einsum("nij,njr->nir", frame, runs).reshape(3 * len(matrix), -1)
    return rows


def _node(letter: str, stage: int, number: int, count: int) -> str:
    return f"{letter}{stage}_{number % count + 1}"
