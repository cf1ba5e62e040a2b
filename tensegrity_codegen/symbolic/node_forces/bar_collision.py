"""Forces between bars that touch, along the distance D of their surfaces (symbolic/interference.py).

d = -D, d' = -(dD/dx) . x' over the four ends x; N is that of Hunt and Crossley, and N dD/dx acts on the ends.
There is no friction between bars.
"""

from collections.abc import Callable, Mapping

import casadi as ca

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, dot
from tensegrity_codegen.symbolic.interference import pair_members
from tensegrity_codegen.symbolic.node_forces.node_force import NodeForce, NormalForce


def build_bar_collision(structure: Structure, arguments: SymbolicArguments) -> "BarCollision | None":
    """Return the forces between the bars of a structure, None if it has none."""
    return None if structure.collision is None else BarCollision(structure, arguments)


class BarCollision(NodeForce):
    """The forces between all pairs of bars of [interference]."""

    def __init__(self, structure: Structure, arguments: SymbolicArguments) -> None:
        assert structure.collision is not None
        pairs = pair_members(structure, arguments.position)
        distance, gradient, size = pairs.distance(), pairs.gradient(), len(structure.axes)
        self.contacts: list[tuple[list[int], list[Vector], NormalForce]] = []
        for row, bars in enumerate(structure.bar_pairs):
            ends = [int(node) for node in structure.connectivity[bars].ravel()]
            slopes = [[gradient[i * size + k, row] for k in range(size)] for i in range(4)]
            closing = [-dot(s, arguments.velocity[node]) for s, node in zip(slopes, ends, strict=True)]
            force = NormalForce(structure.collision, -distance[row], sum(closing, ca.SX(0.0)))
            self.contacts.append((ends, slopes, force))

    def forces(self) -> Mapping[int, Vector]:
        """Return node -> force of the bars that touch those which end there [N]."""
        total: dict[int, Vector] = {}
        for ends, slopes, normal in self.contacts:
            for node, slope in zip(ends, slopes, strict=True):
                old = total.get(node, [ca.SX(0.0)] * len(slope))
                total[node] = [f + normal.force * s for f, s in zip(old, slope, strict=True)]
        return total

    def stored_energy(self) -> Scalar:
        """Return the energy of compressed bars [J]."""
        return sum((normal.energy() for _, _, normal in self.contacts), ca.SX(0.0))

    def powers(self) -> Mapping[str, Scalar]:
        """Return minus the loss of impacts [W]."""
        return {"impact": sum((normal.power() for _, _, normal in self.contacts), ca.SX(0.0))}

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of forces and margins."""
        return {
            "collision_force": lambda: ca.vertcat(*[normal.force for _, _, normal in self.contacts]),
            "collision_margin": lambda: ca.vertcat(*[normal.margin() for _, _, normal in self.contacts]),
        }
