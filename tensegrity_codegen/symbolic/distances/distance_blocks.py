"""Jacobians of member forces to member vectors and rest lengths: one block a member (S&K 5, 6).

df/dd = -mu [(1 - rho/l) I + (rho/l^3) d d^T], df/drho = mu d / l, zero for a slack cable; damping adds its
parts. A component that is no coordinate, between two anchored nodes, has no row and no column.
"""

from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.distances.pair_coordinates import PairCoordinates
from tensegrity_codegen.symbolic.members.member_blocks import MemberBlocks
from tensegrity_codegen.symbolic.members.member_set import MemberSet

Scalar = Any


class DistanceBlocks:
    """Block-diagonal Jacobians of the forces of `members` over the coordinates of `layout`."""

    def __init__(self, layout: PairCoordinates, members: MemberSet) -> None:
        self.layout = layout
        self.members = members

    def places(self, e: int) -> list[tuple[int, int]]:
        """Return (coordinate, column of its axis) of the components of member e that are coordinates."""
        pair = int(self.layout.pairs.pair_of_member[e])
        columns = range(len(self.layout.axes))
        return [(self.layout.index[pair, c], c) for c in columns if (pair, c) in self.layout.index]

    def by_position(self) -> ca.SX:
        """Return df/ddelta, sparse (n_coordinates, n_coordinates) [N/m]."""
        return self._diagonal({e: member.position_block() for e, member in enumerate(self.members.members)})

    def by_velocity(self) -> ca.SX:
        """Return df/ddelta', sparse (n_coordinates, n_coordinates) [N s/m]."""
        return self._diagonal({e: self.members.members[e].rate_block() for e in self.members.damped})

    def by_rest_length(self) -> ca.SX:
        """Return df/drho = -(dt/drho) d / l, sparse (n_coordinates, n_members) [N/m]."""
        members = self.members
        entries = [
            (row, e, -members.laws[e].tension_by_rest_length() * members.vectors[e][r] / length)
            for e, length in enumerate(members.lengths)
            for row, r in self.places(e)
        ]
        return _sparse(entries, self.layout.n_coordinates, len(members.ends))

    def by_input(self) -> ca.SX:
        """Return df/du of rest-length inputs, sparse (n_coordinates, n_inputs) [N/m]."""
        columns, slope = [], self.by_rest_length()
        for item in self.layout.structure.inputs:
            parts = (gain * slope[:, e] for e, gain in item.rest_length_gain.items())
            columns.append(sum(parts, ca.SX(self.layout.n_coordinates, 1)))
        return ca.horzcat(*columns) if columns else ca.SX(self.layout.n_coordinates, 0)

    def _diagonal(self, blocks: dict[int, MemberBlocks]) -> ca.SX:
        entries = [
            (row, column, -block.entries[r][c])
            for e, block in blocks.items()
            for row, r in self.places(e)
            for column, c in self.places(e)
        ]
        return _sparse(entries, self.layout.n_coordinates, self.layout.n_coordinates)


def _sparse(entries: list[tuple[int, int, Scalar]], rows: int, columns: int) -> ca.SX:
    kept = [entry for entry in entries if not entry[2].is_zero()]
    stacked = ca.vertcat(*[value for _, _, value in kept]) if kept else ca.SX(0, 1)
    return ca.SX.triplet([r for r, _, _ in kept], [c for _, c, _ in kept], stacked, rows, columns)
