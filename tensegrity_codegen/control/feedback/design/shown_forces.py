"""Which disturbance forces measurements show: on how many coordinates a filter can estimate one."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from tensegrity_codegen.system.arrays import FloatArray

SHOWN = 0.01  # of what the best shown force adds to the measurements, in multiples of their noise
GROWTH = 1.0  # [1/s] of the forces: the time in which `disturbance` states their change


def find_shown_forces(
    a: FloatArray, slope: FloatArray, noise: FloatArray, size: FloatArray, sample: float
) -> NDArray[np.int64]:
    """Return as many forces as the measurements tell apart, those that they show best.

    Parameters
    ----------
    a : ndarray, shape (n + m, n + m)
        Transition over a sample of n states and m forces that stay constant.
    slope : ndarray, shape (k, n + m)
        Derivatives of the measurements.
    noise : ndarray, shape (k,)
        Standard deviations of the measurements.
    size : ndarray, shape (m,)
        Usual size of each force.
    sample : float [s]
        Time of a sample.

    Returns
    -------
    ndarray of int
        Indices of the forces, rising.

    Notes
    -----
    Forces that grow like exp(t / 1 s) cause measurements G d, G = C (z - A)^-1 B with z = exp(sample / 1 s).
    QR decomposition of G with pivots takes one force after the other, each time the one that adds most
    to what the measurements show already; it ends where the next one adds less than SHOWN of the first.
    """
    n = len(a) - len(size)
    z = np.exp(GROWTH * sample)
    states = np.linalg.solve(z * np.eye(n) - a[:n, :n], a[:n, n:] * size)
    _, triangle, order = qr((slope[:, :n] @ states) / noise[:, None], mode="economic", pivoting=True)
    adds = np.abs(np.diag(triangle))
    return np.sort(order[: len(adds)][adds > SHOWN * adds[0]]).astype(np.int64)
