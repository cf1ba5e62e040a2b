"""Numbers of Radau IIA with three stages, from its nodes alone: plain arithmetic, the same on every machine.

Nodes c: roots of M(t) = t^3 + m2 t^2 + m1 t + m0 = (t - 1)(t^2 - 4t/5 + 1/10). D: derivatives at c of
polynomials of degree 3 that vanish at 0, by their values at c. Its eigenvectors are the values of those with
p' - z p = -z M: z is a root of m0 z^3 + m1 z^2 + 2 m2 z + 6 (Hairer and Wanner 1996, IV.5, IV.8).
"""

from decimal import Decimal, localcontext
from typing import Any

DIGITS = 50
Row = list[Decimal]


def radau_coefficients() -> dict[str, Any]:
    """Return what radau_constants.h says, every number as the C literal of a double."""
    with localcontext() as context:
        context.prec = DIGITS
        root = Decimal(6).sqrt()
        node = [(4 - root) / 10, (4 + root) / 10, Decimal(1)]
        derivative = [[_slope([Decimal(0), *node], j + 1, c) for j in range(3)] for c in node]
        square = [
            [sum((row[k] * derivative[k][j] for k in range(3)), Decimal(0)) for j in range(3)]
            for row in derivative
        ]
        real, (re, im) = _eigenvalues()
        first = _eigenvector(node, (real, Decimal(0)))
        second = _eigenvector(node, (re, im))
        transform = [[first[i][0], second[i][0], second[i][1]] for i in range(3)]
        return {
            "node": _print(node),
            "derivative": [_print(row) for row in derivative],
            "second_derivative": [_print(row) for row in square],
            "derivative_sum": _print([sum(row, Decimal(0)) for row in derivative]),
            "transform": [_print(row) for row in transform],
            "inverse_transform": [_print(row) for row in _inverse(transform)],
            "real": _print([real])[0],
            "re": _print([re])[0],
            "im": _print([im])[0],
            "to_start": _print([_value(node, j, Decimal(0)) for j in range(3)]),
            "slope": _print([_slope(node, j, Decimal(1)) for j in range(3)]),
            "curvature": _print([2 / _gaps(node, j) for j in range(3)]),
        }


def _print(values: Row) -> list[str]:
    return [repr(float(value)) for value in values]


def _gaps(nodes: Row, j: int) -> Decimal:
    product = Decimal(1)
    for k, node in enumerate(nodes):
        product *= nodes[j] - node if k != j else 1
    return product


def _value(nodes: Row, j: int, t: Decimal) -> Decimal:
    """Return the j-th Lagrange polynomial at t."""
    product = Decimal(1)
    for k, node in enumerate(nodes):
        product *= t - node if k != j else 1
    return product / _gaps(nodes, j)


def _slope(nodes: Row, j: int, t: Decimal) -> Decimal:
    """Return the derivative of the j-th Lagrange polynomial at t."""
    total = Decimal(0)
    others = [node for k, node in enumerate(nodes) if k != j]
    for left_out in range(len(others)):
        product = Decimal(1)
        for k, node in enumerate(others):
            product *= t - node if k != left_out else 1
        total += product
    return total / _gaps(nodes, j)


def _eigenvalues() -> tuple[Decimal, tuple[Decimal, Decimal]]:
    """Return the real eigenvalue of D and the complex one with positive imaginary part."""
    # m0 z^3 + m1 z^2 + 2 m2 z + 6 over m0, with m2 = -9/5, m1 = 9/10, m0 = -1/10.
    b, c, d = Decimal(-9), Decimal(36), Decimal(-60)
    z = Decimal("3.6")
    for _ in range(10):
        z -= (((z + b) * z + c) * z + d) / ((3 * z + 2 * b) * z + c)
    half = -(b + z) / 2  # z^2 + (b + z0) z + (c + (b + z0) z0) holds the others
    return z, (half, (c + (b + z) * z - half * half).sqrt())


def _eigenvector(node: Row, z: tuple[Decimal, Decimal]) -> list[tuple[Decimal, Decimal]]:
    """Return the values at the nodes of p = t^3 + a2 t^2 + a1 t, a2 = 3/z + m2, a1 = 2 a2/z + m1."""
    size = z[0] * z[0] + z[1] * z[1]
    u, w = z[0] / size, -z[1] / size  # 1/z
    a2 = (3 * u - Decimal(9) / 5, 3 * w)
    a1 = (2 * (a2[0] * u - a2[1] * w) + Decimal(9) / 10, 2 * (a2[0] * w + a2[1] * u))
    return [(((t + a2[0]) * t + a1[0]) * t, (a2[1] * t + a1[1]) * t) for t in node]


def _inverse(matrix: list[Row]) -> list[Row]:
    """Return the inverse of a 3 x 3 matrix by its cofactors."""

    def cofactor(i: int, j: int) -> Decimal:
        a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        return matrix[a][c] * matrix[b][d] - matrix[a][d] * matrix[b][c]

    determinant = sum((matrix[0][j] * cofactor(0, j) for j in range(3)), Decimal(0))
    return [[cofactor(j, i) / determinant for j in range(3)] for i in range(3)]
