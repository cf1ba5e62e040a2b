"""The progress of a motion that is integrated several times, until its error is within the tolerance.

How many runs it takes is not known before. Measured on the prism, towers of 10 and 100 stages and a tower of
bodies with `auto` and `rk54`: one to eight, in the middle four, each about 1.3 times as long as that before.
"""

from collections.abc import Callable

Progress = Callable[[float], None]

FURTHER_AT_FIRST, FURTHER = 2.5, 1.0  # runs that are expected after the first one, and after any other
GROWTH = 1.3  # time of a run over that of the one before
FALL = 1e-6  # a fraction smaller than the last one by more than this is that of a new run


def join_runs(progress: Progress | None) -> Progress | None:
    """Return the progress of one run, that of all runs together being `progress`.

    Parameters
    ----------
    progress : callable or None
        Called with the fraction done of all runs, 0 to 1; it does not decrease, and stays below 1.

    Returns
    -------
    callable or None
        To be called with the fraction done of each run, 0 to 1; where it falls, a new run has begun.
    """
    return None if progress is None else _JoinedRuns(progress)


class _JoinedRuns:
    """Each run gets its expected part of what is left: base, share of the run that is under way."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._base, self._last = 0.0, 0.0
        self._share = 1.0 / (1.0 + GROWTH * FURTHER_AT_FIRST)

    def __call__(self, fraction: float) -> None:
        if fraction < self._last - FALL:
            self._base += self._share
            self._share = (1.0 - self._base) / (1.0 + GROWTH * FURTHER)
        self._last = fraction
        self._progress(self._base + self._share * min(fraction, 1.0))
