"""The part of one member of a class, as a small function of its vector and its values.

The expressions are those of `Member`, over symbols of one member; loops over tables call them once a member.
Constants of a member are symbols here as well, except where they are zero for the whole class, so that every
operation is the one that an unrolled expression with the same numbers has.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from tensegrity_codegen.structure.assembly import ABSENT, MemberClass
from tensegrity_codegen.structure.member_laws import SECTION_VALUES
from tensegrity_codegen.symbolic.geometry import Scalar
from tensegrity_codegen.symbolic.members.member import Member, MemberBlocks
from tensegrity_codegen.symbolic.model import count_operations
from tensegrity_codegen.tables.laws import MEMBER_VALUES
from tensegrity_codegen.tables.quantities.members import MEMBER_QUANTITIES

# The symbols of a kernel: d_e and its rate over the modelled axes, and the values of the law.
VECTORS = ("vector", "vector_rate")
VALUES = ("mu", *MEMBER_VALUES, *SECTION_VALUES)


@dataclass(frozen=True)
class MemberKernel:
    """One function of a member, with the inputs `inputs`, of VECTORS and VALUES, and `size` results."""

    name: str
    function: ca.Function
    inputs: tuple[str, ...]
    size: int

    @property
    def operations(self) -> int:
        """Number of floating-point operations of one call."""
        return count_operations(self.function)


def _columns(block: MemberBlocks) -> list[Scalar]:
    return [value for column in zip(*block.entries, strict=True) for value in column]


# Results of kernels, by name. A block is its columns.
KERNELS: dict[str, Callable[[Member], list[Scalar]]] = {
    **{quantity.kernel: quantity.entries for quantity in MEMBER_QUANTITIES},
    "margin": lambda m: [m.law.margin()],
    "switch": lambda m: [m.law.switch()],
    "static_tension": lambda m: [m.law.static_tension()],
    "pull": lambda m: m.pull(m.density),
    "static_pull": lambda m: m.pull(m.static_density),
    "energy": lambda m: [m.law.energy()],
    "direction": lambda m: m.direction(),
    "material_block": lambda m: _columns(m.material_block()),
    "geometric_block": lambda m: _columns(m.geometric_block()),
    "tangent_block": lambda m: _columns(m.tangent_block()),
    "rate_block": lambda m: _columns(m.rate_block()),
    "position_block": lambda m: _columns(m.position_block()),
    "rest_pull": lambda m: m.rest_pull(),
    "static_rest_pull": lambda m: m.static_rest_pull(),
    "tension_gradient": lambda m: m.tension_gradient(),
}

# Kernels that need the stiffnesses apart, not mu alone.
UNFOLDED = ("rest_pull", "static_rest_pull", "rest_slope")


@functools.cache
def build_member_kernel(name: str, member_class: MemberClass, n_axes: int) -> MemberKernel:
    """Return the kernel of that name of KERNELS for members of a class over so many axes."""
    vectors = {vector: ca.SX.sym(vector, n_axes) for vector in VECTORS}
    symbols = {**vectors, **{value: ca.SX.sym(value) for value in VALUES}}
    result = ca.densify(ca.vertcat(*KERNELS[name](_member(symbols, member_class, name in UNFOLDED))))
    result = ca.cse(result)
    inputs = [key for key, symbol in symbols.items() if ca.depends_on(result, symbol)]
    function = ca.Function(name, [symbols[key] for key in inputs], [result], inputs, ["result"])
    return MemberKernel(name, function, tuple(inputs), int(result.numel()))


def _member(symbols: dict[str, Any], member_class: MemberClass, is_unfolded: bool) -> Member:
    zero = ca.SX(0.0)
    values = {name: symbols[name] if member_class.source(name) != ABSENT else zero for name in MEMBER_VALUES}
    if member_class.is_stiffness_constant and not is_unfolded:
        values |= {"spring_constant": symbols["mu"], "axial_stiffness": zero}
    vector, vector_rate = (ca.vertsplit(symbols[name]) for name in VECTORS)
    section = {name: symbols[name] for name in SECTION_VALUES}
    return Member(vector, vector_rate, values, member_class.tension_only, section)
