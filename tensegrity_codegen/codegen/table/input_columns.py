"""One column an input: what one unit of it does to the free coordinates, in a sparse matrix."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.mass import ScaleRows, check_mass
from tensegrity_codegen.codegen.table.members.access import MemberAccess, OfFreeMembers
from tensegrity_codegen.codegen.table.members.block_pattern import (
    MassGroups,
    check_entries,
    find_groups,
    make_pattern,
)
from tensegrity_codegen.codegen.table.members.member_loops import member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import Recipe, Stage, loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.mix_rows import MixRows
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import FloatArray, IntArray


def input_jacobian(model: TableModel) -> Recipe:
    """Return how dx'/du comes about: constant forces, then pulls by rest lengths, all over masses."""
    check_mass(model)
    name, count, groups = "input_jacobian", model.n_coordinates, find_groups(model)
    columns = InputColumns(model, groups)
    shape = (2 * count, len(model.structure.inputs))
    stages: tuple[Stage, ...] = (
        FillPushes(name, columns),
        *member_loops(
            model, "rest_pull", AddPulls(name, columns), lambda group: group.member_class.n_inputs > 0
        ),
        ScaleRows(model, name, (0, shape[1])),
    )
    if groups is not None:
        check_entries(model, name, len(columns.flat_index))
        stages = (*stages, MixRows(name, "group", groups, lambda: columns.own_flat_index, columns.at))
    return Recipe(
        shape,
        stages,
        find_pattern=lambda: make_pattern(shape, columns.flat_index % count + count, columns.start),
        is_empty=not len(columns.flat_index),
    )


@dataclass(frozen=True)
class InputColumns:
    """Pattern with the free coordinates that input k acts on in column k.

    groups: of coupled nodes whose rows are filled where a node is in one of them, for a product with H^-1.
    """

    model: TableModel
    groups: MassGroups | None = None

    @cached_property
    def pushed(self) -> tuple[IntArray, FloatArray]:
        """Key and value [N] of each component of a force that is not zero."""
        model = self.model
        found = [
            (number * model.n_coordinates + coordinate, value)
            for number, node, direction in model.force_inputs
            for coordinate, value in zip(model.coordinate[node].tolist(), direction.tolist(), strict=True)
            if coordinate >= 0 and value != 0.0
        ]
        return (
            np.array([key for key, _ in found], dtype=np.int64),
            np.array([value for _, value in found], dtype=np.float64),
        )

    @cached_property
    def flat_index(self) -> IntArray:
        """(nnz,): input times n_coordinates plus row of each entry, column by column."""
        return self.own_flat_index if self.groups is None else self.groups.expand(self.own_flat_index)

    @cached_property
    def own_flat_index(self) -> IntArray:
        """(n,): the same of the components that inputs act on themselves."""
        member, number, _ = self.model.rest_inputs
        coordinate = self.model.coordinate[self.model.ends[member]].reshape(-1, 2 * self.model.n_axes)
        keys = (number[:, None] * self.model.n_coordinates + coordinate)[coordinate >= 0]
        return np.unique(np.concatenate([self.pushed[0], keys]))

    @cached_property
    def start(self) -> IntArray:
        """(n_inputs + 1,): first entry of each column."""
        count = len(self.model.structure.inputs)
        return np.searchsorted(self.flat_index, np.arange(count + 1) * self.model.n_coordinates)

    def at(self, row: IntArray, number: IntArray) -> IntArray:
        """Return the entries at rows and columns."""
        return np.searchsorted(self.flat_index, number * self.model.n_coordinates + row)

    def entry(self, coordinate: IntArray, number: IntArray) -> IntArray:
        """Return the entries at coordinates (n, ...) and inputs (n,), -1 where a coordinate is held."""
        shaped = number.reshape(-1, *(1,) * (coordinate.ndim - 1))
        found = np.searchsorted(self.flat_index, shaped * self.model.n_coordinates + coordinate)
        return np.where(coordinate >= 0, found, -1)


@dataclass(frozen=True)
class FillPushes:
    """Fills the values `target` with the directions of forces, and zeros where pulls are added."""

    target: str
    columns: InputColumns
    arguments: frozenset[str] = frozenset()
    operations: int = 0
    repeats: int = 1

    def write(self, writer: Writer) -> list[str]:
        """Return the loop over all entries."""
        key, (pushed, value) = self.columns.flat_index, self.columns.pushed
        values = np.zeros(len(key))
        np.add.at(values, np.searchsorted(key, pushed), value)
        return loop("k", len(key), [f"{self.target}[k] = {writer.real_at('input_push', values, 'k')};"])


@dataclass(frozen=True)
class AddPulls(OfFreeMembers):
    """Adds what one metre of rest length does to node i, and takes it from node j, in columns of inputs."""

    target: str
    columns: InputColumns

    def operations(self, kernel: MemberKernel) -> int:
        """Return one addition for each component of both ends."""
        return 2 * kernel.size

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the additions: input by input, to node i and then to node j."""
        coordinate, size = self.columns.model.coordinate[access.model.ends[access.member]], len(results)
        lines = []
        for number, gain in access.inputs:
            entry = self.columns.entry(coordinate, number)
            table = writer.integers(f"{access.name}_{self.target}_entry", entry)
            for end, sign in ((0, "+"), (1, "-")):
                for k in range(size):
                    at = f"{table}[{2 * size} * e + {end * size + k}]"
                    pull = writer.scaled(f"{access.name}_{self.target}_gain", gain, "e", results[k])
                    lines.append(f"if ({at} >= 0) {{ {self.target}[{at}] {sign}= {pull}; }}")
        return lines
