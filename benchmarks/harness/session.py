"""One run: makes candidates, checks them against each other, times them in turns, keeps a row for each."""

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.tools import ROUNDS, TARGET, Candidate, Timing, Unavailable, Way, measure
from tensegrity_codegen.system.journal import Journal, read_record

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


class Kept:
    """Comparisons, large scenes and scripts of an interrupted run, and those that are finished now.

    Parameters
    ----------
    journal : Journal
        Where they are kept.
    move : callable
        Called with the fraction of the whole run that is done, 0 to 1.
    """

    def __init__(self, journal: Journal, move: Callable[[float], None] = lambda fraction: None) -> None:
        self.journal, self._move = journal, move
        self._left: set[str] = set()
        self._total = 0

    def announce(self, names: Sequence[str]) -> None:
        """Say how many of all parts of the run are taken; names: of all of them."""
        self._left = {name for name in names if self.journal.find(name) is None}
        self._total = len(names)
        self.journal.announce("bench", "parts", len(names) - len(self._left), len(names))
        self._report()

    def take(self, session: Session, structure: str, quantity: str) -> bool:
        """Add a finished comparison to the session; return whether there is one."""
        data = self.journal.find(name_comparison(structure, quantity))
        try:
            rows = [read_record(Row, row | {"error": None}) for row in data["rows"]]
            errors = [None if row["error"] is None else float(row["error"]) for row in data["rows"]]
            timings = {name: Timing(np.array(ns, dtype=np.float64)) for name, ns in data["timings"].items()}
            facts = {kind: data[kind] for kind in ("units", "unequal", "chosen")}
        except (KeyError, TypeError, ValueError, AttributeError):
            return False
        known = [row for row in rows if row is not None]
        if len(known) < len(rows) or not known:
            return False
        session.rows += [replace(row, error=error) for row, error in zip(known, errors, strict=True)]
        session.timings[structure, quantity] = timings
        for kind, value in facts.items():
            if value is not None:
                getattr(session, kind)[structure, quantity] = value
        return True

    def keep(self, session: Session, structure: str, quantity: str) -> None:
        """Keep the comparison that the session has made last."""
        where = (structure, quantity)
        rows = [
            vars(row) | {"error": None if row.error is None else str(row.error)}  # JSON has no infinity
            for row in session.rows
            if (row.structure, row.quantity) == where
        ]
        timings = {name: timing.rounds.tolist() for name, timing in session.timings[where].items()}
        data = {"rows": rows, "timings": timings}
        data |= {kind: getattr(session, kind).get(where) for kind in ("units", "unequal", "chosen")}
        self.journal.store(name_comparison(*where), data)
        self.finish(name_comparison(*where))

    def find(self, name: str, work: Callable[[], Any], is_good: Callable[[Any], bool]) -> Any:
        """Return what is kept under this name, else what `work` returns, which is kept if it is good."""
        found = self.journal.find(name)
        if found is None:
            found = work()
            if is_good(found):
                self.journal.store(name, found)
        self.finish(name)
        return found

    def finish(self, name: str) -> None:
        """Note that a part of the run is finished."""
        self._left.discard(name)
        self._report()

    def _report(self) -> None:
        self._move(1.0 - len(self._left) / max(self._total, 1))


def name_comparison(structure: str, quantity: str) -> str:
    """Return the name of a comparison among the parts of a run."""
    return f"{structure}, {quantity}"
