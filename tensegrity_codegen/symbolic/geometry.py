"""Member geometry from node positions: vectors, lengths, rates. No force law in here."""

from collections.abc import Iterable
from typing import Any

import casadi as ca

Scalar = Any  # a 1 x 1 casadi.SX, symbolic or a number
Vector = list[Scalar]

# Added to the square of a cable's length [m2]: less than rounding from 1e-11 m on, and a normal number in
# single precision as well. If the ends of a slack cable coincide it makes quotients and derivatives zero.
MIN_SQUARE = 2.0**-126
MIN_LENGTH = 2.0**-63  # its root [m]


def dot(a: Vector, b: Vector) -> Scalar:
    """Return a . b, summed in order."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total = total + x * y
    return total


def member_vector(start: Vector, end: Vector) -> Vector:
    """Return d = r_i - r_j [m] of a member from node i (`start`) to node j (`end`)."""
    return [x - y for x, y in zip(start, end, strict=True)]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b; numbers that are zero leave no trace."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def add_vectors(vectors: Iterable[Vector]) -> Vector:
    """Return the sum of vectors, in order."""
    return [sum(column[1:], column[0]) for column in zip(*vectors, strict=True)]


def combine(parts: Iterable[tuple[int, float]], vectors: list[Vector]) -> Vector:
    """Return the sum of weighted vectors; parts: index and weight of each."""
    return add_vectors([weight * x for x in vectors[k]] for k, weight in parts)


def member_length(vector: Vector) -> Scalar:
    """Return l = |d| [m]."""
    return ca.sqrt(dot(vector, vector))
