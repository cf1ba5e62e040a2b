"""Force densities and stiffness blocks of members as C over packs of four members: one lane each."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from tensegrity_codegen.codegen.print.instructions import read_instructions
from tensegrity_codegen.codegen.print.operations import ARITHMETIC
from tensegrity_codegen.codegen.print.printer import print_number
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.symbolic.geometry import MIN_SQUARE, Scalar
from tensegrity_codegen.symbolic.members.member import Member, MemberBlocks
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.laws import MEMBER_VALUES
from tensegrity_codegen.tables.precision import PRECISIONS

# The columns of a symmetric block: where their rows stand in its upper triangle, row by row.
COLUMNS = ((0, 1, 2), (1, 3, 4), (2, 4, 5))

Put = Callable[[int, str], str]

# Bars and cables in one pack: a lane whose member holds both ways takes its value whatever it compares.
HOLDS = "pack_or({a}, pack_less(pack_all(0.0), two_sided))"
OPERATIONS = ARITHMETIC | {
    ca.OP_SQRT: "pack_sqrt({a})",
    ca.OP_LT: "pack_less({a}, {b})",
    ca.OP_AND: "pack_and({a}, {b})",
    ca.OP_IF_ELSE_ZERO: "pack_and({a}, {b})",
}
MIXED = OPERATIONS | {ca.OP_IF_ELSE_ZERO: f"pack_and({HOLDS}, {{b}})"}


def _print_packs(
    function: ca.Function, inputs: tuple[str, ...], put: Put, operations: dict[int, str]
) -> list[str]:
    """Return the statements over packs that evaluate an SX function.

    inputs: names of its arguments; put: (entry, value) -> the statement that hands a result out.
    """
    lines: list[str] = []
    work: list[str] = []
    for k, instruction in enumerate(read_instructions(function)):
        operands = [work[operand] for operand in instruction.operands]
        work.append(f"t{k}")
        if instruction.operation == ca.OP_CONST:
            work[k] = _fill(instruction.value)
        elif instruction.operation == ca.OP_INPUT:
            work[k] = inputs[instruction.place[0]]
        elif instruction.operation == ca.OP_OUTPUT:
            lines.append(put(instruction.place[1], operands[0]))
        elif instruction.operation in operations:
            text = operations[instruction.operation].format(a=operands[0], b=operands[-1], one=_fill(1.0))
            lines.append(f"const lanes_pack t{k} = {text};")
        else:
            problem = f"CasADi operation {instruction.operation} has no form in lanes"
            raise FormulationError(problem, where="codegen.lanes")
    return lines


def _fill(value: float) -> str:
    return f"pack_all({print_number(value, PRECISIONS['double'])})"


AXES = ("x", "y", "z")
RATES = ("x_rate", "y_rate", "z_rate")

# Symmetric blocks by quantity: their upper triangles are results of a kernel, row by row.
BLOCKS: dict[str, Callable[[Member], MemberBlocks]] = {
    "material_stiffness": lambda m: m.material_block(),
    "geometric_stiffness": lambda m: m.geometric_block(),
    "tangent_stiffness": lambda m: m.tangent_block(),
}


@dataclass(frozen=True)
class KernelKind:
    """Which values a law takes, and who pulls only: all members of a pack, none, or (`is_mixed`) some.

    values: those of MEMBER_VALUES that are not zero for all members; result: "density", or a name of
    BLOCKS.
    """

    values: tuple[str, ...]
    is_static: bool
    tension_only: bool
    is_mixed: bool = False
    result: str = "density"


@dataclass(frozen=True)
class DensityKernel:
    """One C function over packs: its name, its parameters, its statements.

    stores: how many results it stores, four apart, to return the sum of their sizes; one that stores none
    returns its result.
    """

    name: str
    parameters: tuple[str, ...]
    lines: tuple[str, ...]
    stores: int = 0


@functools.cache
def build_kernel(kind: KernelKind, name: str) -> DensityKernel:
    """Return the kernel of a kind; FormulationError for an operation that packs do not have."""
    function, parameters = _build(kind, name)
    result, sizes = int(function.size1_out(0)), list[str]()

    def put(entry: int, value: str) -> str:
        if result == 1:
            return f"return {value};"
        sizes.append(f"pack_absolute({value})")
        return f"pack_store(block + {4 * entry}, {value});"

    lines = _print_packs(function, parameters, put, MIXED if kind.is_mixed else OPERATIONS)
    if sizes:
        lines.append(f"return {' + '.join(sizes)};")
    stores = 0 if kind.result == "density" else result
    return DensityKernel(name, parameters, tuple(lines), stores)


def _build(kind: KernelKind, name: str) -> tuple[ca.Function, tuple[str, ...]]:
    """Return the CasADi function of a kernel and its parameters."""
    names = (*AXES, *RATES, *MEMBER_VALUES, "two_sided")
    symbols = {key: ca.SX.sym(key) for key in names}
    zero = ca.SX(0.0)
    values = {key: symbols[key] if key in kind.values else zero for key in MEMBER_VALUES}
    of_cable = 1.0 - symbols["two_sided"] if kind.is_mixed else 1.0
    member = Member(
        [symbols[axis] for axis in AXES],
        [symbols[rate] for rate in RATES],
        values,
        kind.tension_only,
        least_square=MIN_SQUARE * of_cable,
    )
    result = ca.cse(ca.vertcat(*_results(kind, member)))
    parameters = tuple(key for key in names if ca.depends_on(result, symbols[key]))
    return ca.Function(name, [symbols[key] for key in parameters], [ca.densify(result)]), parameters


def _results(kind: KernelKind, member: Member) -> list[Scalar]:
    if kind.result != "density":
        block = BLOCKS[kind.result](member).entries
        return [block[r][c] for r in range(len(block)) for c in range(r, len(block))]
    return [member.static_density if kind.is_static else member.density]


# C text of vectors of four members: the plain C of `templates/c/lanes.h`, then kernels of members.


def emit_kernels(kernels: Sequence[DensityKernel], *, in_loops: bool) -> list[str]:
    """Return the lines that stand before functions that use kernels of four members.

    kernels: the kernels, each with a name of its own.
    in_loops: whether they stand in loops, which add to arrays in memory and have a form without vectors; else
        in straight-line code, whose vectors are single numbers where a machine has no vectors.
    """
    context = {
        "kernels": list(kernels),
        "name": "",
        "NAME": "",
        "real": "double",
        "suffix": "",
        "settings": {
            "WITH_FLOAT": False,
            "WITH_LOOPS": in_loops,
            "WITH_BLOCKS": any(kernel.stores for kernel in kernels) and in_loops,
        },
    }
    return render("lanes.c", context).splitlines()
