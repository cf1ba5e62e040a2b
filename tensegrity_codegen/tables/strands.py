"""Strands: the straight pieces between the nodes that members pass, one for each member without rings."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Strands:
    """The strands of all members, member by member.

    ends (n_strands, 2): the two nodes of each strand, in the order in which the member passes them; member
    (n_strands,): the member that each is a part of; n_members: number of members.
    """

    ends: IntArray
    member: IntArray
    n_members: int

    @property
    def is_plain(self) -> bool:
        """Whether every member is one strand."""
        return len(self.member) == self.n_members

    @property
    def first_ends(self) -> IntArray:
        """The nodes of the first strand of each member, (n_members, 2)."""
        return self.ends if self.is_plain else self.ends[self._first]

    @property
    def _first(self) -> IntArray:
        return np.searchsorted(self.member, np.arange(self.n_members))

    @property
    def passes_rings(self) -> BoolArray:
        """Which members have more than one strand, (n_members,)."""
        return np.asarray(np.bincount(self.member, minlength=self.n_members) > 1)

    def spread(self, values: FloatArray) -> FloatArray:
        """Return values of members (..., n_members) for each strand, (..., n_strands)."""
        return values if self.is_plain else values[..., self.member]

    def add_up(self, values: FloatArray) -> FloatArray:
        """Return the sums of values of strands (..., n_strands) over each member, (..., n_members)."""
        if self.is_plain:
            return values
        return np.asarray(np.add.reduceat(values, self._first, axis=-1))

    def vectors(self, position: FloatArray) -> FloatArray:
        """Return r_i - r_j of each strand (..., n_strands, 3) [m] for node positions (..., n_nodes, 3)."""
        return np.asarray(position[..., self.ends[:, 0], :] - position[..., self.ends[:, 1], :])

    def lengths(self, position: FloatArray) -> FloatArray:
        """Return the lengths of members (..., n_members) [m] for node positions (..., n_nodes, 3) [m]."""
        return self.add_up(self.strand_lengths(position))

    def strand_lengths(self, position: FloatArray) -> FloatArray:
        """Return the lengths of strands (..., n_strands) [m]; infinite beyond the largest number."""
        with np.errstate(over="ignore", under="ignore"):
            return np.asarray(np.linalg.norm(self.vectors(position), axis=-1))

    def directions(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return unit vectors (n_strands, 3) and lengths (n_strands,) [m]: 0 and 1 if ends coincide."""
        length = self.strand_lengths(position)
        length = np.where(length > 0.0, length, 1.0)
        return self.vectors(position) / length[:, None], length


def list_strands(ends: IntArray, ring_nodes: Sequence[Sequence[int]]) -> Strands:
    """Return the strands of members.

    ends (n_members, 2): first and last node of each member; ring_nodes: the nodes that each member passes
    between its ends, in order; empty if none passes any.
    """
    count = len(ends)
    if not ring_nodes:
        return Strands(ends, np.arange(count), count)
    paths = [(int(i), *rings, int(j)) for (i, j), rings in zip(ends, ring_nodes, strict=True)]
    pairs = [pair for path in paths for pair in pairwise(path)]
    member = np.repeat(np.arange(count), [len(path) - 1 for path in paths])
    return Strands(np.array(pairs, dtype=np.int64).reshape(-1, 2), member, count)
