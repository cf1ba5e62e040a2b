"""Access of the loop over some members of a group: operands of their kernel, use of its results."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Writer, in_axes, only_where
from tensegrity_codegen.structure.assembly import ARGUMENT, MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import VECTORS, MemberKernel
from tensegrity_codegen.system.arrays import FloatArray, IntArray


class MemberAccess:
    """Reading of members, a subset of `group` in its order, with a counter `e` over them.

    Both nodes free: three coordinates in a row from an offset. Else one place for each component, which is
    that of a coordinate or of a held position.
    """

    def __init__(self, model: TableModel, name: str, group: MemberGroup, member: IntArray) -> None:
        self.model = model
        self.group = group
        self.member = member
        self.name = name

    @cached_property
    def place(self) -> IntArray:
        """(n, 2, n_axes): place of each component of both ends, see TableModel.place."""
        return self.model.place[self.model.ends[self.member]]

    def arguments(self, kernel: MemberKernel) -> frozenset[str]:
        """Return the names of the arguments that these members' kernel reads."""
        cls, used = self.group.member_class, set()
        for name in kernel.inputs:
            if name == "vector":
                used |= {"coordinate"} if (self.place >= 0).any() else set()
                used |= held_arguments(self.model, self.place)
            elif name == "vector_rate":
                used |= {"velocity"} if (self.place >= 0).any() else set()
            elif name != "mu":
                used |= {name} if cls.source(name) == ARGUMENT else set()
                used |= {"input"} if name == "rest_length" and cls.n_inputs else set()
        return frozenset(used)

    def declarations(self, writer: Writer, kernel: MemberKernel) -> list[str]:
        """Return the statements that the loop of a kernel begins with: the offsets of both ends, if read."""
        if not self.group.is_interior or not set(VECTORS).intersection(kernel.inputs):
            return []
        ends = [writer.index_at(f"{self.name}_{'ij'[end]}", self.place[:, end, 0], "e") for end in (0, 1)]
        return [f"const int i = {ends[0]}, j = {ends[1]};"]

    def values(self, writer: Writer, kernel: MemberKernel) -> list[str]:
        """Return the C expressions of all scalars that the kernel takes."""
        texts: list[str] = []
        for name in kernel.inputs:
            if name in VECTORS:
                start, end = (self._of_end(writer, end, is_rate=name == "vector_rate") for end in (0, 1))
                texts += [f"{x} - {y}" for x, y in zip(start, end, strict=True)]
            else:
                texts.append(self._value(writer, name))
        return texts

    def _of_end(self, writer: Writer, end: int, is_rate: bool) -> list[str]:
        axes = range(self.model.n_axes)
        array = "velocity" if is_rate else "coordinate"
        if self.group.is_interior:
            return [f"{array}[{'ij'[end]}{f' + {k}' if k else ''}]" for k in axes]
        table = writer.integers(f"{self.name}_place", self.place)
        texts, size = [], 2 * self.model.n_axes
        for k in axes:
            at = f"{table}[{size} * e + {end * self.model.n_axes + k}]"
            is_free = (self.place[:, end, k] >= 0).all()
            texts.append(f"{array}[{at}]" if is_free else f"{position_reader(writer, is_rate)}{at})")
        return texts

    def _value(self, writer: Writer, name: str) -> str:
        """Return the C expression of a scalar of the member."""
        table = f"{self.name}_{name}"
        if name != "mu" and self.group.member_class.source(name) == ARGUMENT:
            index = self.model.argument_index(name)[self.member]
            text = f"{name}[{writer.index_at(f'{table}_at', index, 'e')}]"
        else:
            text = writer.real_at(table, self._constant(name), "e")
        return text + self._changes(writer) if name == "rest_length" else text

    def _constant(self, name: str) -> FloatArray:
        """Return the scene's own values of the members, "mu" from both stiffnesses."""
        structure = self.model.structure
        values: FloatArray = structure.mu if name == "mu" else structure.member_value(name)
        return values[self.member]

    def _changes(self, writer: Writer) -> str:
        """Return the terms that inputs add to a rest length, in the order of the inputs."""
        texts = []
        for column, gain in self.inputs:
            text = f"input[{writer.index_at(f'{self.name}_input', column, 'e')}]"
            texts.append(" + " + writer.scaled(f"{self.name}_gain", gain, "e", text))
        return "".join(texts)

    @property
    def inputs(self) -> list[tuple[IntArray, FloatArray]]:
        """The inputs that change the rest length of each member, and their gains: first, second and so on."""
        member, number, gain = self.model.rest_inputs
        start = np.searchsorted(member, self.member)
        return [(number[start + k], gain[start + k]) for k in range(self.group.member_class.n_inputs)]


def held_arguments(model: TableModel, position_index: IntArray) -> set[str]:
    """Return {"anchor_position"} if some of these places are entries of that argument, else nothing."""
    held = -1 - position_index
    return {"anchor_position"} if ((held >= 0) & (held < model.n_held_arguments)).any() else set()


def vector_texts(writer: Writer, name: str, position_index: IntArray, is_rate: bool = False) -> list[str]:
    """Return the C expressions of positions or rates of node `n`; position_index: see TableModel.place."""
    n_axes = position_index.shape[1]
    if (position_index[:, 0] >= 0).all() and (
        position_index == position_index[:, :1] + np.arange(n_axes)
    ).all():
        start = writer.index_at(f"{name}_coordinate", position_index[:, 0], "n")
        return [f"{'velocity' if is_rate else 'coordinate'}[{start} + {k}]" for k in range(n_axes)]
    at, read = writer.integers(f"{name}_place", position_index), position_reader(writer, is_rate)
    return [f"{read}{at}[{n_axes} * n + {k}])" for k in range(n_axes)]


def position_reader(writer: Writer, is_rate: bool) -> str:
    """Return the beginning of a call that reads a place: of a position, or of its rate."""
    model = writer.model
    if is_rate:
        symbol = writer.helper(
            "rate_at", "table_position.c", what="Rate of a free coordinate, zero at an anchor.",
            from_argument=False, from_constants=False, zero=writer.number(0.0),
        )  # fmt: skip
        return f"{symbol}(velocity, "
    from_argument, from_constants = model.n_held_arguments > 0, model.held_position.size > 0
    symbol = writer.helper(
        "position_at", "table_position.c", what="Position of a free coordinate or of an anchor.",
        from_argument=from_argument, from_constants=from_constants, n_argument=model.n_held_arguments,
        constants=writer.reals("held_position", model.held_position) if from_constants else "",
    )  # fmt: skip
    return f"{symbol}(coordinate, anchor_position, " if from_argument else f"{symbol}(coordinate, "


class Sink(Protocol):
    """The use of the results of a member's kernel.

    select: those of some members that it wants anything of; operations: for each of them.
    """

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return those of `member` that it wants anything of."""

    def operations(self, kernel: MemberKernel) -> int:
        """Return the floating-point operations for one member."""

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the statements after the kernel's call, with its results by name."""


class OfFreeMembers:
    """A sink that wants the members with a free coordinate."""

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the members with a free coordinate."""
        return member[np.any(model.coordinate[model.ends[member]] >= 0, axis=(1, 2))]


@dataclass(frozen=True)
class AddToNodes:
    """Takes a pull from node i and gives it to node j.

    target: C name of the array; index: (n_nodes, n_axes) entries of the array, -1 if there is none.
    """

    target: str
    index: IntArray

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the members with an end whose entries are in the array."""
        return member[np.any(self.index[model.ends[member]] >= 0, axis=(1, 2))]

    def operations(self, kernel: MemberKernel) -> int:
        """Return one addition for each component of both ends."""
        return 2 * kernel.size

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the additions: first to node i, then to node j."""
        entry = self.index[access.model.ends[access.member]]
        lines = []
        for end, sign in ((0, "-"), (1, "+")):
            lines += self._add(writer, access, entry, end, sign, results)
        return lines

    def _add(
        self, writer: Writer, access: MemberAccess, entry: IntArray, end: int, sign: str, results: list[str]
    ) -> list[str]:
        axes = np.arange(entry.shape[2])
        if (entry[:, end] < 0).all():
            return []
        if (entry[:, end] >= 0).all() and (entry[:, end] == entry[:, end, :1] + axes).all():
            start = writer.listed_at(f"{access.name}_{self.target}_{'ij'[end]}", entry[:, end, 0], "e")
            return in_axes(f"{self.target}[{start}", f"{sign}= ", results)
        if np.array_equal(np.maximum(access.place, -1), entry):
            entry = access.place
        name = "place" if entry is access.place else self.target
        table = writer.integers(f"{access.name}_{name}_entry", entry)
        lines = []
        for k in axes:
            at = f"{table}[{entry[0].size} * e + {end * len(axes) + k}]"
            lines += only_where(entry[:, end, k], at, f"{self.target}[{at}] {sign}= {results[k]};")
        return lines


@dataclass(frozen=True)
class AddCablesToNodes(AddToNodes):
    """Adds the pull of members that are not part of the mixed form."""

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the members that touch a wanted node and whose tension is no unknown."""
        chosen = super().select(model, member)
        return chosen[~model.structure.is_mixed[chosen]]


@dataclass(frozen=True)
class StoreForMembers:
    """Writes the results of each member to its place in the array `target`."""

    target: str

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return all members."""
        return member

    def place(self, access: MemberAccess) -> IntArray:
        """Return where the results of each member stand."""
        return access.member

    def operations(self, kernel: MemberKernel) -> int:
        """Return no operation."""
        return 0

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return one assignment for each result."""
        at = writer.index_at(f"{access.name}_store", len(results) * self.place(access), "e")
        return [f"{self.target}[{at}{f' + {k}' if k else ''}] = {name};" for k, name in enumerate(results)]


@dataclass(frozen=True)
class StoreForSome(StoreForMembers):
    """Writes the result of each member of `chosen` to its place among them."""

    chosen: tuple[int, ...]

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the chosen members."""
        return member[np.isin(member, self.chosen)]

    def place(self, access: MemberAccess) -> IntArray:
        """Return the number of each member among those chosen."""
        number: IntArray = np.searchsorted(self.chosen, access.member)
        return number


@dataclass(frozen=True)
class AddUp:
    """Adds the one result of each member to the variable `target`."""

    target: str

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return all members."""
        return member

    def operations(self, kernel: MemberKernel) -> int:
        """Return one addition."""
        return 1

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the addition."""
        return [f"{self.target} += {results[0]};"]
