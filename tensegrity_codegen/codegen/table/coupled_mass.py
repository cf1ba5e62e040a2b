"""Accelerations of nodes that bars with own mass couple: sparse factors as tables."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.mass import coupled_coordinates
from tensegrity_codegen.codegen.table.members.block_pattern import check_constant_masses
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.structure.symmetric_factor import SymmetricFactor, factorise
from tensegrity_codegen.system.arrays import FloatArray, IntArray

Sweep = tuple[IntArray, IntArray, FloatArray]  # target, source, factor


@dataclass(frozen=True)
class SolveCoupled:
    """Solves H x = f in place in `target`, for the coordinates that bars couple; masses are constants."""

    model: TableModel
    target: str

    def __post_init__(self) -> None:
        check_constant_masses(self.model, coupled_coordinates(self.model))

    @property
    def arguments(self) -> frozenset[str]:
        """No argument."""
        return frozenset()

    @property
    def operations(self) -> int:
        """Two operations for each factor, there and back, and one division a coordinate."""
        forward, _, pivot = self._sweeps
        return 4 * len(forward[0]) + len(pivot[0])

    @cached_property
    def _sweeps(self) -> tuple[Sweep, Sweep, tuple[IntArray, FloatArray]]:
        """Forward and backward substitution over all groups and axes, and the pivots."""
        forward, backward, pivots = [], [], []
        known: dict[tuple[int, ...], SymmetricFactor] = {}
        for column, axis in enumerate(self.model.axes):
            coordinate = self.model.coordinate[:, column]
            pair, between, groups = self.model.inertia.coupled(axis)
            there, pivot = self._of_pairs(coordinate[pair], pair, between)
            forward.append(there)
            backward.append(there[:, [1, 0, 2]])
            pivots.append(pivot)
            for group in groups:
                nodes = tuple(group)
                known[nodes] = known.get(nodes) or factorise(
                    self._mass[list(nodes)].tolist(), self.model.inertia.coupling_of(nodes)
                )
                there, back, pivot = _sweep_group(known[nodes], coordinate[group].tolist())
                forward.append(there)
                backward.append(back)
                pivots.append(pivot)
        pivot = np.concatenate(pivots)
        pivot = pivot[np.argsort(pivot[:, 0], kind="stable")]
        return _sweep(forward), _sweep(backward), (pivot[:, 0].astype(np.int64), pivot[:, 1])

    @cached_property
    def _mass(self) -> FloatArray:
        mass: FloatArray = self.model.structure.node_mass + self.model.inertia.diagonal_share
        return mass

    def _of_pairs(self, at: IntArray, pair: IntArray, between: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (n, 3) target, source and factor, and (2 n, 2) place and pivot, of groups of two nodes."""
        first, second = self._mass[pair].T
        factor = between / first
        there = np.column_stack([at[:, 1], at[:, 0], factor])
        pivot = np.column_stack([at.T.reshape(-1), np.concatenate([first, second - factor * between])])
        return there, pivot

    @property
    def repeats(self) -> int:
        """Coupled coordinates."""
        return len(self._sweeps[2][0])

    def write(self, writer: Writer) -> list[str]:
        """Return the loops: forward, divide, backward."""
        forward, backward, (at, value) = self._sweeps
        if not len(at):
            return []
        place = writer.index_at("coupled_coordinate", at, "k")
        divide = f"{self.target}[{place}] /= {writer.real_at('coupled_pivot', value, 'k')};"
        return [
            *self._substitute(writer, "forward", forward),
            *loop("k", len(at), [divide]),
            *self._substitute(writer, "backward", backward),
        ]

    def _substitute(self, writer: Writer, name: str, sweep: Sweep) -> list[str]:
        target, source, factor = sweep
        to = f"{self.target}[{writer.index_at(f'{name}_target', target, 'k')}]"
        from_ = f"{self.target}[{writer.index_at(f'{name}_source', source, 'k')}]"
        by = writer.real_at(f"{name}_factor", factor, "k")
        return loop("k", len(target), [f"{to} -= {by} * {from_};"])


def _sweep_group(factor: SymmetricFactor, at: list[int]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return forward and backward rows (n, 3) of target, source and factor, and (n, 2) places and pivots."""
    columns = list(zip(factor.order, factor.below, strict=True))
    forward = [(at[row], at[k], value) for k, below in columns for row, value in below]
    backward = [(at[k], at[row], value) for k, below in reversed(columns) for row, value in below]
    pivots = [(at[k], value) for k, value in zip(factor.order, factor.pivot, strict=True)]
    return np.array(forward), np.array(backward), np.array(pivots)


def _sweep(parts: list[FloatArray]) -> Sweep:
    table = np.concatenate(parts)
    return table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2]
