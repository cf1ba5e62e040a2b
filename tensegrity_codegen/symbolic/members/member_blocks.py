"""The small square block that one member adds to a matrix over node coordinates.

Symmetric blocks share their off-diagonal expressions, so nothing is computed twice.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca

Scalar = Any
Vector = list[Scalar]


@dataclass(frozen=True)
class MemberBlocks:
    """Entries of one member's (n_axes, n_axes) block, row by row."""

    entries: tuple[tuple[Scalar, ...], ...]

    @classmethod
    def outer(cls, a: Vector, b: Vector, scale: Scalar) -> "MemberBlocks":
        """Return scale a b^T; symmetric entries are shared when a is b."""
        scaled = [scale * x for x in a]
        rows = [[x * y for y in b] for x in scaled]
        if a is b:
            rows = [[rows[min(r, c)][max(r, c)] for c in range(len(b))] for r in range(len(a))]
        return cls(tuple(tuple(row) for row in rows))

    def plus(self, other: "MemberBlocks") -> "MemberBlocks":
        """Return the sum of two blocks."""
        return MemberBlocks(
            tuple(
                tuple(x + y for x, y in zip(row, other_row, strict=True))
                for row, other_row in zip(self.entries, other.entries, strict=True)
            )
        )


def stiffness_block(
    vector: Vector, length: Scalar, square: Scalar, slope: Scalar, density: Scalar
) -> MemberBlocks:
    """Return one member's stiffness block, slope d d^T / l^2 + density (I - d d^T / l^2) [N/m].

    square: l^2 [m2]; slope = dt/dl and density = t/l [N/m]: the material and the geometric part (S&K 5, the
    same as mu [(1 - rho/l) I + (rho/l^3) d d^T]); either may be zero. Over one axis d / l is exactly 1 or -1,
    and nothing is left of the geometric part.
    """
    if len(vector) == 1:
        return _sum([vector[0] / length], slope - density, density)
    return _sum(vector, (slope - density) / square, density)


def tangent_block(
    vector: Vector, length: Scalar, square: Scalar, slope: Scalar, tension: Scalar
) -> MemberBlocks:
    """Return the block of both parts [N/m], from the tension [N]: one quotient serves all entries."""
    if len(vector) == 1:
        return stiffness_block(vector, length, square, slope, tension / length)
    inverse = length / square  # CasADi would make quotients again of products with 1 / length
    density = tension * inverse
    return _sum(vector, (slope - density) * (inverse * inverse), density)


def _sum(vector: Vector, along: Scalar, density: Scalar) -> MemberBlocks:
    """Return along d d^T + density I."""
    size, zero = range(len(vector)), ca.SX(0.0)
    identity = MemberBlocks(tuple(tuple(density if r == c else zero for c in size) for r in size))
    return identity.plus(MemberBlocks.outer(vector, vector, along))
