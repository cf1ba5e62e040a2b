"""One measured row of a report, as it is kept, shown and written."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.system.journal import read_record

CLEARLY = 2.0  # times the time of another setting


@dataclass(frozen=True)
class Row:
    """One contender at one setting: error [m], CPU seconds of the whole motion, and what it says of itself.

    error: largest error of a node coordinate at the samples; infinite, kept as null, where the run did not
    come to its end. energy_drift: largest change of the total energy [J] at the samples, null where it is
    not kept or not known; length_error: largest change of the length of a rigid bar [m].
    """

    contender: str
    group: str
    formulation: str
    method: str
    kind: str
    setting: float
    error: float
    seconds: float
    status: str
    message: str
    n_steps: int
    n_evaluations: int
    energy_drift: float | None
    length_error: float | None

    @property
    def program(self) -> str:
        """Name of the program, with which that of another program's row begins."""
        return self.contender.split()[0]

    @property
    def is_good(self) -> bool:
        """Whether the run came to its end and calls itself good."""
        return self.status == "ok" and math.isfinite(self.error)

    def as_dict(self) -> dict[str, Any]:
        """Return the row in JSON's types."""
        data = dataclasses.asdict(self)
        return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in data.items()}

    @classmethod
    def from_dict(cls, data: Any) -> "Row | None":
        """Return the row that `as_dict` wrote, None if `data` is no such thing."""
        if not isinstance(data, Mapping) or "error" not in data:
            return None
        row = read_record(cls, {**data, "error": 0.0 if data["error"] is None else data["error"]})
        return row if row is None or data["error"] is not None else dataclasses.replace(row, error=math.inf)


def find_front(rows: list[Row]) -> list[Row]:
    """Return the rows that no other row beats in both error and time, the most accurate last."""
    front: list[Row] = []
    for row in sorted((r for r in rows if r.is_good), key=lambda r: (r.seconds, r.error)):
        if not front or row.error < front[-1].error:
            front.append(row)
    return front


def is_clearly_slower(row: Row, others: Sequence[Row]) -> bool:
    """Return whether another setting of the same program takes half the time for no larger error."""
    rivals = [other for other in others if other.program == row.program and other.contender != row.contender]
    return any(r.is_good and CLEARLY * r.seconds < row.seconds and r.error <= row.error for r in rivals)


def recommend(rows: list[Row], wanted: float) -> Row | None:
    """Return the fastest of our own rows whose error is at most `wanted` [m], None if there is none."""
    good = [row for row in rows if row.group == "own" and row.is_good and row.error <= wanted]
    return min(good, key=lambda row: row.seconds, default=None)
