"""Delays of actuators in samples, and linear models in which commands arrive late."""

import numpy as np
from scipy.linalg import expm

from tensegrity_codegen.system.arrays import FloatArray, IntArray

SAME = 1e-9  # of a sample


def split_delays(delay: FloatArray, sample: float) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the whole samples of delays, their rests [s], and how many commands are on their way, (n,) each.

    The command of a sample acts from its rest in the sample that begins so many samples later.
    """
    share = delay / sample
    whole = np.floor(share + SAME)
    rest = np.where(share - whole > SAME, share - whole, 0.0) * sample
    back = whole.astype(np.int64)
    return back, rest, back + (rest > 0.0)


def compute_hold(rate: FloatArray, gain: FloatArray, sample: float) -> tuple[FloatArray, FloatArray]:
    """Return the transition over one sample for a constant input.

    Parameters
    ----------
    rate, gain : ndarray, shape (n, n) and (n, m)
        x' = rate x + gain u.
    sample : float [s]
        Sample time.

    Returns
    -------
    A, B : ndarray
        x[k+1] = A x[k] + B u[k], same shapes.
    """
    n, m = gain.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = rate, gain
    whole = expm(sample * block)
    return whole[:n, :n], whole[:n, n:]


def hold_delayed(
    rate: FloatArray, gain: FloatArray, sample: float, delay: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the transition over one sample for commands that arrive after delays and are held.

    Parameters
    ----------
    rate, gain : ndarray, shape (n, n) and (n, m)
        x' = rate x + gain u.
    sample : float [s]
        Sample time.
    delay : ndarray, shape (m,) [s]
        Delay of each input.

    Returns
    -------
    A, B, P : ndarray, shape (n, n), (n, m) and (n, n_past)
        x[k+1] = A x[k] + B c[k] + P p[k], with c[k] the commands of the sample and p[k] those that are on
        their way: of each input the latest first. Exact.
    """
    a, now = compute_hold(rate, gain, sample)
    back, rest, count = split_delays(delay, sample)
    past = np.zeros((len(a), int(count.sum())))
    first = np.cumsum(count) - count
    for part in np.unique(rest).tolist():
        chosen = np.flatnonzero((rest == part) & (count > 0))
        late = compute_hold(rate, gain[:, chosen], sample - part)[1] if part > 0.0 else now[:, chosen]
        early = now[:, chosen] - late
        for u, from_rest, to_rest in zip(chosen.tolist(), late.T, early.T, strict=True):
            now[:, u] = from_rest if back[u] == 0 else 0.0
            if back[u] > 0:
                past[:, first[u] + back[u] - 1] = from_rest
            if part > 0.0:
                past[:, first[u] + back[u]] = to_rest
    return a, now, past


def shift_commands(delay: FloatArray, sample: float) -> tuple[FloatArray, FloatArray]:
    """Return by which matrices commands on their way follow from those before and the new ones.

    Returns
    -------
    shift, enter : ndarray, shape (n_past, n_past) and (n_past, m)
        p[k+1] = shift p[k] + enter c[k].
    """
    count = split_delays(delay, sample)[2]
    size = int(count.sum())
    first = (np.cumsum(count) - count)[count > 0]
    shift, enter = np.eye(size, k=-1), np.zeros((size, len(delay)))
    shift[first] = 0.0
    enter[first, np.flatnonzero(count)] = 1.0
    return shift, enter
