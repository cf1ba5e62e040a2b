"""Sparse matrices: stiffness, damping, equilibrium, mass, and Jacobians of the state derivative.

The input Jacobian has one column an input: the effect of one unit of it on the free coordinates.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.apply_mass_inverse import ApplyMassInverse
from tensegrity_codegen.codegen.table.mass import MassDiagonal, ScaleRows, check_mass, pairs_of_coordinates
from tensegrity_codegen.codegen.table.members.access import MemberAccess, OfFreeMembers
from tensegrity_codegen.codegen.table.members.block_pattern import (
    AddBlocks,
    BlockPattern,
    ColumnPattern,
    MassGroups,
    MemberColumns,
    StoreColumns,
    check_entries,
    find_groups,
    make_pattern,
    store_recipe,
)
from tensegrity_codegen.codegen.table.members.member_loops import MemberLoop, member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Recipe, Stage, Statements, Writer, loop
from tensegrity_codegen.structure.assembly import ABSENT, MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.manifest import Pattern


def input_jacobian(model: TableModel) -> Recipe:
    """Return how dx'/du comes about: constant forces, then pulls by rest lengths, all over masses."""
    check_mass(model)
    name, count, groups = "input_jacobian", model.n_coordinates, find_groups(model)
    columns = InputColumns(model, groups=groups)
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
        stages = (
            *stages,
            ApplyMassInverse(name, "group", groups, lambda: columns.own_flat_index, columns.at),
        )
    return Recipe(
        shape,
        stages,
        find_pattern=lambda: make_pattern(shape, columns.flat_index % count + count, columns.start),
        is_empty=not len(columns.flat_index),
    )


@dataclass(frozen=True)
class InputColumns(ColumnPattern):
    """Pattern with the free coordinates that input k acts on in column k."""

    @property
    def n_columns(self) -> int:
        """One column an input."""
        return len(self.model.structure.inputs)

    @cached_property
    def pushed(self) -> tuple[IntArray, FloatArray]:
        """Key and value [N] of each component of a force that is not zero."""
        model = self.model
        components = [
            (number * model.n_coordinates + coordinate, value)
            for number, node, direction in model.force_inputs
            for coordinate, value in zip(model.coordinate[node].tolist(), direction.tolist(), strict=True)
            if coordinate >= 0 and value != 0.0
        ]
        return (
            np.array([key for key, _ in components], dtype=np.int64),
            np.array([value for _, value in components], dtype=np.float64),
        )

    @cached_property
    def own_flat_index(self) -> IntArray:
        """(n,): the same of the components that inputs act on themselves."""
        member, number, _ = self.model.rest_inputs
        coordinate = self.model.coordinate[self.model.ends[member]].reshape(-1, 2 * self.model.n_axes)
        keys = (number[:, None] * self.model.n_coordinates + coordinate)[coordinate >= 0]
        return np.unique(np.concatenate([self.pushed[0], keys]))

    def entry(self, coordinate: IntArray, number: IntArray) -> IntArray:
        """Return the entries at coordinates (n, ...) and inputs (n,), -1 if a coordinate is held."""
        return self.at(coordinate, number.reshape(-1, *(1,) * (coordinate.ndim - 1)))


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
    """Adds the effect of one metre of rest length to node i and subtracts it from j, in columns of inputs."""

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


# Zeros where the loops of a matrix add: not where one of them writes first.


@dataclass(frozen=True)
class ClearBlocks:
    """Clears the diagonal blocks of free nodes block by block, and all others entry by entry.

    sink: adds the blocks of `loops` to a matrix that begins with its pattern.
    """

    sink: AddBlocks
    loops: tuple[MemberLoop, ...]
    arguments: frozenset[str] = frozenset()
    operations: int = 0
    repeats: int = 1

    @cached_property
    def written(self) -> IntArray:
        """Members that write their blocks off the diagonal first."""
        accesses: list[MemberAccess] = [member_loop.access for member_loop in self.loops]
        members = [access.member for access in accesses if self.sink.writes_first(access)]
        return np.concatenate([np.zeros(0, dtype=np.int64), *members])

    def write(self, writer: Writer) -> list[str]:
        """Return the loops; one over all entries where few of them are written first."""
        target, zero = self.sink.target, writer.number(0.0)
        coordinate, pattern = self.sink.pattern.model.coordinate, self.sink.pattern
        count, size = len(pattern.flat_index), range(pattern.model.n_axes)
        node = np.unique(pattern.model.ends[self.written])
        coordinates = coordinate[node, 0]
        length = np.diff(pattern.start)[coordinates]
        start = pattern.at(coordinates, coordinates)
        remaining = self._left(np.concatenate([start + r + c * length for c in size for r in size]))
        if 2 * len(remaining) > count:
            return loop("k", count, [f"{target}[k] = {zero};"])
        clearing = (
            [f"{target}[{writer.index_at(f'{target}_left', remaining, 'k')}] = {zero};"]
            if len(remaining)
            else []
        )
        entries = loop("k", len(remaining), clearing) if clearing else []
        if not len(node):
            return entries
        lines = [
            f"{writer.real} *const block = {target} + {writer.index_at(f'{target}_node', start, 'k')};",
            *(
                [f"const int length = {writer.index_at(f'{target}_length', length, 'k')};"]
                if size[1:]
                else []
            ),
            *(f"block[{_at(c, r)}] = {zero};" for c in size for r in size),
        ]
        return [*loop("k", len(node), lines), *entries]

    def _left(self, cleared: IntArray) -> IntArray:
        """Return the entries that are neither cleared nor written first."""
        pattern = self.sink.pattern
        is_left = np.ones(len(pattern.flat_index), dtype=bool)
        is_left[cleared] = False
        coordinate = pattern.model.coordinate
        for row, column in pattern.block_nodes(self.written)[1::2]:
            is_left[pattern.at(coordinate[row][:, None, :], coordinate[column][:, :, None])] = False
        return np.flatnonzero(is_left)


def _at(c: int, r: int) -> str:
    terms = [*(["length"] if c == 1 else [f"{c} * length"] if c else []), *([str(r)] if r else [])]
    return " + ".join(terms) or "0"


def _is_damped(group: MemberGroup) -> bool:
    return group.member_class.damping != ABSENT


def _damped(model: TableModel) -> IntArray:
    groups = [group.member for group in model.plan.groups if _is_damped(group)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *groups])


def _fill_zero(target: str, count: Callable[[], int]) -> Statements:
    return Statements(lambda: loop("k", count(), [f"{target}[k] = @ZERO@;"]))


def _is_finite(target: str, pattern: BlockPattern) -> Statements:
    """Return the check for finite results: where all blocks are small, no sum of some of them overflows."""
    return Statements(lambda: [f"return size < @SAFE@ || all_finite({target}, {len(pattern.flat_index)});"])


def _member_matrix(quantity: str, kernel: str, damped: bool = False) -> Callable[[TableModel], Recipe]:
    """Return the builder of a sum of member blocks, of the damped members alone or of all."""

    def build(model: TableModel) -> Recipe:
        count = model.n_coordinates
        pattern = BlockPattern(model, _damped(model) if damped else model.plan.member)
        sink = AddBlocks(quantity, pattern, size="size")
        loops = member_loops(model, kernel, sink, _is_damped if damped else lambda group: True)
        return Recipe(
            (count, count),
            (ClearBlocks(sink, tuple(loops)), *loops, _is_finite(quantity, pattern)),
            before=("@REAL@ size = @ZERO@;",),
            is_checked=True,
            find_pattern=lambda: make_pattern((count, count), pattern.row, pattern.start),
            is_empty=not loops,
        )

    return build


def _equilibrium_matrix(model: TableModel) -> Recipe:
    columns = MemberColumns(model)
    loops = member_loops(model, "direction", StoreColumns("equilibrium_matrix", columns))
    return store_recipe((model.n_coordinates, model.structure.n_members), loops, columns)


def _rest_length_jacobian(model: TableModel) -> Recipe:
    check_mass(model)
    name, count, groups = "rest_length_jacobian", model.n_coordinates, find_groups(model)
    columns = MemberColumns(model, groups=groups)
    loops = member_loops(model, "rest_pull", StoreColumns(name, columns))
    shape = (2 * count, model.structure.n_members)
    stages: tuple[Stage, ...] = (*loops, ScaleRows(model, name, (0, shape[1])))
    if groups is not None:
        check_entries(model, name, len(columns.row))
        mix = ApplyMassInverse(name, "group", groups, lambda: columns.own_flat_index, columns.at)
        stages = (_fill_zero(name, lambda: len(columns.row)), *stages, mix)
    return Recipe(
        shape,
        stages if loops else (),
        find_pattern=lambda: make_pattern(shape, columns.row + count, columns.start),
        is_empty=not loops,
    )


def _mass_matrix(model: TableModel) -> Recipe:
    check_mass(model)
    count = model.n_coordinates
    first, second, _ = pairs_of_coordinates(model)
    here = np.arange(count)
    row = np.concatenate([here, first, second])
    column = np.concatenate([here, second, first])
    key = np.sort(column * count + row)
    pattern = make_pattern((count, count), key % count, np.searchsorted(key, np.arange(count + 1) * count))
    return Recipe((count, count), (MassDiagonal(model, "mass_matrix", key),), find_pattern=lambda: pattern)


def _state_jacobian(model: TableModel) -> Recipe:
    check_mass(model)
    name, count, groups = "state_jacobian", model.n_coordinates, find_groups(model)
    stiff = BlockPattern(model, model.plan.member, groups=groups)
    damped = BlockPattern(model, _damped(model), groups=groups)
    added, rates = AddBlocks(name, stiff), AddBlocks(name, damped, before=stiff)
    if groups is not None:
        check_entries(model, name, len(stiff.flat_index) + len(damped.flat_index))

    # Columns of q: -H^-1 K; columns of q': an entry of the identity, then -H^-1 C
    def pattern() -> Pattern:
        identity = np.insert(damped.row + count, damped.start[:-1], np.arange(count))
        late = len(stiff.flat_index) + damped.start + np.arange(count + 1)
        start = np.concatenate([stiff.start[:-1], late])
        return make_pattern((2 * count, 2 * count), np.concatenate([stiff.row + count, identity]), start)

    one = f"{name}[{model.name}_{name}_column_start[{count} + k]] = @ONE@;"
    stages: tuple[Stage, ...] = (
        _fill_zero(name, lambda: len(stiff.flat_index) + len(damped.flat_index) + count),
        *member_loops(model, "position_block", added),
        *member_loops(model, "rate_block", rates, _is_damped),
        ScaleRows(model, name, (0, count), turn=True),
        ScaleRows(model, name, (count, 2 * count), turn=True, skip=1),
        *_mix_blocks(groups, added, "position"),
        *_mix_blocks(groups, rates, "rate"),
        Statements.loop("k", count, [one]),
    )
    return Recipe((2 * count, 2 * count), stages, find_pattern=pattern)


def _mix_blocks(groups: MassGroups | None, sink: AddBlocks, name: str) -> tuple[ApplyMassInverse, ...]:
    """Return the stage that multiplies the blocks of a sink by H^-1 of coupled nodes, if any."""
    if groups is None:
        return ()
    return (ApplyMassInverse(sink.target, name, groups, lambda: sink.pattern.own_flat_index, sink.entry),)


MATRICES: Mapping[str, Callable[[TableModel], Recipe]] = {
    "mass_matrix": _mass_matrix,
    "material_stiffness": _member_matrix("material_stiffness", "material_block"),
    "geometric_stiffness": _member_matrix("geometric_stiffness", "geometric_block"),
    "tangent_stiffness": _member_matrix("tangent_stiffness", "tangent_block"),
    "damping_matrix": _member_matrix("damping_matrix", "rate_block", damped=True),
    "equilibrium_matrix": _equilibrium_matrix,
    "state_jacobian": _state_jacobian,
    "input_jacobian": input_jacobian,
    "rest_length_jacobian": _rest_length_jacobian,
}
