"""What long work takes from an earlier run, in words."""

import time
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Resumption:
    """What long work takes from an earlier run.

    Attributes
    ----------
    subject : str
        Scene or chapter.
    what : str
        What is counted, in the plural.
    taken, total : int
        How many are taken, and how many there are in all.
    written : float or None
        When the last of them was finished, as time.time() has it [s]; None where the journal does not say.
    is_stale : bool
        Whether an earlier run has results that are not used, since something differs.
    """

    subject: str
    what: str
    taken: int
    total: int
    written: float | None
    is_stale: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return everything in JSON's types; `written` in ISO 8601, with the offset from UTC."""
        written = None
        if self.written is not None:
            written = time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(self.written))
        return {
            "subject": self.subject,
            "what": self.what,
            "taken": self.taken,
            "total": self.total,
            "written": written,
        }

    def describe(self, now: float) -> str:
        """Return one sentence: "prism: 12 of 40 cases taken from the unfinished run of 19:40".

        now: as time.time() has it [s]; a run of another day has its date too.
        """
        if self.is_stale:
            return (
                f"{self.subject}: results of the run{self._name_time(now)} are not used: "
                "scene, options, code, packages or machine differ"
            )
        run = "unfinished run" if self.taken < self.total else "run"
        count = f"{self.taken} of {self.total}" if self.taken < self.total else f"all {self.total}"
        text = f"{self.subject}: {count} {self.what} taken from the {run}{self._name_time(now)}"
        return text if self.taken < self.total else f"{text}; `fresh=True` computes them again"

    def _name_time(self, now: float) -> str:
        if self.written is None:
            return " before"
        then = time.localtime(self.written)
        is_today = then[:3] == time.localtime(now)[:3]
        return time.strftime(" of %H:%M" if is_today else " of %Y-%m-%d %H:%M", then)
