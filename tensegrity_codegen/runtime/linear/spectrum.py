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
    # S and D: how accelerations depend on coordinates and on velocities.
    n_coordinates = state_matrix.shape[0] // 2
    acceleration = scipy.sparse.csr_array(state_matrix)[n_coordinates:]
    stiffness = scipy.sparse.csc_array(acceleration[:, :n_coordinates])
    damping = scipy.sparse.csc_array(acceleration[:, n_coordinates:])
    is_undamped = damping.nnz == 0 or not np.any(damping.data)
    is_complete = 2 * n_coordinates <= DENSE_STATES or count >= n_coordinates - 1
    # Eigenvalues below zero_bound are zero to rounding.
    if is_undamped:
        square = _find_eigenvalues(stiffness, is_complete, max(count, 1), _bound_eigenvalues(stiffness))
        root = np.sqrt(square.astype(complex))
        eigenvalue = np.concatenate([root, -root])
        zero_bound = np.sqrt(64 * EPSILON * _bound_eigenvalues(stiffness))
    else:
        largest = max(np.sqrt(_bound_eigenvalues(stiffness)), _bound_eigenvalues(damping))
        matrix = scipy.sparse.csc_array(state_matrix)
        eigenvalue = _find_eigenvalues(matrix, is_complete, 2 * max(count, 1), largest)
        zero_bound = 8 * np.sqrt(EPSILON) * largest
    return _sort_eigenvalues(eigenvalue, float(zero_bound), is_complete)


def _find_eigenvalues(matrix: Any, is_complete: bool, count: int, largest: float) -> NDArray[Any]:
    """Return all eigenvalues, or the `count` nearest to zero; largest: a bound of all of them."""
    if is_complete:
        return np.asarray(np.linalg.eigvals(matrix.toarray()))
    # Shift and invert, beside zero, where the matrix may be singular.
    shift, start = 1e-9 * largest, np.random.default_rng(0).normal(size=matrix.shape[0])
    return np.asarray(
        scipy.sparse.linalg.eigs(matrix, k=count, sigma=shift, v0=start, return_eigenvectors=False)
    )


def _sort_eigenvalues(eigenvalue: NDArray[np.complex128], zero_bound: float, is_complete: bool) -> Spectrum:
    eigenvalue = eigenvalue[np.argsort(np.abs(eigenvalue), kind="stable")]
    modulus = np.abs(eigenvalue)
    is_zero = ~(modulus > zero_bound)
    # An eigenvalue next to the real axis is a real one that rounding has moved.
    oscillating = eigenvalue[~is_zero & (eigenvalue.imag > 1e-9 * modulus)]
    frequency = np.abs(oscillating)  # [rad/s]
    is_growing = ~is_zero & (eigenvalue.real > 1e-9 * modulus) & (eigenvalue.real > zero_bound)
    return Spectrum(
        eigenvalue=eigenvalue,
        is_complete=is_complete,
        natural_frequency=frequency / (2 * np.pi),
        damping_ratio=0.0 - oscillating.real / frequency,  # 0, not -0, without damping
        zero_eigenvalues=int(is_zero.sum()),
        growing=int(is_growing.sum()),
    )


def _bound_eigenvalues(matrix: Any) -> float:
    """Return the largest column sum of moduli, which no eigenvalue exceeds."""
    return float(abs(matrix).sum(axis=0).max(initial=0.0))
