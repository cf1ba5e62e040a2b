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

The self-stress of towers of any number of stages: in the frames (radial, tangential, axial) of the nodes,
stages of one hand have the same equilibrium equations, whatever their number: those of a tower of four stages
hold them all. The twist of self-stress of k stages tends to a limit as 1/k, so two towers half and a quarter
as long tell where to look.
"""

import functools
import itertools
import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
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
from tensegrity_codegen.scene.shapes.prism import selfstress_twist
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import StructureError

# From a twist [deg] to the equations (24, 22) of four stages: three rows a ring, columns as runs are listed.
Blocks = Callable[[float], FloatArray]

_REACH = 0.5  # how far from the expected twist it is looked for, as part of its distance from the limit
_NARROWINGS = 8  # of the interval around the twist, before a smooth function is trusted
_TAUT = 1e-6  # of the largest tension
_BALANCE_TOLERANCE = 1e-9  # of the largest tension


def find_long_twist(blocks: Blocks, known: dict[int, float], stages: int) -> float | None:
    """Return the twist [deg] of self-stress of a tower of so many stages, None if it is not near a guess.

    known: twists of two shorter towers, the second of twice as many stages as the first.
    """
    (less, low), (count, twist) = sorted(known.items())
    while count < stages:
        following = min(2 * count, stages)
        slope = (twist - low) / (1 / less - 1 / count)
        limit = twist + slope / count
        away = slope / following
        root = _bisect(blocks, following, limit - (1 - _REACH) * away, limit - (1 + _REACH) * away)
        if root is None:
            return None
        less, low, count, twist = count, twist, following, root
    return twist


def find_bar_runs(stages: int) -> IntArray:
    """Return which runs are bars, stage by stage, in the order in which the shape lists runs."""
    runs: IntArray = np.cumsum([0, 3, *[2] * (stages - 2)])
    return runs


def find_run_tensions(
    blocks: Blocks, stages: int, twist: float, is_bar: NDArray[np.bool_]
) -> FloatArray | None:
    """Return the tensions of all runs at a twist of self-stress; None unless they balance, cables taut."""
    equations = _equations(blocks(twist), stages)
    factor: Any = scipy.sparse.linalg.splu(equations)
    vector: FloatArray = np.random.default_rng(0).uniform(0.5, 1.0, 6 * stages - 2)
    for _ in range(3):  # towards the smallest singular value, rounding away from zero
        vector = factor.solve(factor.solve(vector, trans="T"))
        vector /= np.abs(vector).max()
    if np.abs(equations @ vector).max() > _BALANCE_TOLERANCE:
        return None
    tension = np.empty(len(vector))
    tension[_order(stages)] = vector
    tension *= np.sign(np.where(is_bar, -tension, tension).sum())
    forces = np.where(is_bar, -tension, tension)
    return tension if forces.min() > _TAUT * forces.max() else None


def _bisect(blocks: Blocks, stages: int, high: float, low: float) -> float | None:
    """Return the twist between two at which the determinant changes its sign, None without a change."""
    sign = _determinant_sign(blocks, stages, high)
    if _determinant_sign(blocks, stages, low) == sign:
        return None
    for _ in range(_NARROWINGS):
        middle = (low + high) / 2
        if _determinant_sign(blocks, stages, middle) == sign:
            high = middle
        else:
            low = middle
    return float(scipy.optimize.brentq(_measure(blocks, stages), low, high, xtol=1e-15, rtol=1e-15))


def _measure(blocks: Blocks, stages: int) -> Callable[[float], float]:
    """Return a smooth function of the twist that is zero where the equations are singular: 1 / (u A^-1 w)."""
    rng = np.random.default_rng(0)
    row_vector, column_vector = rng.uniform(0.5, 1.0, (2, 6 * stages - 2))

    def measure(twist: float) -> float:
        solved: FloatArray = scipy.sparse.linalg.splu(_equations(blocks(twist), stages)).solve(column_vector)
        return 1.0 / float(row_vector @ solved)

    return measure


def _determinant_sign(blocks: Blocks, stages: int, twist: float) -> float:
    factor: Any = scipy.sparse.linalg.splu(_equations(blocks(twist), stages))
    signs = np.sign(factor.U.diagonal())
    return float(np.prod(signs) * _parity(factor))


def _parity(factor: Any) -> int:
    """Return the sign of both permutations of a factorisation."""
    odd = 0
    for order in (factor.perm_r, factor.perm_c):
        count = len(order)
        cycles = scipy.sparse.coo_array((np.ones(count), (np.arange(count), order)), shape=(count, count))
        odd += count - int(scipy.sparse.csgraph.connected_components(cycles, directed=False)[0])
    return -1 if odd % 2 else 1


def _equations(four: FloatArray, stages: int) -> "scipy.sparse.csc_array":
    """Return the equations (6 stages - 2, 6 stages - 2), stage by stage, joints in between.

    Columns of `four`: bar, vertical, bottom ring; bar and vertical, twice; bar, vertical, top ring; four of
    each joint.
    """
    column = {"stage": ((0, 1), (3, 4)), "joint": ((10, 11, 12, 13), (14, 15, 16, 17))}
    stage = [four[6 * h : 6 * h + 6, list(column["stage"][h])] for h in (0, 1)]
    joint = [four[6 * h : 6 * h + 12, list(column["joint"][h])] for h in (0, 1)]
    count = np.arange(stages)
    blocks = [_repeat(four[:6, [2]], count[:1], 0), _repeat(four[18:, [9]], count[-1:], 3)]
    blocks += [_repeat(stage[h], count[h::2], 1) for h in (0, 1)]
    blocks += [_repeat(joint[h], count[h:-1:2], 3) for h in (0, 1)]
    rows, columns, values = (np.concatenate(arrays) for arrays in zip(*blocks, strict=True))
    size = 6 * stages - 2
    is_used = (rows < size) & (values != 0.0)
    return scipy.sparse.csc_array((values[is_used], (rows[is_used], columns[is_used])), shape=(size, size))


def _repeat(block: FloatArray, stage: IntArray, column: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return rows, columns and values of a block in some stages, from their column `column` on."""
    r, c = np.indices(block.shape)
    rows = (6 * stage[:, None] + r.ravel()).ravel()
    columns = (6 * stage[:, None] + c.ravel() + column).ravel()
    return rows, columns, np.tile(block.ravel(), len(stage))


def _order(stages: int) -> IntArray:
    """Return which run, as the shape lists them, each column of the equations stands for."""
    start = find_bar_runs(stages)  # runs of each stage begin with bars; joints come after all stages
    joint = start[-1] + 3 + 4 * np.arange(stages - 1)
    order = [np.array([2])]
    for s in range(stages):
        order.append(start[s] + np.arange(2))
        if s < stages - 1:
            order.append(joint[s] + np.arange(4))
    order.append(np.array([start[stages - 1] + 2]))
    return np.concatenate(order)


MAX_STAGES_FOR_TWIST = 30
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
        tension_ratios = None
        if self.prestress is not None and self.stages > MAX_STAGES_FOR_TWIST:
            tension_ratios = _find_shares(self, twist, where)
        return self._parts(twist).document(self.prestress, where, tension_ratios)

    def _parts(self, twist: float) -> Parts:
        """Return the tower at `twist` [deg]; members come in runs of `bars` equal ones."""
        shape = Parts(self.node_mass)
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
                    shape.add_node(_node(letter, stage, number, self.bars), point, anchored=held)
            start, step = math.remainder(start + turn + step / 2, 2 * math.pi), -step
            self._add_stage(shape, stage)
        reach = math.floor(abs(twist) * self.bars / 360 + 1 + 1e-9)
        for stage in range(1, self.stages):
            self._add_joint(shape, stage, reach)
        return shape

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
        for letter, kind, class_name in rings:
            for i in range(p):
                ends = (_node(letter, stage, i, p), _node(letter, stage, i + 1, p))
                parts.add_cable(f"{kind}{i + 1}", class_name, ends, f"{kind}_cables")

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
    """Return the twist [deg] at which `tower` has a self-stress with every cable in tension."""
    twist = _find_twist(tower.stages, tower.bars, tower.overlap)
    if twist is None:
        raise _no_twist(tower, where)
    return twist


@functools.lru_cache(maxsize=1024)
def _find_twist(stages: int, bars: int, overlap: float) -> float | None:
    """Return the twist [deg] of self-stress with taut cables, None if none is found.

    Radius and height do not matter: an affine map of the nodes keeps force densities in balance. The
    determinant of the symmetric equations changes its sign at the twist, and jumps where it passes a multiple
    of 360 / bars, since the diagonals then meet other nodes. The twist is the highest change with taut
    cables: with 3 bars the only one, 2.8 deg above the prism's twist for an overlap of 0.05 and two stages,
    12 deg for 0.2, more for more stages. So changes are looked for from above, in steps smaller than the
    distance of two. Of more than MAX_STAGES_FOR_TWIST stages the twist follows from those of shorter towers,
    see `find_long_twist`.
    """

    def equations(twist: ArrayLike) -> FloatArray:
        # Without the last ring's tangential and axial rows, which follow from the others (balance of
        # moments about z and of forces along z).
        return _frame_equations(stages, bars, overlap, twist)[..., :-2, :]

    if stages > MAX_STAGES_FOR_TWIST:
        known_twists = {count: _find_twist(count, bars, overlap) for count in _KNOWN_STAGES}
        shorter = {count: twist for count, twist in known_twists.items() if twist is not None}
        if len(shorter) < len(known_twists):
            return None
        return find_long_twist(lambda twist: _frame_equations(4, bars, overlap, twist), shorter, stages)
    lowest = selfstress_twist(bars)
    twists = np.arange(lowest + _SCAN_RANGE, lowest, -_SCAN_STEP)
    signs = np.linalg.slogdet(equations(twists))[0]
    for index in np.flatnonzero(signs[1:] != signs[:-1]).tolist():
        high, low = twists[index], twists[index + 1]
        root = float(
            scipy.optimize.brentq(
                lambda twist: np.linalg.det(equations(twist)), low, high, xtol=1e-14, rtol=1e-15
            )
        )
        if _is_taut(equations(root), stages):
            return root
    return None


def _no_twist(tower: TowerShape, where: str) -> StructureError:
    return StructureError(
        "no twist was found at which this tower has a self-stress with every cable in tension",
        where=f"{where}.prestress",
        given=tower.prestress,
        allowed="an overlap above 0 that such a twist exists for",
        hint="try 3 bars and an overlap of 0.1 to 0.3; or leave out shape.prestress, give the cable "
        "classes a prestress, and settle the scene with `equilibrium`",
    )


def _find_shares(tower: TowerShape, twist: float, where: str) -> list[float]:
    """Return the tensions of all members over the largest one of a cable, in their order.

    Rounded to 13 digits, as in selfstress. Raises StructureError if the twist has no such self-stress.
    """
    is_bar = np.zeros(6 * tower.stages - 2, dtype=bool)
    is_bar[find_bar_runs(tower.stages)] = True
    tension = find_run_tensions(
        lambda angle: _frame_equations(4, tower.bars, tower.overlap, angle, tower.height / tower.radius),
        tower.stages,
        twist,
        is_bar,
    )
    if tension is None:
        raise _no_twist(tower, where)
    ratios = np.repeat(tension / tension[~is_bar].max(), tower.bars)
    return [float(f"{value:.12e}") for value in ratios]


def _is_taut(equations: FloatArray, stages: int) -> bool:
    """Return whether the null vector at a root has one sign in all cables and the other in all bars."""
    _, singular, right = np.linalg.svd(equations)
    forces = right[-1].copy()
    forces[find_bar_runs(stages)] *= -1
    forces *= np.sign(forces.sum())
    return bool(singular[-1] < 1e-9 * singular[0] and forces.min() > 1e-6 * forces.max())


def _frame_equations(
    stages: int, bars: int, overlap: float, twist: ArrayLike, height: float = 1.0
) -> FloatArray:
    """Return the equilibrium equations of one node a ring for tensions equal in each run of members.

    twist: (...) [deg]; height: of a stage, over the radius. The result is (..., 6 stages, 6 stages - 2):
    three rows a ring, radial, tangential and axial; a column a run, in the order of `TowerShape._parts`.
    """
    twist = np.asarray(twist, dtype=float)
    stage = np.arange(stages)
    # Angle of node 0 of the rings b1, t1, b2, t2, ..., the step from node to node, and their places on z.
    hand = np.where(twist[..., None] < 0, -1.0, 1.0) * (-1.0) ** stage
    turn, step = hand * np.radians(np.abs(twist))[..., None], hand * (2 * np.pi / bars)
    start = np.cumsum(turn + step / 2, axis=-1) - (turn + step / 2)
    angle = np.stack([start, start + turn], axis=-1).reshape(*twist.shape, 2 * stages)
    step = np.repeat(step, 2, axis=-1)
    z = height * (np.repeat(stage * (1 - overlap), 2) + np.tile((0.0, 1.0), stages))
    equations = np.zeros((*twist.shape, 2 * stages, 3, 6 * stages - 2))

    def add(own: int, other: int, number: Any, run: int) -> None:
        """Add the pull on node 0 of ring `own` by node `number` of another ring."""
        between = angle[..., other] + number * step[..., other] - angle[..., own]
        chord = [1 - np.cos(between), -np.sin(between), np.full(twist.shape, z[own] - z[other])]
        vector = np.stack(chord, axis=-1)
        equations[..., own, :, run] += vector / np.linalg.norm(vector, axis=-1, keepdims=True)

    run = itertools.count()
    for bottom, top in zip(range(0, 2 * stages, 2), range(1, 2 * stages, 2), strict=True):
        for number in (0, -1):  # the bar; the vertical, which meets the node before
            column = next(run)
            add(bottom, top, number, column)
            add(top, bottom, -number, column)
        for ring_end in [bottom] * (bottom == 0) + [top] * (top == 2 * stages - 1):
            column = next(run)
            add(ring_end, ring_end, 1, column)
            add(ring_end, ring_end, -1, column)
    reach = np.floor(np.abs(twist) * bars / 360 + 1 + 1e-9)
    for lower_ring in range(0, 2 * stages - 2, 2):
        # Saddles from top to next bottom, diagonals from bottom to bottom and top to top: i meets total - i.
        for low, high, total in ((1, 2, 0), (1, 2, 1), (0, 2, reach), (1, 3, 1 - reach)):
            column = next(run)
            add(lower_ring + low, lower_ring + high, total, column)
            add(lower_ring + high, lower_ring + low, total, column)
    return equations.reshape(*twist.shape, 6 * stages, 6 * stages - 2)


def _node(letter: str, stage: int, number: int, count: int) -> str:
    return f"{letter}{stage}_{number % count + 1}"
