"""Self-stress of towers of any number of stages: sparse equations of one node a ring, twists by doubling.

In the frames (radial, tangential, axial) of the nodes, stages of one hand have the same equilibrium
equations, whatever their number: those of a tower of four stages hold them all. The twist of self-stress
of k stages tends to a limit as 1/k, so two towers half and a quarter as long tell where to look.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray, IntArray

# From a twist [deg] to the equations (24, 22) of four stages: three rows a ring, columns as runs are listed.
Blocks = Callable[[float], FloatArray]

_REACH = 0.5  # how far from the expected twist it is looked for, as part of its distance from the limit
_NARROWINGS = 8  # of the interval around the twist, before a smooth function is trusted
_TAUT = 1e-6  # of the largest tension
_BALANCE_TOLERANCE = 1e-9  # of the largest tension


def find_long_twist(blocks: Blocks, known: dict[int, float], stages: int) -> float | None:
    """Return the twist [deg] of self-stress of a tower of so many stages, None if it is not where expected.

    known: twists of two shorter towers, the second of twice as many stages as the first.
    """
    (less, low), (count, twist) = sorted(known.items())
    while count < stages:
        following = min(2 * count, stages)
        slope = (twist - low) / (1 / less - 1 / count)
        limit = twist + slope / count
        away = slope / following
        found = _bisect(blocks, following, limit - (1 - _REACH) * away, limit - (1 + _REACH) * away)
        if found is None:
            return None
        less, low, count, twist = count, twist, following, found
    return twist


def find_bar_runs(stages: int) -> IntArray:
    """Return which runs are bars, stage by stage, in the order in which the shape lists runs."""
    runs: IntArray = np.cumsum([0, 3, *[2] * (stages - 2)])
    return runs


def find_run_tensions(
    blocks: Blocks, stages: int, twist: float, is_bar: NDArray[np.bool_]
) -> FloatArray | None:
    """Return the tensions of all runs at a twist of self-stress; None unless they balance, cables taut.

    is_bar: (6 stages - 2,) whether a run is one of bars, in the order in which the shape lists runs.
    """
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
    """Return where the determinant changes its sign between two twists, None if it does not."""
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
    left, right = rng.uniform(0.5, 1.0, (2, 6 * stages - 2))

    def measure(twist: float) -> float:
        solved: FloatArray = scipy.sparse.linalg.splu(_equations(blocks(twist), stages)).solve(right)
        return 1.0 / float(left @ solved)

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
    parts = [_repeat(four[:6, [2]], count[:1], 0), _repeat(four[18:, [9]], count[-1:], 3)]
    parts += [_repeat(stage[h], count[h::2], 1) for h in (0, 1)]
    parts += [_repeat(joint[h], count[h:-1:2], 3) for h in (0, 1)]
    rows, columns, values = (np.concatenate(items) for items in zip(*parts, strict=True))
    size = 6 * stages - 2
    kept = (rows < size) & (values != 0.0)
    return scipy.sparse.csc_array((values[kept], (rows[kept], columns[kept])), shape=(size, size))


def _repeat(block: FloatArray, stage: IntArray, column: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return rows, columns and values of a block in some stages, from their column `column` on."""
    r, c = np.indices(block.shape)
    rows = (6 * stage[:, None] + r.ravel()).ravel()
    columns = (6 * stage[:, None] + c.ravel() + column).ravel()
    return rows, columns, np.tile(block.ravel(), len(stage))


def _order(stages: int) -> IntArray:
    """Return which run, as the shape lists them, each column of the equations stands for."""
    first = find_bar_runs(stages)  # runs of each stage begin with bars; joints come after all stages
    joint = first[-1] + 3 + 4 * np.arange(stages - 1)
    order = [np.array([2])]
    for s in range(stages):
        order.append(first[s] + np.arange(2))
        if s < stages - 1:
            order.append(joint[s] + np.arange(4))
    order.append(np.array([first[stages - 1] + 2]))
    return np.concatenate(order)
