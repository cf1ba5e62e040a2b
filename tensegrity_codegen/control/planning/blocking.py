"""The fewest limits that alone block a path as much as all limits do, of the limits linearised at its end.

A set of limits blocks where the step of most progress within them makes no more progress than within all. The
limits with multipliers are such a set. A deletion filter (J. W. Chinneck, "Feasibility and Infeasibility in
Optimization", 2008) leaves out what can be spared. Other sets may be smaller: of each set that does not
block, a blocking one has a limit outside it. The smallest set that meets all these demands either blocks, and
then none is smaller, or gives another demand (A. Ignatiev et al., "Smallest MUS extraction with minimal
hitting set dualization", 2015).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

from tensegrity_codegen.control.planning.step_problem import Program, Step

SAME_PROGRESS, SAME_PART = 1e-6, 1e-3  # progress, and its part, by which two steps count as equal
MOST_DEMANDS = 40


def find_fewest_limits(program: Program, bound: Step) -> tuple[NDArray[np.int64], bool]:
    """Return the fewest limits that block a step as much as all limits.

    program: at the end of a path.
    bound: its step of most progress.
    Returns: rows of the margins, none of which can be spared; and whether it is proved that no smaller set
        blocks, which is not tried beyond 40 sets.
    """
    most = bound.progress + max(SAME_PROGRESS, SAME_PART * bound.progress)
    rows = program.reachable_rows

    def find_free_step(kept: NDArray[np.bool_]) -> Step | None:
        """Return a step that makes more progress within some of `rows` than within all; None without one."""
        value = np.full(len(program.margins.value), np.inf)
        value[rows[kept]] = program.margins.value[rows[kept]]
        step = replace(program, margins=replace(program.margins, value=value)).find_bound(2.0 * most)
        return None if step is None or step.progress <= most else step

    # Spare limits one by one, those with the least weight first.
    fewest = np.isin(rows, bound.binding)
    if find_free_step(fewest) is not None:
        fewest[:] = True
    weight = np.zeros(len(program.margins.value))
    weight[bound.binding] = bound.multiplier * program.margins.size[bound.binding]
    for place in np.argsort(weight[rows], kind="stable"):
        if fewest[place]:
            fewest[place] = False
            fewest[place] = find_free_step(fewest) is not None
    # Look for a smaller set by demands that all blocking sets meet.
    demands = np.zeros((0, len(rows)))
    for _ in range(MOST_DEMANDS):
        chosen = _find_smallest(demands)
        if chosen.sum() >= fewest.sum():
            return rows[fewest], True
        step = find_free_step(chosen)
        if step is None:
            return rows[chosen], True
        # As many limits as still do not block: first all that the step keeps to.
        kept = chosen | program.is_within(step.change)[rows]
        for place in np.flatnonzero(~kept):
            kept[place] = True
            kept[place] = find_free_step(kept) is not None
        demands = np.vstack([demands, ~kept])
    return rows[fewest], False


def _find_smallest(demands: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the smallest choice (n,) with at least one in each of the demands (n_demands, n)."""
    count = demands.shape[1]
    if not len(demands):
        return np.zeros(count, dtype=bool)
    found = milp(
        np.ones(count),
        constraints=LinearConstraint(demands, lb=1.0),
        integrality=np.ones(count, dtype=np.int64),
        bounds=Bounds(0.0, 1.0),
    )
    return np.ones(count, dtype=bool) if found.x is None else np.asarray(found.x > 0.5)
