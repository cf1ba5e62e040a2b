"""Eigenvalues of a state matrix [0 I; S D], sorted into oscillations, rigid motions and the rest."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray

DENSE_STATES = 1500  # states up to which all eigenvalues are found
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues [1/s] ascending by modulus; `is_complete` tells whether these are all of them.

    zero_eigenvalues: how many are zero to rounding (two for each rigid motion). growing: how many have a
    positive real part beyond rounding.
    """

    eigenvalue: NDArray[np.complex128]
    is_complete: bool
    natural_frequency: FloatArray  # [Hz], of each oscillating pair
    damping_ratio: FloatArray
    zero_eigenvalues: int
    growing: int


def find_spectrum(state_matrix: Any, count: int) -> Spectrum:
    """Return the spectrum of A (n_states, n_states); of large ones the `count` smallest eigenvalues.

    Where D = 0 the eigenvalues are the roots of those of S, of half the size: rigid motions, which are
    double and defective in A, then come out as zero to full accuracy instead of to half the digits.
    """
    half = state_matrix.shape[0] // 2
    lower = scipy.sparse.csr_array(state_matrix)[half:]
    stiffness, damping = scipy.sparse.csc_array(lower[:, :half]), scipy.sparse.csc_array(lower[:, half:])
    undamped = damping.nnz == 0 or not np.any(damping.data)
    complete = 2 * half <= DENSE_STATES or count >= half - 1
    if undamped:
        square = _eigenvalues(stiffness, complete, max(count, 1), _size(stiffness))
        root = np.sqrt(square.astype(complex))
        value, rounding = np.concatenate([root, -root]), np.sqrt(64 * EPSILON * _size(stiffness))
    else:
        scale = max(np.sqrt(_size(stiffness)), _size(damping))
        value = _eigenvalues(scipy.sparse.csc_array(state_matrix), complete, 2 * max(count, 1), scale)
        rounding = 8 * np.sqrt(EPSILON) * scale
    return _sort(value, float(rounding), complete)


def _eigenvalues(matrix: Any, complete: bool, count: int, scale: float) -> NDArray[Any]:
    """Return all eigenvalues, or the `count` nearest to zero, by shift and invert beside it."""
    if complete:
        return np.asarray(np.linalg.eigvals(matrix.toarray()))
    start = np.random.default_rng(0).normal(size=matrix.shape[0])
    found = scipy.sparse.linalg.eigs(matrix, k=count, sigma=1e-9 * scale, v0=start, return_eigenvectors=False)
    return np.asarray(found)


def _sort(value: NDArray[np.complex128], rounding: float, complete: bool) -> Spectrum:
    value = value[np.argsort(np.abs(value), kind="stable")]
    moving = np.abs(value) > rounding
    # An eigenvalue next to the real axis is a real one that rounding has moved.
    pairs = value[moving & (value.imag > 1e-9 * np.abs(value))]
    size = np.abs(pairs)
    return Spectrum(
        eigenvalue=value,
        is_complete=complete,
        natural_frequency=size / (2 * np.pi),
        damping_ratio=0.0 - pairs.real / size,  # 0, not -0, without damping
        zero_eigenvalues=int((~moving).sum()),
        growing=int((moving & (value.real > 1e-9 * np.abs(value)) & (value.real > rounding)).sum()),
    )


def _size(matrix: Any) -> float:
    """Largest column sum of moduli."""
    return float(abs(matrix).sum(axis=0).max(initial=0.0))
