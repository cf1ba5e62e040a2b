"""Member geometry from node positions: vectors, lengths, rates. No force law in here."""

from typing import Any

import casadi as ca

Scalar = Any
Vector = list[Scalar]


def dot(a: Vector, b: Vector) -> Scalar:
    """Return a . b, summed in order."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total = total + x * y
    return total


def member_vector(start: Vector, end: Vector) -> Vector:
    """Return d = r_i - r_j [m] of a member from node i (`start`) to node j (`end`)."""
    return [x - y for x, y in zip(start, end, strict=True)]


def member_length(vector: Vector) -> Scalar:
    """Return l = |d| [m]."""
    return ca.sqrt(dot(vector, vector))


def member_rate(vector: Vector, vector_rate: Vector, length: Scalar) -> Scalar:
    """Return l' = d . d' / l [m/s]."""
    return dot(vector, vector_rate) / length
