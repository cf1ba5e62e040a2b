"""Shared text of the loops over repeated modules of one shape: chunks, lines, places, values."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.structure.repeated_modules import MAX_SHIFT_GAP, Module
from tensegrity_codegen.system.arrays import IntArray

STEP = 8  # repetitions; chunks are made of so many
FAST_BYTES = 40_000  # what lines of a chunk may take, to stay in the fastest memory
LONGEST_CHUNK = 64


def shapes_of(model: TableModel) -> list[list[Module]]:
    """Return the modules of a plan, those of one shape together, in their order."""
    found: dict[object, list[Module]] = {}
    for module in model.plan.modules:
        found.setdefault(module.shape, []).append(module)
    return list(found.values())


@dataclass(frozen=True)
class ModuleText:
    """Modules of one shape, number `number`; in C, `g` counts them, `n` is the number of repetitions.

    lines: lines of a chunk, one for each value that a repetition keeps; widest: values of the widest row.
    """

    model: TableModel
    number: int
    modules: tuple[Module, ...]
    lines: int
    widest: int

    @property
    def name(self) -> str:
        """Beginning of the names of tables."""
        return f"module{self.number}"

    @property
    def first(self) -> Module:
        """Any of the modules: they have one shape."""
        return self.modules[0]

    @cached_property
    def extent(self) -> int:
        """How far the longest column goes beyond the repetitions."""
        return max(self.first.extent)

    @cached_property
    def chunk(self) -> int:
        """Repetitions of one chunk: as many as fit, in chunks of about equal length."""
        most = (FAST_BYTES // 8 - self.lines * (MAX_SHIFT_GAP + self.widest)) // self.lines
        most = max(2 * STEP, min(LONGEST_CHUNK, most // STEP * STEP))
        total = max(module.n_repetitions for module in self.modules) + self.extent
        return -(-total // -(-total // most) // STEP) * STEP

    @property
    def room(self) -> int:
        """Length of a line."""
        # An odd number of cache lines: lines an even number apart would share few places in the cache.
        length = self.chunk + MAX_SHIFT_GAP + self.widest
        return length + (8 if length % 16 == 0 else 0)

    def strands(self) -> list[tuple[int, int, int]]:
        """Return each class of members with its strands: class, first strand, behind the last."""
        kinds, first, count = np.unique(self.first.kind, return_index=True, return_counts=True)
        return [(int(k), int(f), int(f + c)) for k, f, c in zip(kinds, first, count, strict=True)]

    @property
    def n_columns(self) -> int:
        """Number of columns."""
        return len(self.first.column)

    @property
    def line_of(self) -> IntArray:
        """(n_strands, 2): entry of a chunk's lines at which each end's first repetition stands."""
        place: IntArray = self.first.place
        return place[:, :, 0] * self.model.n_axes * self.room + place[:, :, 1]

    def repetitions(self, writer: Writer) -> str:
        """Return the C expression of the number of repetitions."""
        count = np.array([module.n_repetitions for module in self.modules])
        return writer.index_at(f"{self.name}_repetitions", count, "g")

    def column(self, column: str) -> str:
        """Return the C expression of the number of a column among those of all modules."""
        return column if len(self.modules) == 1 else f"({self.n_columns} * g + {column})"

    def places(self, writer: Writer, name: str, index: IntArray) -> Callable[[str, str], str]:
        """Return what C functions over nodes take as places of a column, given which and how far along it.

        index: (n_nodes,) first entry of each node in the array that is read or written.
        """
        lists = [index[nodes] for module in self.modules for nodes in module.column]
        step = common_step(lists)
        if step is not None:
            first = np.array([item[0] for item in lists])
            return lambda column, k: (
                f"NULL, {writer.index_at(f'{self.name}_{name}_first', first, self.column(column))}"
                f" + {step} * ({k}), {step}"
            )
        table = writer.integers(f"{self.name}_{name}_place", np.concatenate(lists))
        start = np.cumsum([0, *map(len, lists[:-1])])
        return lambda column, k: (
            f"{table} + {writer.index_at(f'{self.name}_{name}_start', start, self.column(column))}"
            f" + {k}, 0, 0"
        )


def common_step(lists: Sequence[IntArray]) -> int | None:
    """Return the step by which all lists of places advance, None if they do not."""
    step = int(lists[0][1] - lists[0][0])
    even = all(np.array_equal(item, item[0] + step * np.arange(len(item))) for item in lists)
    return step if even else None
