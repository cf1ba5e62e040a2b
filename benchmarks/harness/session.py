"""One run: makes candidates, checks them against each other, times them in turns, keeps a row for each."""

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.candidate import ROUNDS, TARGET, Candidate, Timing, Unavailable, measure
from harness.tools import Way

MAKE_LIMIT = 240.0  # s to make one candidate, compiler included
TOLERANCE = 1e-9  # relative; a candidate beyond it computes something else and is not timed


@dataclass(frozen=True)
class Row:
    """One candidate at one structure and quantity: what was measured, or why nothing was.

    ns: median for one evaluation; spread: distance of quartiles over median; times: how many times faster
    than the baseline; error: largest difference from the first candidate over its largest value.
    """

    structure: str
    members: int
    quantity: str
    name: str
    side: str
    called: str = ""
    ns: float | None = None
    spread: float | None = None
    baseline: str = ""
    times: float | None = None
    error: float | None = None
    code_bytes: int | None = None
    table_bytes: int | None = None
    compile_seconds: float | None = None
    compile_peak: int | None = None
    made_seconds: float | None = None
    note: str = ""

    @property
    def ns_member(self) -> float | None:
        """Nanoseconds a member."""
        return None if self.ns is None else self.ns / self.members


@dataclass
class Session:
    """All rows so far, by (structure, quantity) the timings and results behind them.

    say: tells the user how far it is; limit: to make a candidate [s]; values: results of the last comparison;
    units: largest difference between our own results, in units in the last place of the largest term;
    unequal: values of reference builds that are not CasADi's to the bit; chosen: the emitter `auto` takes.
    """

    rounds: int = ROUNDS
    target: float = TARGET
    say: Callable[[str], None] = lambda text: None
    limit: float = MAKE_LIMIT
    rows: list[Row] = field(default_factory=list)
    timings: dict[tuple[str, str], dict[str, Timing]] = field(default_factory=dict)
    values: dict[tuple[str, str], dict[str, NDArray[np.float64]]] = field(default_factory=dict)
    units: dict[tuple[str, str], float] = field(default_factory=dict)
    unequal: dict[tuple[str, str], int] = field(default_factory=dict)
    chosen: dict[tuple[str, str], str | None] = field(default_factory=dict)

    def compare(
        self,
        structure: str,
        members: int,
        quantity: str,
        ways: Sequence[tuple[str, Way]],
        baselines: Sequence[str] = (),
    ) -> None:
        """Make, check and time candidates, given as (side, (title, maker)); the first one is the reference.

        baselines: names of candidates to compare with; the first that is there is taken.
        """
        where = f"{structure}, {quantity}"
        made = [self._make(where, side, way) for side, way in ways]
        there = [item for item in made if isinstance(item, Candidate)]
        errors = self._check(structure, quantity, there)
        fair = [item for item in there if errors[item.name] <= TOLERANCE]
        self.say(f"{where}: {len(fair)} candidates in turns")
        timing = measure(fair, self.rounds, self.target) if fair else {}
        self.timings[structure, quantity] = timing
        base = next((name for name in baselines if name in timing), "")
        for (side, (title, _)), item in zip(ways, made, strict=True):
            common = {"structure": structure, "members": members, "quantity": quantity, "side": side}
            if isinstance(item, str):
                self.rows.append(Row(**common, name=title, note=item))
            else:
                self.rows.append(_row(common, item, timing, base, errors[item.name]))

    def row(self, structure: str, quantity: str, name: str) -> Row | None:
        """Return the row of that candidate, None if there is none."""
        return next(
            (r for r in self.rows if (r.structure, r.quantity, r.name) == (structure, quantity, name)), None
        )

    def _make(self, where: str, side: str, way: Way) -> Candidate | str:
        """Return the candidate, warmed up, or why there is none."""
        title, make = way
        self.say(f"{where}: making {title}")
        try:
            with _limited(self.limit):
                candidate = make()
                candidate.run(1)
        except Unavailable as reason:
            return str(reason)
        except TimeoutError:
            return f"not made within {self.limit:.0f} s"
        except Exception as error:  # one that breaks must not take the others along; its row says so
            return f"failed: {type(error).__name__}: {str(error)[:120]}"
        candidate.name, candidate.side = title, side
        return candidate

    def _check(self, structure: str, quantity: str, there: Sequence[Candidate]) -> dict[str, float]:
        values = {item.name: np.asarray(item.value(), dtype=np.float64) for item in there}
        self.values = {(structure, quantity): values}
        return {item.name: relative_error(values[item.name], values[there[0].name]) for item in there}


def relative_error(value: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """Return the largest difference over the largest reference; entries that are NAN in `value` are left out.

    Infinite where shapes differ or nothing is left to compare.
    """
    if value.shape != reference.shape:
        return float("inf")
    known = ~np.isnan(value)
    if not known.any():
        return float("inf")
    return float(np.abs(value - reference)[known].max() / np.abs(reference).max())


def _row(
    common: dict[str, object], item: Candidate, timing: dict[str, Timing], base: str, error: float
) -> Row:
    measured = timing.get(item.name)
    built = item.built
    return Row(
        **common,  # type: ignore[arg-type]
        name=item.name,
        called=item.called,
        ns=measured.median if measured else None,
        spread=measured.spread if measured else None,
        baseline=base,
        times=measured.times_faster_than(timing[base]) if measured and base else None,
        error=error,
        code_bytes=built.code_bytes if built else None,
        table_bytes=built.table_bytes if built else None,
        compile_seconds=built.seconds if built else None,
        compile_peak=built.peak_memory if built else None,
        made_seconds=item.made,
        note="" if measured else "computes something else",
    )


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise TimeoutError after that many seconds, where the system has alarms and this is the main thread."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def stop(number: int, frame: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
