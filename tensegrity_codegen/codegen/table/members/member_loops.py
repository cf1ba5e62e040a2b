"""Loops over members: a kernel a member, and what is done with its results."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.blocks import AddBlocks
from tensegrity_codegen.codegen.table.members.fours import write_fours
from tensegrity_codegen.codegen.table.members.fours_of_blocks import write_block_fours
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.sinks import AddToNodes, Sink
from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.structure.assembly import MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel, build_member_kernel


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
