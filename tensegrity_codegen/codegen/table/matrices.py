"""Sparse matrices: stiffness, damping, equilibrium, mass, and Jacobians of the state derivative."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.input_columns import input_jacobian
from tensegrity_codegen.codegen.table.mass import (
    MassDiagonal,
    ScaleRows,
    check_mass,
    pairs_of_coordinates,
)
from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.block_pattern import (
    AddBlocks,
    BlockPattern,
    MassGroups,
    check_entries,
    find_groups,
    make_pattern,
)
from tensegrity_codegen.codegen.table.members.columns import MemberColumns, StoreColumns, store_recipe
from tensegrity_codegen.codegen.table.members.member_loops import MemberLoop, member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import Recipe, Stage, Statements, loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.mix_rows import MixRows
from tensegrity_codegen.structure.assembly import ABSENT, MemberGroup
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import Pattern

# Zeros where the loops of a matrix add: not where one of them writes first.


@dataclass(frozen=True)
class ClearBlocks:
    """Clears the diagonal blocks of free nodes block by block, and what is left entry by entry.

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
        accesses: list[MemberAccess] = [item.access for item in self.loops]
        members = [access.member for access in accesses if self.sink.writes_first(access)]
        return np.concatenate([np.zeros(0, dtype=np.int64), *members])

    def write(self, writer: Writer) -> list[str]:
        """Return the loops; one over all entries where few of them are written first."""
        target, zero = self.sink.target, writer.number(0.0)
        coordinate, pattern = self.sink.pattern.model.coordinate, self.sink.pattern
        count, size = len(pattern.flat_index), range(pattern.model.n_axes)
        node = np.unique(pattern.model.ends[self.written])
        first = coordinate[node, 0]
        length = np.diff(pattern.column_start)[first]
        start = pattern.entry(first, first)
        left = self._left(np.concatenate([start + r + c * length for c in size for r in size]))
        if 2 * len(left) > count:
            return loop("k", count, [f"{target}[k] = {zero};"])
        rest = [f"{target}[{writer.index_at(f'{target}_left', left, 'k')}] = {zero};"] if len(left) else []
        entries = loop("k", len(left), rest) if rest else []
        if not len(node):
            return entries
        lines = [
            f"{writer.real} *const block = {target} + {writer.index_at(f'{target}_node', start, 'k')};",
            f"const int length = {writer.index_at(f'{target}_length', length, 'k')};",
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
            is_left[pattern.entry(coordinate[row][:, None, :], coordinate[column][:, :, None])] = False
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
    """Return what is returned: where the sizes of all blocks are small, no sum of some of them overflows."""
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
            find_pattern=lambda: make_pattern((count, count), pattern.row, pattern.column_start),
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
    columns = MemberColumns(model, groups)
    loops = member_loops(model, "rest_pull", StoreColumns(name, columns))
    shape = (2 * count, model.structure.n_members)
    stages: tuple[Stage, ...] = (*loops, ScaleRows(model, name, (0, shape[1])))
    if groups is not None:
        check_entries(model, name, len(columns.row))
        mix = MixRows(name, "group", groups, lambda: columns.own_flat_index, columns.at)
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
    stiff = BlockPattern(model, model.plan.member, groups)
    damped = BlockPattern(model, _damped(model), groups)
    added, rates = AddBlocks(name, stiff), AddBlocks(name, damped, before=stiff)
    if groups is not None:
        check_entries(model, name, len(stiff.flat_index) + len(damped.flat_index))

    def pattern() -> Pattern:
        identity = np.insert(damped.row + count, damped.column_start[:-1], np.arange(count))
        late = len(stiff.flat_index) + damped.column_start + np.arange(count + 1)
        start = np.concatenate([stiff.column_start[:-1], late])
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


def _mix_blocks(groups: MassGroups | None, sink: AddBlocks, name: str) -> tuple[MixRows, ...]:
    """Return what multiplies the blocks of a sink by H^-1 of coupled nodes, if there are any."""
    if groups is None:
        return ()
    return (MixRows(sink.target, name, groups, lambda: sink.pattern.own_flat_index, sink.entry),)


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
