"""From nodes and members to coordinates: where each entry of a vector or matrix lands."""

from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import casadi as ca

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.geometry import Scalar, combine
from tensegrity_codegen.symbolic.members.member import MemberBlocks


class CoordinateMap:
    """Index of every free coordinate by (node, axis), and assembly into sparse matrices."""

    def __init__(self, structure: Structure) -> None:
        self.axes = structure.axes
        self.index = {
            (int(node), int(axis)): position
            for position, (node, axis) in enumerate(structure.coordinate_node_axis)
        }
        self.n_coordinates = len(self.index)
        self.attached = structure.attached
        self.anchored_places = [
            (node, column)
            for node in range(structure.n_nodes)
            for column, axis in enumerate(self.axes)
            if structure.node_anchored[node, axis]
        ]

    def indices(self, nodes: list[int], axis: int) -> list[int]:
        """Return the coordinates of free `nodes` along `axis`."""
        return [self.index[node, axis] for node in nodes]

    def free(self, vectors: list[list[Scalar]]) -> ca.SX:
        """Return the free components of one vector a node, (n_coordinates, 1)."""
        column = {axis: position for position, axis in enumerate(self.axes)}
        vectors = self.gather(vectors)
        return ca.vertcat(*[vectors[node][column[axis]] for node, axis in self.index])

    def gather(self, forces: list[list[Scalar]]) -> list[list[Scalar]]:
        """Return forces on nodes with those on points of bodies moved to the corners that carry them."""
        if not self.attached:
            return forces
        result = [list(force) for force in forces]
        for node, corners in self.attached.items():
            for corner, weight in corners:
                result[corner] = [f + weight * g for f, g in zip(result[corner], forces[node], strict=True)]
        return result

    def carriers(self, node: int) -> tuple[tuple[int, float], ...]:
        """Return the nodes whose coordinates move a node, with their weights in its position."""
        return self.attached.get(node, ((node, 1),))

    def place(self, coordinate: ca.SX, fixed: list[list[Scalar]]) -> list[list[Scalar]]:
        """Return one vector a node: components of `coordinate` (n, 1) if free, else `fixed`."""
        column = {axis: position for position, axis in enumerate(self.axes)}
        result = [list(vector) for vector in fixed]
        for (node, axis), position in self.index.items():
            result[node][column[axis]] = coordinate[position]
        for node, corners in self.attached.items():
            result[node] = combine(corners, result)
        return result

    def anchored(self, vectors: list[list[Scalar]]) -> ca.SX:
        """Return the anchored components of one vector a node, (n_anchored_coordinates, 1)."""
        values = [vectors[node][column] for node, column in self.anchored_places]
        return ca.vertcat(*values) if values else ca.SX(0, 1)

    def assemble(self, blocks: Iterable[tuple[ca.SX, list[int]]]) -> ca.SX:
        """Return the sum of square blocks at their coordinates, sparse (n_coordinates, n_coordinates)."""
        entries: dict[tuple[int, int], Scalar] = {}
        for block, places in blocks:
            for r, row in enumerate(places):
                for c, column in enumerate(places):
                    if block.sparsity().has_nz(r, c):
                        self._add(entries, row, column, block[r, c])
        return self._sparse(entries, self.n_coordinates)

    def member_matrix(
        self,
        blocks: Mapping[int, MemberBlocks],
        ends: list[tuple[int, int]],
        order: Iterable[Any],
        pairs: Iterable[tuple[tuple[int, int], tuple[int, int], MemberBlocks]] = (),
    ) -> ca.SX:
        """Return the sum of [S -S; -S S] over members (i, j), sparse (n_coordinates, n_coordinates).

        blocks: S of the members that have one; ends: (i, j) of all; order: (member, end) as forces are
        added, where an end adds the columns of its node; pairs: nodes of two strands, whose S stands in rows
        of the first and columns of the second.
        """
        entries: dict[tuple[int, int], Scalar] = {}
        for e, end in order:
            if e not in blocks:
                continue
            own, far_node = ends[e][end], ends[e][1 - end]
            for r, row_axis in enumerate(self.axes):
                for c, column_axis in enumerate(self.axes):
                    for node, sign in ((own, 1), (far_node, -1)):
                        keys = ((node, row_axis), (own, column_axis))
                        self._spread(entries, *keys, blocks[e].entries[r][c], sign)
        for row_nodes, column_nodes, block in pairs:
            for (row_node, sign), (column_node, turned) in product(_signed(row_nodes), _signed(column_nodes)):
                for (r, row_axis), (c, column_axis) in product(enumerate(self.axes), repeat=2):
                    keys = ((row_node, row_axis), (column_node, column_axis))
                    self._spread(entries, *keys, block.entries[r][c], sign * turned)
        return self._sparse(entries, self.n_coordinates)

    def node_matrix(self, blocks: Mapping[int, ca.SX]) -> ca.SX:
        """Return the sum of blocks (n_axes, n_axes) of nodes, sparse (n_coordinates, n_coordinates)."""
        entries: dict[tuple[int, int], Scalar] = {}
        for node, block in blocks.items():
            for (r, row_axis), (c, column_axis) in product(enumerate(self.axes), repeat=2):
                if block.sparsity().has_nz(r, c):
                    self._spread(entries, (node, row_axis), (node, column_axis), block[r, c])
        return self._sparse(entries, self.n_coordinates)

    def _spread(
        self,
        entries: dict[tuple[int, int], Scalar],
        row_key: tuple[int, int],
        column_key: tuple[int, int],
        value: Scalar,
        sign: int = 1,
    ) -> None:
        """Add an entry at two components of nodes to the coordinates that move these."""
        pairs = product(self.carriers(row_key[0]), self.carriers(column_key[0]))
        for (row_node, p), (column_node, q) in pairs:
            row = self.index.get((row_node, row_key[1]))
            column = self.index.get((column_node, column_key[1]))
            if row is not None and column is not None:
                self._add(entries, row, column, value if p == q == 1 else p * q * value, sign)

    def member_columns(self, directions: list[list[Scalar]], ends: list[tuple[int, int]]) -> ca.SX:
        """Return one column +u at node i, -u at node j a member, sparse (n_coordinates, n_members)."""
        terms = [
            (member, node, direction, sign)
            for member, (direction, (i, j)) in enumerate(zip(directions, ends, strict=True))
            for node, sign in ((i, 1), (j, -1))
        ]
        return self.node_columns(terms, len(directions))

    def node_columns(self, terms: Iterable[tuple[int, int, list[Scalar], int]], count: int) -> ca.SX:
        """Return the sum of vectors, (column, node, vector, sign), sparse (n_coordinates, count)."""
        entries: dict[tuple[int, int], Scalar] = {}
        for column, node, vector, sign in terms:
            for (carrier, weight), (component, axis) in product(
                self.carriers(node), list(zip(vector, self.axes, strict=True))
            ):
                row = self.index.get((carrier, axis))
                if row is not None:
                    self._add(entries, row, column, component if weight == 1 else weight * component, sign)
        return self._sparse(entries, count)

    def _add(
        self, entries: dict[tuple[int, int], Scalar], row: int, column: int, value: Scalar, sign: int = 1
    ) -> None:
        present = entries.get((row, column))
        if present is None:
            entries[row, column] = value if sign > 0 else -value
        else:
            entries[row, column] = present + value if sign > 0 else present - value

    def _sparse(self, entries: dict[tuple[int, int], Scalar], columns: int) -> ca.SX:
        entry_keys = sorted(
            (key for key, value in entries.items() if not value.is_zero()), key=lambda k: (k[1], k[0])
        )
        values = [entries[key] for key in entry_keys]
        rows, cols = [key[0] for key in entry_keys], [key[1] for key in entry_keys]
        stacked = ca.vertcat(*values) if values else ca.SX(0, 1)
        return ca.SX.triplet(rows, cols, stacked, self.n_coordinates, columns)


def _signed(ends: tuple[int, int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the nodes of a strand with the signs of its vector there."""
    return (ends[0], 1), (ends[1], -1)
