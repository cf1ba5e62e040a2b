"""Zeros where the loops of a matrix add: not where one of them writes first."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.blocks import AddBlocks
from tensegrity_codegen.codegen.table.members.member_loops import MemberLoop
from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.blocks import ModuleBlocks
from tensegrity_codegen.system.arrays import IntArray


@dataclass(frozen=True)
class ClearBlocks:
    """Clears the diagonal blocks of free nodes block by block, and what is left entry by entry.

    sink: adds the blocks of `modules` and of `loops` to a matrix that begins with its pattern.
    """

    sink: AddBlocks
    loops: tuple[MemberLoop, ...]
    modules: ModuleBlocks
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
        count, size = len(pattern.key), range(pattern.model.n_axes)
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
        is_left = np.ones(len(pattern.key), dtype=bool)
        is_left[cleared] = False
        is_left[self.modules.entries_set()] = False
        coordinate = pattern.model.coordinate
        for row, column in pattern.block_nodes(self.written)[1::2]:
            is_left[pattern.entry(coordinate[row][:, None, :], coordinate[column][:, :, None])] = False
        return np.flatnonzero(is_left)


def _at(c: int, r: int) -> str:
    terms = [*(["length"] if c == 1 else [f"{c} * length"] if c else []), *([str(r)] if r else [])]
    return " + ".join(terms) or "0"
