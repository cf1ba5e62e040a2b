"""From a small structure to a large one: every candidate at every size and quantity."""

from collections.abc import Sequence
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray
from peers import casadi_c, casadi_vm, jax_arrays, mujoco_tendons, numba_loops, numpy_arrays
from peers.casadi_expressions import own_expression

from harness.ours import BATCH, Build, Ours, list_emitters
from harness.problem import LEVELS, QUANTITIES, SHIPPED, Problem, make_problem
from harness.session import Kept, Session
from harness.tools import Tools, Way


def largest_disagreement(problem: Problem, values: Sequence[NDArray[np.float64]]) -> float:
    """Return the largest difference between node forces, in units in the last place of each largest term."""
    stacked = np.array(values)
    unit = np.spacing(np.maximum(problem.largest_term(), np.finfo(float).tiny))
    return float(((stacked.max(axis=0) - stacked.min(axis=0)) / unit).max())


def count_unequal(problem: Problem, quantity: str, values: Sequence[NDArray[np.float64]]) -> int:
    """Return how many values differ from those of CasADi's virtual machine for the package's expression."""
    function = own_expression(problem, quantity)
    expected = np.array(function(problem.coordinate).nonzeros())
    return int(sum(np.count_nonzero(value != expected) for value in values))


PEERS = (casadi_c, casadi_vm, numpy_arrays, numba_loops, jax_arrays, mujoco_tendons)
STRUCTURES = (*SHIPPED, *(f"tower{levels}" for levels in LEVELS))
LARGEST = STRUCTURES[-1]
AT_LARGEST = QUANTITIES[:3]

BASELINES = (f"{casadi_c.UNROLLED} (gcc)", f"{casadi_c.MAP} (gcc)", casadi_vm.UNROLLED, casadi_vm.MAP)
NATIVE, REFERENCE = "native", "reference"
SMALL = 30
IN_REFERENCE = ("node_force", "tangent_stiffness")  # beyond small structures
MOST_IN_VM = 1000  # members that the package's own expression is evaluated for


def list_comparisons(structures: tuple[str, ...], full: bool) -> list[tuple[str, str]]:
    """Return (structure, quantity) of all comparisons; full: every quantity at the largest size too."""
    return [
        (name, quantity)
        for name in structures
        for quantity in (AT_LARGEST if name == LARGEST and not full else QUANTITIES)
    ]


def run_sizes(
    session: Session, tools: Tools, ours: Ours, structures: tuple[str, ...], full: bool, kept: Kept
) -> None:
    """Time all candidates at these structures, see list_comparisons; those that are kept are taken."""
    for name, comparisons in groupby(list_comparisons(structures, full), key=lambda item: item[0]):
        open_ones = [quantity for _, quantity in comparisons if not kept.take(session, name, quantity)]
        if not open_ones:
            continue
        problem = make_problem(name)
        for quantity in open_ones:
            ways = list_ways(problem, quantity, tools, ours)
            session.compare(name, problem.n_members, quantity, ways, BASELINES)
            session.chosen[name, quantity] = ours.chosen(problem, quantity)
            _compare_own(session, problem, quantity)
            kept.keep(session, name, quantity)
            ours.forget()


def _compare_own(session: Session, problem: Problem, quantity: str) -> None:
    """Note how far our own results are apart, and from CasADi's virtual machine with the reference flags."""
    own = {row.name for row in session.rows if row.structure == problem.name and row.side == "ours"}
    values = {name: v for name, v in session.values[problem.name, quantity].items() if name in own}
    if quantity == "node_force" and len(values) > 1:
        session.units[problem.name, quantity] = largest_disagreement(problem, list(values.values()))
    reference = [value for name, value in values.items() if REFERENCE in name]
    if reference and problem.n_members <= MOST_IN_VM:
        session.unequal[problem.name, quantity] = count_unequal(problem, quantity, reference)


def list_builds(tools: Tools) -> list[Build]:
    """Return how our C is compiled: native by every compiler, and the reference flags by the first."""
    return [*(Build(c, NATIVE) for c in tools.compilers), Build(tools.compilers[0], REFERENCE)]


def _is_worth_it(problem: Problem, quantity: str, build: Build, batch: int) -> bool:
    """Return whether to measure that: reference flags and batches are left out where they tell little new."""
    if batch:
        return build.flags == NATIVE and quantity in AT_LARGEST
    if build.flags == REFERENCE:
        small = problem.n_members <= SMALL
        return small or (quantity in IN_REFERENCE and problem.n_members <= MOST_IN_VM)
    return True


def list_ways(problem: Problem, quantity: str, tools: Tools, ours: Ours) -> list[tuple[str, Way]]:
    """Return (side, (title, maker)) of all candidates, ours first."""
    own = [
        (
            f"{emitter}{f', batch of {batch}' if batch else ''} ({build.title})",
            partial(ours.make, problem, quantity, emitter, build, batch),
        )
        for emitter in list_emitters()
        for build in list_builds(tools)
        for batch in (0, BATCH)
        if _is_worth_it(problem, quantity, build, batch)
    ]
    others = [way for peer in PEERS for way in peer.ways(problem, quantity, tools)]
    return [*(("ours", way) for way in own), *(("peer", way) for way in others)]
