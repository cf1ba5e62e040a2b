"""Loops over members, one at a time or four in vectors: kernels, and uses of their results."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import AXES, COLUMNS, RATES, DensityKernel, KernelKind
from tensegrity_codegen.codegen.table.members.access import AddToNodes, MemberAccess, Sink
from tensegrity_codegen.codegen.table.members.block_pattern import AddBlocks
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Writer, loop
from tensegrity_codegen.structure.assembly import ABSENT, MemberClass, MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel, build_member_kernel
from tensegrity_codegen.tables.laws import MEMBER_VALUES

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.table.members.access import AddToNodes


# The loop over free members four at a time, for vectors; the loop of single members takes the remaining ones.
#
# Forces are added member by member in the same order, by the same operations: the bits are those of the loop.


PULLS = {"pull": False, "static_pull": True}  # kernel -> whether it is without damping
LANES = range(4)
IN_A_ROW = re.compile(r"(\w+)\[((?:\d+ \+ )?)\(e \+ 0\)\]")


def write_fours(
    writer: Writer, access: MemberAccess, kernel_name: str, sink: "AddToNodes"
) -> list[str] | None:
    """Return the loop over fours of members that leaves `e` behind the last one; None if there is none."""
    entry = sink.index[access.model.ends[access.member]]
    in_a_row = bool((entry >= 0).all()) and np.array_equal(entry, entry[:, :, :1] + np.arange(entry.shape[2]))
    if kernel_name not in PULLS or not in_a_row or not is_served(writer, access):
        return None
    kernel = writer.density(kind_of(access.group.member_class, PULLS[kernel_name]))
    lines = [
        *read_vectors(writer, access, kernel),
        *read_values(writer, access, kernel),
        f"const lanes_four density = {kernel.name}_four({passed(kernel)});",
        *_add_pulls(writer, access, sink, entry[:, :, 0]),
    ]
    return ["#if defined(TENSEGRITY_LANES)", *in_fours(access, lines), "#endif"]


STIFFNESSES = ("spring_constant", "axial_stiffness")  # those that mu replaces


def is_served(writer: Writer, access: MemberAccess) -> bool:
    """Return whether a loop's members can go by fours: free in space, in doubles, four at least."""
    is_space = access.group.is_interior and access.model.n_axes == 3
    return is_space and writer.precision.name == "double" and len(access.member) >= len(LANES)


def in_fours(access: MemberAccess, lines: list[str]) -> list[str]:
    """Return the loop of statements over fours of members."""
    head = f"for (; e + {len(LANES) - 1} < {len(access.member)}; e += {len(LANES)}) {{"
    return [head, *(f"  {line}" for line in lines), "}"]


def kind_of(cls: MemberClass, is_static: bool, result: str = "density") -> KernelKind:
    """Return the kind of kernel that gives `result` for members of a class."""
    values = tuple(name for name in MEMBER_VALUES if cls.source(name) != ABSENT)
    if cls.is_stiffness_constant:
        values = ("spring_constant", *(name for name in values if name not in STIFFNESSES))
    if is_static:
        values = tuple(name for name in values if name != "damping")
    return KernelKind(values, is_static, cls.tension_only, result=result)


def lane_counter(lane: int) -> str:
    """Return the C expression of the member in a lane."""
    return f"(e + {lane})"


def read_vectors(writer: Writer, access: MemberAccess, kernel: DensityKernel) -> list[str]:
    """Return statements that bring four member vectors, and their rates, into lanes."""
    lines = []
    for k in LANES:
        ends = [
            writer.index_at(f"{access.name}_{'ij'[end]}", access.place[:, end, 0], lane_counter(k))
            for end in (0, 1)
        ]
        lines.append(f"const int i{k} = {ends[0]}, j{k} = {ends[1]};")
    for prefix, array, axes in (("d", "coordinate", AXES), ("rate", "velocity", RATES)):
        if axes[0] not in kernel.parameters:
            continue
        for k in LANES:
            loads = [f"xyz_load_last({array} + {end}{k})" for end in "ij"]
            lines.append(f"const lanes_xyz {prefix}{k} = xyz_minus({', '.join(loads)});")
        lines.append(f"lanes_four {', '.join(axes)};")
        lines.append(f"four_split({', '.join(f'{prefix}{k}' for k in LANES)}, &{', &'.join(axes)});")
    return lines


def read_values(writer: Writer, access: MemberAccess, kernel: DensityKernel) -> list[str]:
    """Return statements that bring four members' values into lanes."""
    return [
        f"const lanes_four {name}_of_four = {_four(writer, access, name)};"
        for name in kernel.parameters
        if name in MEMBER_VALUES
    ]


def passed(kernel: DensityKernel) -> str:
    """Return the arguments of a call of a kernel of four members."""
    return ", ".join(f"{name}_of_four" if name in MEMBER_VALUES else name for name in kernel.parameters)


def _four(writer: Writer, access: MemberAccess, name: str) -> str:
    """Return one value of each of four members, loaded at once where they lie in a row."""
    is_mu = name == "spring_constant" and access.group.member_class.is_stiffness_constant
    texts = [access.value(writer, "mu" if is_mu else name, lane_counter(k)) for k in LANES]
    consecutive = IN_A_ROW.fullmatch(texts[0])
    return (
        f"four_load({consecutive[1]} + {consecutive[2]}e)" if consecutive else f"four_of({', '.join(texts)})"
    )


def _add_pulls(writer: Writer, access: MemberAccess, sink: "AddToNodes", offsets: np.ndarray) -> list[str]:
    lines = []
    for k in LANES:
        lines.append(f"const lanes_xyz pull{k} = XYZ_TIMES(density, {k}, d{k});")
        for end, verb in ((0, "subtract"), (1, "add")):
            at = f"{'ij'[end]}{k}"
            if not np.array_equal(offsets[:, end], access.place[:, end, 0]):
                at = writer.index_at(
                    f"{access.name}_{sink.target}_{'ij'[end]}", offsets[:, end], lane_counter(k)
                )
            lines.append(f"xyz_{verb}({sink.target} + {at}, pull{k});")
    return lines


# The loop over free members four at a time, for the blocks of a matrix.
#
# Blocks of four members are worked out in lanes and turned into columns of three rows by shuffles in
# registers: these are added to, or first written to, the matrix as in the loop of single members, with the
# same bits.


# Kernel of single members -> the same in lanes, see codegen.lanes.kernel.BLOCKS.
IN_LANES = {
    "material_block": "material_stiffness",
    "geometric_block": "geometric_stiffness",
    "tangent_block": "tangent_stiffness",
    "position_block": "tangent_stiffness",
}


def write_block_fours(
    writer: Writer, access: MemberAccess, kernel_name: str, sink: AddBlocks
) -> list[str] | None:
    """Return the loop over fours of members that leaves `e` behind the last one; None if there is none."""
    is_damped = kernel_name == "position_block" and access.group.member_class.damping != ABSENT
    if kernel_name not in IN_LANES or is_damped or not is_served(writer, access):
        return None
    kernel = writer.density(kind_of(access.group.member_class, True, IN_LANES[kernel_name]))
    size = f"{kernel.name}_four({passed(kernel)}, block)"
    lines = [
        *read_vectors(writer, access, kernel),
        *read_values(writer, access, kernel),
        "double block[24];",
        "lanes_column column[12];",
        f"total = total + {size};" if sink.size else f"(void){size};",
        *(_turn(c) for c in range(len(COLUMNS))),
        *(line for k in LANES for line in _add_blocks(writer, access, sink, k)),
    ]
    before = ["lanes_pack total = pack_all(0.0);"] if sink.size else []
    after = [f"{sink.size} += pack_sum(total);"] if sink.size else []
    return ["#if defined(TENSEGRITY_LANES)", *before, *in_fours(access, lines), *after, "#endif"]


def _turn(c: int) -> str:
    rows = ", ".join(f"block + {4 * row}" for row in COLUMNS[c])
    return f"four_columns({rows}, column + {4 * c});"


def _add_blocks(writer: Writer, access: MemberAccess, sink: AddBlocks, lane: int) -> list[str]:
    starts, length = sink.starts(writer, access, lane_counter(lane))
    verbs = ("add", "set_minus" if sink.writes_first(access) else "subtract")
    return [
        f"block_{verbs[block % 2]}({sink.target} + {starts[block]}, {length[block // 2]}, column + {lane});"
        for block in range(4)
    ]


@dataclass(frozen=True)
class MemberLoop:
    """One loop over members of a group: read, call the kernel, hand the results to the sink."""

    model: TableModel
    access: MemberAccess
    kernel_name: str
    sink: Sink

    @cached_property
    def kernel(self) -> MemberKernel:
        """The kernel of these members."""
        return build_member_kernel(self.kernel_name, self.access.group.member_class, self.model.n_axes)

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        return self.access.arguments(self.kernel)

    @property
    def operations(self) -> int:
        """Floating-point operations of the whole loop."""
        return len(self.access.member) * (self.kernel.operations + self.sink.operations(self.kernel))

    @property
    def repeats(self) -> int:
        """Its members."""
        return len(self.access.member)

    def write(self, writer: Writer) -> list[str]:
        """Return the loop."""
        access = self.access
        symbol, kernel = writer.kernel(self.kernel_name, access.group.member_class)
        results = [f"r{k}" for k in range(kernel.size)]
        call = [*access.values(writer, kernel), *(f"&{result}" for result in results)]
        lines = [
            *access.declarations(writer),
            f"{writer.real} {', '.join(results)};",
            f"{symbol}({', '.join(call)});",
            *self.sink.statements(writer, access, results),
        ]
        return loop("e", len(access.member), lines, before=self._fours(writer))

    def _fours(self, writer: Writer) -> list[str] | None:
        if isinstance(self.sink, AddToNodes):
            return write_fours(writer, self.access, self.kernel_name, self.sink)
        if isinstance(self.sink, AddBlocks):
            return write_block_fours(writer, self.access, self.kernel_name, self.sink)
        return None


def member_loops(
    model: TableModel, kernel: str, sink: Sink, keep: Callable[[MemberGroup], bool] = lambda group: True
) -> list[MemberLoop]:
    """Return the loops over the members of groups to keep that the sink wants, in the order of the plan."""
    loops = []
    for number, group in enumerate(model.plan.groups):
        member = sink.select(model, group.member) if keep(group) else group.member[:0]
        if len(member):
            loops.append(
                MemberLoop(model, MemberAccess(model, f"group{number}", group, member), kernel, sink)
            )
    return loops
