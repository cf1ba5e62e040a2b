"""C statements of stiffness matrices: blocks of four members at a time, then sums of their columns."""

import casadi as ca

from tensegrity_codegen.codegen.lanes.columns import write_columns
from tensegrity_codegen.codegen.lanes.force import ForceLines, Kernels
from tensegrity_codegen.codegen.lanes.settled import is_settled
from tensegrity_codegen.codegen.print.printer import print_body
from tensegrity_codegen.codegen.prune import PrunedFunction
from tensegrity_codegen.symbolic.formulations.node_position import NodePosition
from tensegrity_codegen.symbolic.members.member_blocks import MemberBlocks

# Where the sizes of all entries sum up to less, no sum of some of them overflows: the matrix is finite.
SAFE = "1e300"
TRIANGLE = 6  # entries of the upper triangle of a block, row by row


class BlockLines(ForceLines):
    """The statements of one matrix that adds symmetric blocks of the members."""

    def __init__(self, parts: NodePosition, function: PrunedFunction, kernels: Kernels) -> None:
        nodes = list(parts.map.coordinate_nodes())
        settled = is_settled(parts, function.arguments)
        super().__init__(
            parts, nodes, function.arguments, True, kernels, has_forces=False, is_settled=settled
        )
        self.function = function

    def lines(self) -> list[str]:
        """Return all statements."""
        self._nodes()
        place: dict[int, tuple[int, int]] = {}
        for number, quad in enumerate(quad for kind in self._kinds() for quad in kind):
            kernel = self._lanes(number, quad, self.function.quantity.name)
            self._lines += [
                f"double block{number}[{4 * TRIANGLE}];",
                f"total = total + {kernel.name}_four({self._passed(number, kernel)}, block{number});",
            ]
            place |= {e: (number, lane) for lane, e in enumerate(quad)}
        start = ["lanes_pack total = pack_all(0.0);", *self._sums_begin()]
        finite = f"all_finite({self.function.quantity.name}, {self.function.sparsity.nnz()})"
        end = f"return pack_is_below(total, {SAFE}) || {finite};"
        if self.is_settled:
            end = f"return pack_is_below(total + spread, {SAFE});"
        return [*self.given.lines(), *start, *self._lines, *self._sums(place), end]

    def _sums(self, place: dict[int, tuple[int, int]]) -> list[str]:
        name, sparsity = self.function.quantity.name, self.function.sparsity
        return write_columns(self.parts, sparsity, name, place) or self._sums_of_entries(place)

    def _sums_of_entries(self, place: dict[int, tuple[int, int]]) -> list[str]:
        members = list(place)
        entry = ca.SX.sym("entry", TRIANGLE, len(members))
        blocks = {e: _symmetric(entry[:, k]) for k, e in enumerate(members)}
        matrix = self.parts.map.member_matrix(blocks, self.parts.ends, self.parts.members.plan.ends)
        wanted = ca.project(matrix, self.function.sparsity)

        def text(name: str, k: int) -> str:
            if name != "entry":
                return f"{name}[{k}]"
            number, lane = place[members[k // TRIANGLE]]
            return f"block{number}[{4 * (k % TRIANGLE) + lane}]"

        sums = ca.Function("sums", [entry], [wanted])
        return list(print_body(sums, ["entry"], [self.function.quantity.name], place=text).lines)


def _symmetric(entry: ca.SX) -> MemberBlocks:
    a, b, c, d, e, f = ca.vertsplit(entry)
    return MemberBlocks(((a, b, c), (b, d, e), (c, e, f)))
