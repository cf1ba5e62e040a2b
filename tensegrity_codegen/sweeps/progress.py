"""The progress of a sweep, and how it ended."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from tensegrity_codegen.sweeps.statuses import GOOD


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep has come.

    Attributes
    ----------
    cases : int
        Number of cases.
    finished : int
        How many are finished, those of earlier runs too.
    computed : int
        How many this run has computed.
    failed : int
        How many of all that are finished are not good.
    seconds : float
        Time since this run began to compute [s].
    """

    cases: int
    finished: int
    computed: int
    failed: int
    seconds: float

    @property
    def fraction(self) -> float:
        """Fraction of all cases that is finished."""
        return self.finished / self.cases

    @property
    def rate(self) -> float:
        """Cases a second of this run; 0 before the first."""
        return self.computed / self.seconds if self.seconds > 0.0 else 0.0


ShowProgress = Callable[[SweepProgress], None]


@dataclass(frozen=True)
class SweepOutcome:
    """How a run of a sweep ended.

    Attributes
    ----------
    path : Path
        The folder with the results.
    cases : int
        Number of cases.
    counts : mapping of str to int
        How many finished cases have each status.
    first_message : mapping of str to str
        The first message of each status that this run met and that is not good.
    computed : int
        How many cases this run has computed.
    seconds : float
        Time that this run took [s].
    damaged : int
        How many of these were in the folder before, but damaged or incomplete.
    stopped : bool
        Whether it ended before all cases were finished, since as many failed as `stop_after` says.
    beyond : int
        Number of cases whose members buckle or exceed a limit: `limit_use` above 1, where it is kept.
    empty : tuple of str
        Results that were asked for by `keep` and are NaN in every finished case.
    """

    path: Path
    cases: int
    counts: Mapping[str, int]
    first_message: Mapping[str, str]
    computed: int
    seconds: float
    damaged: int = 0
    stopped: bool = False
    beyond: int = 0
    empty: tuple[str, ...] = ()

    def describe_empty(self) -> str:
        """Return a warning of results that are NaN in every finished case, "" where there are none."""
        names = ", ".join(self.empty)
        return f"every value of {names} is NaN: these cases do not have what `keep` asks for" if names else ""

    @property
    def finished(self) -> int:
        """Number of finished cases."""
        return sum(self.counts.values())

    @property
    def good(self) -> int:
        """Number of cases whose results are there."""
        return sum(count for word, count in self.counts.items() if word in GOOD)

    @property
    def failed(self) -> int:
        """Number of finished cases that are not good."""
        return self.finished - self.good
