"""Loops over members, block by block: what the law makes of each of them, then the use of its results.

The loop of the law has no branch, and every member has places of its own for its results: compilers make
vectors of it. The loop of the use adds the results to what members share, one member after the other, in the
order of the plan. Every operation is that of unrolled code, and so are the bits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from tensegrity_codegen.codegen.table.members.access import MemberAccess, Sink
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.structure.assembly import MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import VECTORS, MemberKernel, build_member_kernel

BLOCK = 32  # members at a time: enough for vectors, few enough for a small stack


@dataclass(frozen=True)
class MemberLoop:
    """The loops over members of a group: read and call the kernel, hand the results to the sink."""

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
        """Floating-point operations of all members."""
        differences = self.model.n_axes * len(set(VECTORS).intersection(self.kernel.inputs))
        return self.repeats * (differences + self.kernel.operations + self.sink.operations(self.kernel))

    @property
    def repeats(self) -> int:
        """Its members."""
        return len(self.access.member)

    def write(self, writer: Writer) -> list[str]:
        """Return the loops: over all members at once if they are few, else over blocks of them.

        Results that belong to axes stand in a row for each member, those of a matrix column by column.
        """
        access, count, n_axes = self.access, self.repeats, self.model.n_axes
        symbol, kernel = writer.kernel(self.kernel_name, access.group.member_class)
        width = n_axes if kernel.size % n_axes == 0 else 1
        place = (
            f"const int p = {f'{width} * ' if width > 1 else ''}{'e' if count <= BLOCK else '(e - start)'};"
        )
        arrays = [f"r{k}" for k in range(kernel.size // width)]
        results = [f"{array}[p{f' + {k}' if k else ''}]" for array in arrays for k in range(width)]
        call = ", ".join([*access.values(writer, kernel), *(f"&{result}" for result in results)])
        law = [place, *access.declarations(writer, kernel), f"{symbol}({call});"]
        use = [place, *self.sink.statements(writer, access, results)]
        sizes = ", ".join(f"{array}[{width * min(count, BLOCK)}]" for array in arrays)
        if count <= BLOCK:
            lines = ["int e;", *_each("0", str(count), law), *_each("0", str(count), use)]
        else:
            lines = [
                "int e, start;",
                f"for (start = 0; start < {count}; start += {BLOCK}) {{",
                f"  const int end = start + {BLOCK} < {count} ? start + {BLOCK} : {count};",
                *(f"  {line}" for body in (law, use) for line in _each("start", "end", body)),
                "}",
            ]
        return ["{", f"  {writer.real} {sizes};", *(f"  {line}" for line in lines), "}"]


def _each(start: str, end: str, statements: list[str]) -> list[str]:
    """Return the loop over members from `start` on, before `end`."""
    return [f"for (e = {start}; e < {end}; ++e) {{", *(f"  {line}" for line in statements), "}"]


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
