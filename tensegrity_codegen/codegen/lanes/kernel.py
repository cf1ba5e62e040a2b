"""Force densities and stiffness blocks of members as C over packs: the same operations, one lane a member."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.lanes.dialect import MIXED, PACKS, ROWS
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.members.member_blocks import MemberBlocks
from tensegrity_codegen.symbolic.members.member_kernel import KERNELS
from tensegrity_codegen.tables.laws import MEMBER_VALUES
from tensegrity_codegen.tables.precision import Precision

Scalar = Any

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
    BLOCKS, or over rows one of KERNELS.
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
    function, parameters = _build(kind, name, len(AXES))
    result, sizes = int(function.size1_out(0)), list[str]()

    def put(entry: int, value: str) -> str:
        if result == 1:
            return f"return {value};"
        sizes.append(f"pack_absolute({value})")
        return f"pack_store(block + {4 * entry}, {value});"

    lines = (MIXED if kind.is_mixed else PACKS).print(function, parameters, put)
    if sizes:
        lines.append(f"return {' + '.join(sizes)};")
    stores = 0 if kind.result == "density" else result
    parameters = (*parameters, "two_sided") if kind.is_mixed else parameters
    return DensityKernel(name, parameters, tuple(lines), stores)


@functools.cache
def build_row_kernel(kind: KernelKind, name: str, n_axes: int, precision: Precision) -> DensityKernel:
    """Return the kernel of a kind over rows, of members in so many axes; errors as of build_kernel."""
    function, parameters = _build(kind, name, n_axes)
    lines = ROWS.in_precision(precision).print(
        function, parameters, lambda entry, value: f"result[{entry}] = {value};"
    )
    return DensityKernel(name, parameters, tuple(lines), int(function.size1_out(0)))


def _build(kind: KernelKind, name: str, n_axes: int) -> tuple[ca.Function, tuple[str, ...]]:
    """Return what a kernel computes as a function of its parameters."""
    axes, rates = AXES[:n_axes], RATES[:n_axes]
    names = (*axes, *rates, *MEMBER_VALUES)
    symbols = {key: ca.SX.sym(key) for key in names}
    zero = ca.SX(0.0)
    values = {key: symbols[key] if key in kind.values else zero for key in MEMBER_VALUES}
    member = Member(
        [symbols[axis] for axis in axes], [symbols[rate] for rate in rates], values, kind.tension_only
    )
    result = ca.cse(ca.vertcat(*_results(kind, member)))
    parameters = tuple(key for key in names if ca.depends_on(result, symbols[key]))
    return ca.Function(name, [symbols[key] for key in parameters], [ca.densify(result)]), parameters


def _results(kind: KernelKind, member: Member) -> list[Scalar]:
    if kind.result in KERNELS and kind.result != "density":
        return KERNELS[kind.result](member)
    if kind.result != "density":
        block = BLOCKS[kind.result](member).entries
        return [block[r][c] for r in range(len(block)) for c in range(r, len(block))]
    return [member.static_density if kind.is_static else member.density]
