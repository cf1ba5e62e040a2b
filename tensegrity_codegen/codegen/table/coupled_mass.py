"""Accelerations of nodes that bars with own mass couple: sparse factors as tables."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.mass import coupled_coordinates
from tensegrity_codegen.codegen.table.model import FloatArray, IntArray, TableModel
from tensegrity_codegen.codegen.table.stage import loop
from tensegrity_codegen.codegen.table.writer import Writer
from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.symmetric_factor import SymmetricFactor, factorise

__all__ = ["SolveCoupled"]

Sweep = tuple[IntArray, IntArray, FloatArray]  # target, source, factor


@dataclass(frozen=True)
class SolveCoupled:
    """Solves H x = f in place in `target`, for the coordinates that bars couple; masses are constants."""

    model: TableModel
    target: str

    def __post_init__(self) -> None:
        node = np.nonzero(self.model.free)[0][coupled_coordinates(self.model)]
        chosen = node[self.model.argument_index("node_mass")[node] >= 0]
        if len(chosen):
            names = [self.model.structure.node_name[k] for k in np.unique(chosen)[:5]]
            raise FormulationError(
                "the emitter 'table' has no run-time masses of nodes that bars with own mass couple",
                where=f"{self.model.name}: parameters.node_mass",
                given=", ".join(names),
                hint='leave these nodes out of node_mass, or emitter = "unrolled"',
            )

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
        forward: list[tuple[int, int, float]] = []
        backward: list[tuple[int, int, float]] = []
        pivots: list[tuple[int, float]] = []
        known: dict[tuple[int, ...], SymmetricFactor] = {}
        mass = self.model.structure.node_mass + self.model.inertia.diagonal_share
        for column, axis in enumerate(self.model.axes):
            coordinate = self.model.coordinate[:, column].tolist()
            for nodes in (tuple(group) for group in self.model.inertia.groups(axis) if len(group) > 1):
                if nodes not in known:
                    known[nodes] = factorise(
                        mass[list(nodes)].tolist(), self.model.inertia.coupling_of(nodes)
                    )
                factor, at = known[nodes], [coordinate[node] for node in nodes]
                columns = list(zip(factor.order, factor.below, strict=True))
                forward += [(at[row], at[k], value) for k, below in columns for row, value in below]
                backward += [
                    (at[k], at[row], value) for k, below in reversed(columns) for row, value in below
                ]
                pivots += [(at[k], value) for k, value in zip(factor.order, factor.pivot, strict=True)]
        pivots.sort()
        place = np.array([k for k, _ in pivots], dtype=np.int64)
        return _sweep(forward), _sweep(backward), (place, np.array([value for _, value in pivots]))

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


def _sweep(rows: list[tuple[int, int, float]]) -> Sweep:
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2]
