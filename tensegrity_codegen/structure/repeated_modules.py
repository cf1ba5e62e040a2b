"""Repeated modules: members whose ends advance by a constant step of nodes from one repetition to the next.

Levels of a tower, units of a spine and panels of a grid are modules. In an order of the nodes with a step s,

    member r of a strand joins   node number slot_a + s r   and   node number slot_b + s (r + shift),

and a module is a set of strands over the same repetitions r. Nodes of one slot whose shifts are close stand
in one column; the first and the second end of a strand are entries of columns at a constant offset. So the
work of repetitions side by side is arithmetic on contiguous pieces of columns.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.system.arrays import IntArray

Shape = tuple[bytes, bytes, tuple[int, ...]]

LEAST_REPETITIONS = 16
LEAST_MEMBERS = 48  # of a module
MAX_SHIFT_GAP = 8  # shifts up to so far apart share a column
LONGEST_STEP = 128  # nodes a repetition, at most
MOST_STRANDS = 96  # in one module: what its repetitions side by side need has to stay in fast memory
MOST_SHAPES = 4  # different modules; each is code of its own
SAMPLE = 512  # members that a step is tried on


@dataclass(frozen=True)
class Module:
    """Strands of members over the same repetitions.

    member: (n_strands, n_repetitions); kind: (n_strands,), rising; column: nodes of each column, in an order
    in which a node that stands in two of them is reached in the first one first; place: (n_strands, 2, 2),
    column and offset of both ends: end k of repetition r is node column[place[s, k, 0]][place[s, k, 1] + r].
    """

    member: IntArray
    kind: IntArray
    column: tuple[IntArray, ...]
    place: IntArray

    @property
    def n_repetitions(self) -> int:
        """Number of repetitions."""
        return int(self.member.shape[1])

    @property
    def extent(self) -> list[int]:
        """How many nodes each column has beyond the repetitions."""
        return [len(nodes) - self.n_repetitions for nodes in self.column]

    @property
    def shape(self) -> Shape:
        """What two modules that can share their code have in common."""
        return self.kind.tobytes(), self.place.tobytes(), tuple(self.extent)

    def entries(self, column: int) -> list[tuple[int, int, int]]:
        """Return (strand, end, offset) of the ends in a column, in the order in which they add up."""
        return [
            (strand, end, int(self.place[strand, end, 1]))
            for strand in range(len(self.member))
            for end in (0, 1)
            if self.place[strand, end, 0] == column
        ]


def find_modules(ends: IntArray, kind: IntArray, order: IntArray) -> list[Module]:
    """Return the modules among members, no member in two of them.

    ends: (n, 2) nodes; kind: (n,) members of different kinds do not repeat each other, those of a negative
    kind nothing, nor do those that share both nodes with another; order: all nodes in the order in which
    repetitions are looked for. Modules of one shape come together.
    """
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    low, high = np.sort(rank[ends], axis=1).T
    _, pair, count = np.unique(low * len(order) + high, return_inverse=True, return_counts=True)
    alone = count[pair.reshape(-1)] == 1  # no other member joins the same nodes
    member = np.flatnonzero((kind >= 0) & (low < high) & alone)
    runs = _find_runs(kind, low, high - low, member, len(order))
    by_shape: dict[Shape, list[Module]] = {}
    for first, last, active in _intervals(runs):
        if len(active) * (last - first) >= LEAST_MEMBERS and len(active) <= MOST_STRANDS:
            module = _make_module(runs, active, first, last, order)
            by_shape.setdefault(module.shape, []).append(module)
    largest = sorted(by_shape.values(), key=lambda alike: -sum(module.member.size for module in alike))
    return [module for alike in largest[:MOST_SHAPES] for module in alike]


@dataclass(frozen=True)
class _Runs:
    """Members in a row: run k has members member[start[k] : start[k] + length[k]], one a repetition."""

    step: int
    member: IntArray
    start: IntArray
    length: IntArray
    kind: IntArray
    slot: IntArray
    repetition: IntArray  # of the first member
    delta: IntArray  # from the first end's number to the second's


def _find_runs(kind: IntArray, low: IntArray, delta: IntArray, member: IntArray, n_nodes: int) -> _Runs:
    """Return the runs of at least LEAST_REPETITIONS members, at the step at which most members repeat."""
    kind, low, delta = kind[member], low[member], delta[member]
    key = (kind * n_nodes + delta) * (2 * n_nodes) + low
    step = _find_step(np.sort(key), low, n_nodes)
    repetition, slot = np.divmod(low, step)
    order = np.lexsort((repetition, slot, delta, kind))
    columns = np.stack([kind, delta, slot, repetition])[:, order]
    expected = columns[:, :-1].copy()
    expected[3] += 1
    breaks = np.flatnonzero((columns[:, 1:] != expected).any(axis=0)) + 1
    start = np.concatenate([np.zeros(min(1, len(order)), dtype=np.int64), breaks])
    length = np.diff(np.append(start, len(order)))
    start, length = start[length >= LEAST_REPETITIONS], length[length >= LEAST_REPETITIONS]
    kinds, deltas, slots, repetitions = columns[:, start]
    return _Runs(step, member[order], start, length, kinds, slots, repetitions, deltas)


def _find_step(key: IntArray, low: IntArray, n_nodes: int) -> int:
    """Return the smallest step at which nearly as many members repeat as at the best one."""
    sample = key[:: max(1, len(key) // SAMPLE)]
    best, score = 1, -1.0
    for step in range(1, min(LONGEST_STEP, max(2, n_nodes // LEAST_REPETITIONS)) + 1):
        found = key[np.minimum(np.searchsorted(key, sample + step), len(key) - 1)] == sample + step
        share = float(found.mean()) if len(found) else 0.0
        if share > score + 0.05:
            best, score = step, share
    return best


def _intervals(runs: _Runs) -> Iterator[tuple[int, int, list[int]]]:
    """Return stretches of repetitions that the same runs cover: first, behind the last, these runs."""
    bounds: dict[int, tuple[list[int], list[int]]] = {}
    for run, (first, length) in enumerate(zip(runs.repetition.tolist(), runs.length.tolist(), strict=True)):
        bounds.setdefault(first, ([], []))[0].append(run)
        bounds.setdefault(first + length, ([], []))[1].append(run)
    active: set[int] = set()
    places = sorted(bounds)
    for first, last in itertools.pairwise(places):
        begun, ended = bounds[first]
        active = (active - set(ended)) | set(begun)
        if active and last - first >= LEAST_REPETITIONS:
            yield first, last, sorted(active)


def _make_module(runs: _Runs, active: list[int], first: int, last: int, order: IntArray) -> Module:
    """Return the module of the runs `active` over repetitions from `first` to before `last`."""
    chosen = np.array(active)
    begin = runs.start[chosen] + first - runs.repetition[chosen]
    member = runs.member[begin[:, None] + np.arange(last - first)]
    far = runs.slot[chosen] + runs.delta[chosen]
    ends = [(runs.slot[chosen], np.zeros_like(far)), (far % runs.step, far // runs.step)]
    columns: list[tuple[int, int, int]] = []  # slot, least shift, largest shift
    slots, shifts = (np.concatenate([end[k] for end in ends]) for k in (0, 1))
    for slot, shift in sorted(set(zip(slots.tolist(), shifts.tolist(), strict=True))):
        if columns and columns[-1][0] == slot and shift - columns[-1][1] <= MAX_SHIFT_GAP:
            columns[-1] = (slot, columns[-1][1], shift)
        else:
            columns.append((slot, shift, shift))
    # A node that stands in two columns is reached first in that of the larger shift.
    columns.sort(key=lambda column: (-column[1], column[0]))
    place = np.empty((len(active), 2, 2), dtype=np.int64)
    for number, (slot, least, most) in enumerate(columns):
        for end, (slot_of_end, shift_of_end) in enumerate(ends):
            here = (slot_of_end == slot) & (least <= shift_of_end) & (shift_of_end <= most)
            place[here, end, 0], place[here, end, 1] = number, shift_of_end[here] - least
    nodes = tuple(
        order[(first + least + np.arange(last - first + most - least)) * runs.step + slot]
        for slot, least, most in columns
    )
    return Module(member, runs.kind[chosen], nodes, place)
