"""The masses of nodes and uniform bars as numbers: what bars add to nodes, and which nodes they couple.

H = diag(m_i) + sum over bars (m_e / 6) [2 1; 1 2] + sum over cables (m_e / 2) [1 0; 0 1], the same for every
axis: half of the mass of a cable stands at each of its ends.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.pieces import find_pieces
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import FormulationError, name_list


class InertiaPlan:
    """Shares of the own masses of bars and cables, in the order in which everybody adds them.

    pair: (n_pairs, 2) nodes i < j that bars with own mass join, in the order of the members; pair_mass:
    (n_pairs,) their entries m_e / 6 in H [kg]; diagonal_share: (n_nodes,) what members add to its diagonal.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        heavy = np.flatnonzero(structure.member_mass * structure.is_bar)
        ends = structure.connectivity.reshape(-1, 2)[heavy]
        sixth = structure.member_mass[heavy] / 6.0
        self.diagonal_share = np.zeros(structure.n_nodes)
        np.add.at(self.diagonal_share, ends.reshape(-1), np.repeat(2.0 * sixth, 2))
        cables = np.flatnonzero(structure.member_mass * ~structure.is_bar)
        halves = np.repeat(structure.member_mass[cables] / 2.0, 2)
        np.add.at(self.diagonal_share, structure.connectivity[cables].reshape(-1), halves)
        pairs, first_row, pair_of = np.unique(
            np.sort(ends, axis=1), axis=0, return_index=True, return_inverse=True
        )
        order = np.argsort(first_row)
        self.pair = pairs[order].reshape(-1, 2)
        mass = np.zeros(len(pairs))
        np.add.at(mass, pair_of.reshape(-1), sixth)
        self.pair_mass = mass[order]

    @cached_property
    def weight_share(self) -> FloatArray:
        """(n_nodes,): the mass of members whose weight each node carries, half of each one's [kg]."""
        share = self.diagonal_share.copy()
        np.add.at(share, self.pair.reshape(-1), np.repeat(self.pair_mass, 2))
        return share

    @cached_property
    def _neighbours(self) -> dict[int, list[tuple[int, float]]]:
        """Later nodes of the pairs of each node, with the masses between."""
        neighbours: dict[int, list[tuple[int, float]]] = {}
        for (i, j), mass in zip(self.pair.tolist(), self.pair_mass.tolist(), strict=True):
            neighbours.setdefault(i, []).append((j, mass))
        return neighbours

    def coupling_of(self, nodes: Sequence[int]) -> dict[tuple[int, int], float]:
        """Return the entries of H between some nodes, by their positions among these, each once."""
        position = {node: index for index, node in enumerate(nodes)}
        return {
            (position[i], position[j]): mass
            for i in nodes
            for j, mass in self._neighbours.get(i, ())
            if j in position
        }

    def groups(self, axis: int) -> list[list[int]]:
        """Return the free nodes of `axis` in groups that share bars with own mass."""
        free = np.flatnonzero(self.structure.has_coordinate[:, axis])
        position = np.full(self.structure.n_nodes, -1)
        position[free] = np.arange(len(free))
        pairs = position[self.pair]
        rows, columns = pairs[(pairs >= 0).all(axis=1)].T
        count, label = find_pieces(len(free), rows, columns)
        members: list[list[int]] = [[] for _ in range(count)]
        for node, group in zip(free.tolist(), label.tolist(), strict=True):
            members[group].append(node)
        return members

    def coupled(self, axis: int) -> tuple[IntArray, FloatArray, list[list[int]]]:
        """Return groups of several free nodes of `axis`: pairs (n, 2), their masses (n,), larger groups."""
        free = self.structure.has_coordinate[:, axis]
        held = free[self.pair].all(axis=1)
        pair, mass = self.pair[held], self.pair_mass[held]
        node, index = np.unique(pair, return_inverse=True)
        row, column = index.reshape(-1, 2).T
        _, label = find_pieces(len(node), row, column)
        size = np.bincount(label, minlength=1)
        alone = size[label[row]] == 2
        large = np.flatnonzero(size[label] > 2)
        large = large[np.argsort(label[large], kind="stable")]
        cut = np.flatnonzero(np.diff(label[large])) + 1
        groups = [group.tolist() for group in np.split(node[large], cut)] if len(large) else []
        return pair[alone], mass[alone], groups


def find_massless(structure: Structure) -> NDArray[np.bool_]:
    """Return which nodes are free to move and have no mass, neither their own nor of a member, (n_nodes,)."""
    mass = structure.node_mass.copy()
    for end in (0, 1):
        np.add.at(mass, structure.connectivity[:, end], structure.member_mass)
    free = structure.has_coordinate[:, list(structure.axes)].any(axis=1)
    massless: NDArray[np.bool_] = (mass == 0) & free
    return massless


def refuse_bare(structure: Structure, bare: Sequence[Any]) -> None:
    """Raise FormulationError if there are any free nodes without mass, `bare`."""
    if len(bare) == 0:
        return
    names = [structure.node_name[node] for node in bare]
    shown = name_list(names)
    problem = "a free node without mass has no acceleration"
    location = f"{structure.name}: nodes.{names[0]}.mass"
    allowed = "a mass > 0 [kg] at the node, or a bar with own mass that ends there"
    hint = "give the node a mass, or anchor it"
    raise FormulationError(problem, where=location, given=f"no mass at {shown}", allowed=allowed, hint=hint)
