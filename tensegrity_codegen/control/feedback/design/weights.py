"""Weights of quadratic objectives, checked: size, symmetry, definiteness."""

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import check_finite, to_doubles
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

SYMMETRIC = 1e-12  # of the largest entry
SEMIDEFINITE = 1e-12  # of the largest eigenvalue


def read_weight(value: ArrayLike, size: int, where: str, over: str, *, definite: bool) -> FloatArray:
    """Return a weight as a symmetric matrix.

    Parameters
    ----------
    value : array_like, shape (size, size) or (size,)
        The matrix, or its diagonal.
    size : int
        Number of the weighted numbers.
    where : str
        Name of the argument, for errors.
    over : str
        What is weighted, for errors.
    definite : bool
        Whether it must be positive definite; else positive semidefinite.

    Returns
    -------
    ndarray, shape (size, size)
        The matrix.

    Raises
    ------
    InvalidValueError
        Another size, not symmetric, or not positive (semi)definite.
    NonFiniteError
        A number that is not finite.
    """
    allowed = f"shape ({size}, {size}), or ({size},) for a diagonal: {over}"
    given = to_doubles(value, where, allowed)
    if given.shape not in ((size, size), (size,)):
        raise InvalidValueError(
            "the weight has another size", where=where, given=given.shape, allowed=allowed
        )
    check_finite(given, where)
    matrix = np.diag(given) if given.ndim == 1 else given
    scale = float(np.abs(matrix).max(initial=0.0))
    gap = np.abs(matrix - matrix.T)
    if gap.max(initial=0.0) > SYMMETRIC * scale:
        i, j = (int(k) for k in np.unravel_index(int(gap.argmax()), gap.shape))
        raise InvalidValueError(
            "the weight is not symmetric",
            where=where,
            given=f"{float(matrix[i, j])!r} at ({i}, {j}), {float(matrix[j, i])!r} at ({j}, {i})",
            allowed="a symmetric matrix",
            hint=f"({where} + {where}.T) / 2",
        )
    matrix = 0.5 * (matrix + matrix.T)
    values = np.linalg.eigvalsh(matrix) if size else np.zeros(0)
    least = float(values.min(initial=np.inf))
    bound = SEMIDEFINITE * float(np.abs(values).max(initial=0.0))
    if least <= bound if definite else least < -bound:
        raise InvalidValueError(
            f"the weight is not positive {'definite' if definite else 'semidefinite'}",
            where=where,
            given=f"smallest eigenvalue {least:.3g}",
            allowed="eigenvalues > 0" if definite else "eigenvalues >= 0",
        )
    return matrix
