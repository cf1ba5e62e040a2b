"""Nodes as a forest of bodies: which node's body carries which other node's body.

MuJoCo's mass matrix couples bodies only along one branch of its tree, while the own mass of an elastic bar
couples its two ends. So the nodes of such bars stand on one branch: the child's joints measure its
displacement relative to its parent. An axis that is held at the child must be held at the parent too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure


@dataclass(frozen=True)
class NodeTree:
    """A forest of nodes.

    Attributes
    ----------
    parent : tuple of int
        Parent of each node, -1 of a root.
    order : tuple of int
        The nodes, parents before their children.
    fixed : ndarray of bool, shape (n_nodes, 3)
        Axes along which each node does not move.
    """

    parent: tuple[int, ...]
    order: tuple[int, ...]
    fixed: NDArray[np.bool_]

    def ancestors(self, node: int) -> list[int]:
        """Return the node and its ancestors up to the root."""
        found = [node]
        while self.parent[found[-1]] >= 0:
            found.append(self.parent[found[-1]])
        return found

    def children(self, node: int) -> list[int]:
        """Return the children of a node, -1: the roots."""
        return [item for item in self.order if self.parent[item] == node]

    def couples(self, i: int, j: int) -> bool:
        """Return whether the tree can couple two nodes along every axis along which both move."""
        on_branch = i in self.ancestors(j) or j in self.ancestors(i)
        return on_branch or bool((self.fixed[i] | self.fixed[j]).all())


def build_node_tree(structure: Structure, carried: NDArray[np.bool_]) -> NodeTree:
    """Return a forest in which as many elastic bars with own mass as possible join nodes of one branch.

    carried (n_nodes,): nodes that rigid bodies carry, which stay roots.
    """
    fixed = structure.node_anchored.copy()
    fixed[:, [axis for axis in range(3) if axis not in structure.axes]] = True
    heavy = (structure.member_mass > 0) & ~structure.is_rigid
    neighbours: list[list[int]] = [[] for _ in range(structure.n_nodes)]
    for i, j in structure.connectivity[heavy]:
        neighbours[i].append(int(j))
        neighbours[j].append(int(i))
    parent, order = [-1] * structure.n_nodes, []
    seen = carried | fixed.all(axis=1)  # what does not move needs no coupling
    order += [int(node) for node in np.flatnonzero(seen)]
    for root in sorted(range(structure.n_nodes), key=lambda node: -int(fixed[node].sum())):
        if seen[root]:
            continue
        stack = [(root, -1)]
        while stack:  # depth first: what remains joins a node and one of its ancestors
            node, above = stack.pop()
            if seen[node]:
                continue
            seen[node], parent[node] = True, above
            order.append(node)
            stack += [
                (item, node)
                for item in reversed(neighbours[node])
                if not seen[item] and not (fixed[item] & ~fixed[node]).any()
            ]
    return NodeTree(tuple(parent), tuple(order), fixed)
