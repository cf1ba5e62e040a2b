"""The mass matrix of nodes and uniform bars, and its inverse, axis by axis.

H = diag(m_i) + sum over bars (m_e / 6) [2 1; 1 2], the same for every axis (the consistent
mass of a uniform bar whose points move linearly between its ends). Nodes that no bar with own mass joins
stay diagonal; the others fall into small groups, one factorisation each.
"""

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.inertia_plan import InertiaPlan, refuse_bare
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.structure.symmetric_factor import SymmetricFactor, factorise
from tensegrity_codegen.symbolic.geometry import Scalar


class Inertia:
    """Scalar mass matrix over the nodes and its action on the free nodes of each axis.

    structure: the structure; node_mass: n_nodes scalars [kg], numbers or symbols.
    """

    def __init__(self, structure: Structure, node_mass: list[Scalar]) -> None:
        self.structure = structure
        self.node_mass = list(node_mass)
        self.plan = InertiaPlan(structure)
        mass_pairs = zip(node_mass, self.plan.diagonal_share, strict=True)
        self.diagonal = [mass + float(bar_mass) for mass, bar_mass in mass_pairs]
        self.coupling = {
            (int(i), int(j)): float(mass)
            for (i, j), mass in zip(self.plan.pair, self.plan.pair_mass, strict=True)
        }
        self._factors: dict[tuple[int, ...], SymmetricFactor] = {}

    def check(self) -> None:
        """Raise FormulationError if a free node has no mass."""
        free = np.any(self.structure.has_coordinate[:, list(self.structure.axes)], axis=1)
        bare = [node for node in np.flatnonzero(free) if self.diagonal[node].is_zero()]
        refuse_bare(self.structure, bare)

    def groups(self, axis: int) -> list[list[int]]:
        """Return the free nodes of `axis` in groups that share bars with own mass."""
        return self.plan.groups(axis)

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
        return self.factor(tuple(nodes)).solve(force)

    def inverse(self, nodes: list[int]) -> ca.SX:
        """Return H^-1 of a group of nodes, dense (k, k) [1/kg]."""
        if len(nodes) == 1:
            return 1.0 / self.diagonal[nodes[0]]
        unit = np.eye(len(nodes)).tolist()
        columns = [self.factor(tuple(nodes)).solve(column) for column in unit]
        return ca.horzcat(*[ca.vertcat(*column) for column in columns])

    def factor(self, nodes: tuple[int, ...]) -> SymmetricFactor:
        """Return the factors of the mass matrix of a group of nodes, numbers where all masses are."""
        if nodes not in self._factors:
            diagonal = [ca.SX(self.diagonal[node]) for node in nodes]
            if all(mass.is_constant() for mass in diagonal):
                diagonal = [float(mass) for mass in diagonal]
            self._factors[nodes] = factorise(diagonal, self.plan.coupling_of(nodes))
        return self._factors[nodes]

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
        mass_pairs = zip(self.node_mass, self.plan.weight_share, strict=True)
        return [mass + float(bar_mass) for mass, bar_mass in mass_pairs]
