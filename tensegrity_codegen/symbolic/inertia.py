"""The mass matrix of nodes and uniform bars, and its inverse, axis by axis.

H = diag(m_i) + sum over bars (m_e / 6) [2 1; 1 2], the same for every axis (the consistent
mass of a uniform bar whose points move linearly between its ends). Nodes that no bar with own mass joins
stay diagonal; the others fall into small groups, one factorisation each.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.structure import Structure

__all__ = ["Inertia"]

Scalar = Any


class Inertia:
    """Scalar mass matrix over the nodes and its action on the free nodes of each axis.

    structure: the structure; node_mass: n_nodes scalars [kg], numbers or symbols.
    """

    def __init__(self, structure: Structure, node_mass: list[Scalar]) -> None:
        self.structure = structure
        self.diagonal = list(node_mass)
        self.coupling: dict[tuple[int, int], float] = {}
        for member in np.flatnonzero(structure.member_mass):
            i, j = (int(node) for node in structure.connectivity[member])
            sixth = float(structure.member_mass[member]) / 6.0
            self.diagonal[i] = self.diagonal[i] + 2.0 * sixth
            self.diagonal[j] = self.diagonal[j] + 2.0 * sixth
            pair = (min(i, j), max(i, j))
            self.coupling[pair] = self.coupling.get(pair, 0.0) + sixth

    def check(self) -> None:
        """Raise FormulationError if a free node has no mass."""
        free = np.any(~self.structure.node_anchored[:, list(self.structure.axes)], axis=1)
        bare = [
            self.structure.node_name[node] for node in np.flatnonzero(free) if self.diagonal[node].is_zero()
        ]
        if bare:
            shown = ", ".join(bare[:5]) + (f" and {len(bare) - 5} more" if len(bare) > 5 else "")
            raise FormulationError(
                "a free node without mass has no acceleration",
                where=f"{self.structure.name}: nodes.{bare[0]}.mass",
                given=f"no mass at {shown}",
                allowed="a mass > 0 [kg] at the node, or a bar with own mass that ends there",
                hint="give the node a mass, or anchor it",
            )

    def groups(self, axis: int) -> list[list[int]]:
        """Return the free nodes of `axis` in groups that share bars with own mass."""
        free = np.flatnonzero(~self.structure.node_anchored[:, axis])
        position = {int(node): index for index, node in enumerate(free)}
        pairs = [pair for pair in self.coupling if pair[0] in position and pair[1] in position]
        rows = [position[i] for i, _ in pairs]
        columns = [position[j] for _, j in pairs]
        graph = coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(free), len(free)))
        count, label = connected_components(graph, directed=False)
        members: list[list[int]] = [[] for _ in range(count)]
        for index, node in enumerate(free):
            members[label[index]].append(int(node))
        return members

    def matrix(self, nodes: list[int]) -> ca.SX:
        """Return the mass matrix of a group of nodes, sparse (k, k) [kg]."""
        position = {node: index for index, node in enumerate(nodes)}
        result = ca.SX(len(nodes), len(nodes))
        for node, index in position.items():
            result[index, index] = self.diagonal[node]
        for (i, j), mass in self.coupling.items():
            if i in position and j in position:
                result[position[i], position[j]] = mass
                result[position[j], position[i]] = mass
        return result

    def solve(self, nodes: list[int], force: list[Scalar]) -> list[Scalar]:
        """Return H^-1 f of a group of nodes [m/s2]; LDL^T without pivoting, H is positive definite."""
        if len(nodes) == 1:
            return [force[0] * (1.0 / self.diagonal[nodes[0]])]
        factor, transposed, order = ca.ldl(self.matrix(nodes))
        solution = ca.ldl_solve(ca.densify(ca.vertcat(*force)), factor, transposed, order)
        return [solution[index] for index in range(len(nodes))]

    def inverse(self, nodes: list[int]) -> ca.SX:
        """Return H^-1 of a group of nodes, dense (k, k) [1/kg]."""
        if len(nodes) == 1:
            return 1.0 / self.diagonal[nodes[0]]
        factor, transposed, order = ca.ldl(self.matrix(nodes))
        return ca.ldl_solve(ca.densify(ca.SX.eye(len(nodes))), factor, transposed, order)

    def kinetic_energy(self, velocity: list[list[Scalar]]) -> Scalar:
        """Return v^T (H kron I) v / 2 [J] over all nodes."""
        energy = ca.SX(0.0)
        for node, mass in enumerate(self.diagonal):
            for component in velocity[node]:
                energy = energy + 0.5 * mass * component * component
        for (i, j), mass in self.coupling.items():
            for a, b in zip(velocity[i], velocity[j], strict=True):
                energy = energy + mass * a * b
        return energy

    def weight_mass(self) -> list[Scalar]:
        """Return the mass whose weight each node carries [kg]: its own and half of each bar's."""
        result = list(self.diagonal)
        for (i, j), mass in self.coupling.items():
            result[i] = result[i] + mass
            result[j] = result[j] + mass
        return result
