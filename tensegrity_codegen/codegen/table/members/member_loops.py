"""Loops over members: a kernel a member, and what is done with its results."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from tensegrity_codegen.codegen.lanes.columns import COLUMNS
from tensegrity_codegen.codegen.table.members.access import AddToNodes, MemberAccess, Sink
from tensegrity_codegen.codegen.table.members.blocks import AddBlocks
from tensegrity_codegen.codegen.table.members.fours import (
    LANES,
    in_fours,
    is_served,
    kind_of,
    lane_counter,
    passed,
    read_values,
    read_vectors,
    write_fours,
)
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.structure.assembly import ABSENT, MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel, build_member_kernel

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
    """Return the loop over fours of members that leaves `e` behind the last one; None where there is none."""
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
        *(line for k in LANES for line in _additions(writer, access, sink, k)),
    ]
    before = ["lanes_pack total = pack_all(0.0);"] if sink.size else []
    after = [f"{sink.size} += pack_sum(total);"] if sink.size else []
    return ["#if defined(TENSEGRITY_LANES)", *before, *in_fours(access, lines), *after, "#endif"]


def _turn(c: int) -> str:
    rows = ", ".join(f"block + {4 * row}" for row in COLUMNS[c])
    return f"four_columns({rows}, column + {4 * c});"


def _additions(writer: Writer, access: MemberAccess, sink: AddBlocks, lane: int) -> list[str]:
    first, length = sink.starts(writer, access, lane_counter(lane))
    verbs = ("add", "set_minus" if sink.writes_first(access) else "subtract")
    return [
        f"block_{verbs[block % 2]}({sink.target} + {first[block]}, {length[block // 2]}, column + {lane});"
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
    model: TableModel,
    kernel: str,
    sink: Sink,
    keep: Callable[[MemberGroup], bool] = lambda group: True,
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
