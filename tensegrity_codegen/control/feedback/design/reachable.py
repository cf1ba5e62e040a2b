"""Which modes of a sampled linear model inputs can change, and which outputs can show: rank tests.

A mode with eigenvalue z is stabilisable if [z 1 - A, B] has full rank, and detectable if [z 1 - A; C] has
(M. L. J. Hautus, "Controllability and observability conditions of linear autonomous systems", Indagationes
Mathematicae 31, 1969). Only modes with |z| >= 1 need to be either. Whether a number counts as zero depends on
the units of the states, which differ (m, rad, m/s, sums of errors): rows are scaled to unit norm first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray

ZERO = 1e-9  # singular value over the largest, up to which a direction is lost
UNSTABLE = 1.0 - 1e-7  # modulus from which on a mode does not decay by itself
NEAR_ONE = 1e-5
SHARE = 0.05  # of the largest part, from which on a state is named
NAMED = 6


@dataclass(frozen=True)
class HiddenMode:
    """A mode that inputs do not change, or outputs do not show.

    Attributes
    ----------
    eigenvalue : complex
        Of the sampled system; modulus 1 or more does not decay.
    direction : ndarray, shape (n_states,)
        Unit vector of the states that take part.
    rank, size : int
        Rank of the test matrix, and the rank that it should have.
    """

    eigenvalue: complex
    direction: FloatArray
    rank: int
    size: int


def find_uncontrolled(a: FloatArray, b: FloatArray) -> list[HiddenMode]:
    """Return the modes that do not decay and that no input changes.

    Parameters
    ----------
    a, b : ndarray, shape (n, n) and (n, m)
        x[k+1] = a x[k] + b u[k].

    Returns
    -------
    list of HiddenMode
        Empty if the system is stabilisable.
    """
    return _test(a.T, b.T)


def find_unobserved(a: FloatArray, c: FloatArray) -> list[HiddenMode]:
    """Return the modes that do not decay and that no output shows.

    Parameters
    ----------
    a, c : ndarray, shape (n, n) and (k, n)
        x[k+1] = a x[k], y = c x.

    Returns
    -------
    list of HiddenMode
        Empty if the system is detectable.
    """
    return _test(a, c)


def describe_direction(direction: FloatArray, names: Sequence[str]) -> str:
    """Return the largest parts of a direction in words, such as "0.71 top_x - 0.71 top_y"."""
    size = np.abs(direction)
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] >= SHARE * size.max()]
    if not order:
        return "none"
    turned = direction * np.sign(direction[order[0]])
    words = " ".join(f"{'+-'[int(turned[k] < 0)]} {abs(turned[k]):.2g} {names[k]}" for k in order[:NAMED])
    return words.removeprefix("+ ") + (f" and {len(order) - NAMED} more" if len(order) > NAMED else "")


def _test(a: FloatArray, c: FloatArray) -> list[HiddenMode]:
    n = len(a)
    norm = np.linalg.norm(c, axis=1)
    rows = c[norm > 0.0] / norm[norm > 0.0][:, None]
    found: list[HiddenMode] = []
    values = np.linalg.eigvals(a)
    chosen = values[(np.abs(values) >= UNSTABLE) & (values.imag >= 0.0)]
    chosen[np.abs(chosen - 1.0) < NEAR_ONE] = 1.0  # rounding splits the double eigenvalue of a free motion
    for value in _distinct(chosen):
        matrix = np.vstack([value * np.eye(n) - a, rows])
        _, singular, right = np.linalg.svd(matrix)
        rank = int((singular > ZERO * singular[0]).sum())
        for vector in right[rank:].conj():
            whole = np.concatenate([vector.real, vector.imag])
            half = whole[:n] if np.linalg.norm(whole[:n]) >= np.linalg.norm(whole[n:]) else whole[n:]
            found.append(HiddenMode(complex(value), half / np.linalg.norm(half), rank, n))
    return found


def _distinct(values: NDArray[np.complex128]) -> list[complex]:
    """Return the values, of those that differ by rounding only one."""
    kept: list[complex] = []
    for value in values.tolist():
        if all(abs(value - other) > 1e-6 for other in kept):
            kept.append(value)
    return kept
