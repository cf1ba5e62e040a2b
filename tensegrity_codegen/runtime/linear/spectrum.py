"""Eigenvalues of a state matrix [0 I; S D], or with internal states, sorted into vibrations and the rest."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray

DENSE_STATES = 1500  # states up to which all eigenvalues are found
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues [1/s] ascending by modulus."""

    eigenvalue: NDArray[np.complex128]
    is_complete: bool  # whether these are all of them
    natural_frequency: FloatArray  # [Hz], of each oscillating pair
    damping_ratio: FloatArray
    zero_eigenvalues: int  # zero to rounding, two for each rigid motion
    growing: int  # with a positive real part beyond rounding


def find_spectrum(state_matrix: Any, count: int, n_internal: int = 0) -> Spectrum:
    """Return the spectrum of A (n_states, n_states); of large ones the `count` smallest eigenvalues.

    n_internal: how many of the states, the last ones, are neither coordinates nor velocities.

    Where D = 0 the eigenvalues are the roots of those of S, of half the size: rigid motions, which are
    double and defective in A, then come out as zero to full accuracy instead of to half the digits.
    """
    if n_internal:
        return _find_with_memory(scipy.sparse.csc_array(state_matrix), count, n_internal)
    # S and D: how accelerations depend on coordinates and on velocities; dense if all eigenvalues are found.
    n_coordinates = state_matrix.shape[0] // 2
    is_complete = 2 * n_coordinates <= DENSE_STATES or count >= n_coordinates - 1
    acceleration: Any = scipy.sparse.csr_array(state_matrix)[n_coordinates:]
    halves = acceleration[:, :n_coordinates], acceleration[:, n_coordinates:]
    stiffness, damping = (half.toarray() if is_complete else scipy.sparse.csc_array(half) for half in halves)
    is_undamped = _bound_eigenvalues(damping) == 0.0
    # Eigenvalues below zero_bound are zero to rounding.
    if is_undamped:
        largest = _bound_eigenvalues(stiffness)
        square = _find_eigenvalues(stiffness, None, is_complete, max(count, 1), largest)
        root = np.sqrt(square.astype(complex))
        eigenvalue = np.concatenate([root, -root])
        zero_bound = np.sqrt(64 * EPSILON * largest)
    else:
        largest = max(np.sqrt(_bound_eigenvalues(stiffness)), _bound_eigenvalues(damping))
        eigenvalue = _find_eigenvalues(stiffness, damping, is_complete, 2 * max(count, 1), largest)
        zero_bound = 8 * np.sqrt(EPSILON) * largest
    return _sort_eigenvalues(eigenvalue, float(zero_bound), is_complete)


def _find_with_memory(matrix: Any, count: int, n_internal: int) -> Spectrum:
    """Return the spectrum of [0 I 0; S D P; Q R G], n_internal: rows of G."""
    n_coordinates = (matrix.shape[0] - n_internal) // 2
    edges = (0, n_coordinates, 2 * n_coordinates, matrix.shape[0])
    bound = [
        [_bound_eigenvalues(matrix[a:b, c:d]) for c, d in pairwise(edges)] for a, b in pairwise(edges[1:])
    ]
    (stiffness, damping, pull), (_, slip, memory) = bound
    largest = max(np.sqrt(stiffness), damping, np.sqrt(pull * slip), memory)
    is_complete = matrix.shape[0] <= DENSE_STATES
    if is_complete:
        eigenvalue = np.linalg.eigvals(matrix.toarray())
    else:
        shift = 1e-9 * largest
        solve = _factorise(matrix - shift * scipy.sparse.eye_array(matrix.shape[0], format="csc"))
        eigenvalue = _find_nearest(matrix, shift, solve, 2 * max(count, 1))
    return _sort_eigenvalues(eigenvalue, float(8 * np.sqrt(EPSILON) * largest), is_complete)


def _find_eigenvalues(
    stiffness: Any, damping: Any | None, is_complete: bool, count: int, largest: float
) -> NDArray[Any]:
    """Return all eigenvalues of [0 I; S D] or of S, from dense matrices, or the `count` nearest to zero."""
    if is_complete:
        if damping is not None:
            stiffness = np.block([[np.zeros_like(damping), np.eye(len(damping))], [stiffness, damping]])
        return np.asarray(np.linalg.eigvals(stiffness))
    eye = scipy.sparse.eye_array(stiffness.shape[0], format="csc")
    matrix = stiffness if damping is None else scipy.sparse.block_array([[None, eye], [stiffness, damping]])
    # Shift and invert, beside zero, where the matrix may be singular.
    shift = 1e-9 * largest
    if damping is None:
        solve = _factorise(stiffness - shift * eye)
    else:
        # Of x2 - shift x1 = b1 and S x1 + (D - shift) x2 = b2 only half are unknowns at a time.
        shifted_damping = damping - shift * eye
        solve_half = _factorise(stiffness + shift * shifted_damping)

        def solve(right: FloatArray) -> FloatArray:
            upper, lower = np.split(right, 2)
            solution = solve_half(lower - shifted_damping @ upper)
            return np.concatenate([solution, upper + shift * solution])

    return _find_nearest(matrix, shift, solve, count)


def _find_nearest(
    matrix: Any, shift: float, solve: Callable[[FloatArray], FloatArray], count: int
) -> NDArray[Any]:
    """Return the `count` eigenvalues nearest to a shift; solve: b -> (matrix - shift)^-1 b."""
    inverse = scipy.sparse.linalg.LinearOperator(matrix.shape, matvec=solve, dtype=float)
    start = np.random.default_rng(0).normal(size=matrix.shape[0])
    return np.asarray(
        scipy.sparse.linalg.eigs(
            matrix, k=count, sigma=shift, OPinv=inverse, v0=start, return_eigenvectors=False
        )
    )


def _factorise(matrix: Any) -> Callable[[FloatArray], FloatArray]:
    """Return the function b -> matrix^-1 b of a matrix with a symmetric pattern."""
    factors = scipy.sparse.linalg.splu(
        scipy.sparse.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.1
    )
    solve: Callable[[FloatArray], FloatArray] = factors.solve
    return solve


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
