"""What a run has finished, kept so that the same command goes on from there."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harness.candidate import Timing
from harness.session import Row, Session
from tensegrity_codegen.system.journal import Journal, read_record


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
