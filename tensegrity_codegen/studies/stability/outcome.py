"""The result of one case with one method, as it is kept, shown and written; and the limits of the runs."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.studies.stability.judge import RULES, VERDICTS
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.journal import read_record

NOT_RUN = "not run"


@dataclass(frozen=True)
class Limits:
    """How long a run may take, a reference, and all runs together.

    Attributes
    ----------
    run, reference : float
        CPU time of one run, and of one run for a reference [s].
    total : float
        Time by the clock for all cases of all scenes [s]. Cases that are not done by then are not run.
    peers : bool
        Whether peers are run too.
    compiles : bool
        Whether a reference may be compiled for one case alone, where two methods do not certify it.
    """

    run: float = 2.0
    reference: float = 4.0
    total: float = 540.0
    peers: bool = True
    compiles: bool = True

    def check(self) -> None:
        """Raise InvalidValueError if a time is out of range."""
        for key, value in (("limit", self.run), ("limit", self.reference), ("budget", self.total)):
            if not (0.0 < value < float("inf")):
                raise InvalidValueError(
                    "out of range", where=key, given=value, allowed="a finite number > 0 [s]"
                )


@dataclass(frozen=True)
class Outcome:
    """One case with one method.

    error: of ours, the largest certified error over the tolerance; of a peer, the largest error of a
    coordinate [m]; None where nothing certifies. rule: one of RULES by which it was judged, "" where none;
    tension_error: of ours, the largest error of a tension over the largest tension.
    """

    group: str
    case: str
    contender: str
    is_own: bool
    verdict: str
    error: float | None
    status: str
    message: str
    seconds: float
    rule: str
    tension_error: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome in JSON's types."""
        return dataclasses.asdict(self)

    @classmethod
    def not_run(cls, group: str, case: str, contender: str, is_own: bool, why: str) -> "Outcome":
        """Return the outcome of what was not run, with the reason."""
        return cls(group, case, contender, is_own, NOT_RUN, None, NOT_RUN, why, 0.0, "", None)


def read_outcomes(data: Any, contenders: Mapping[str, bool]) -> list[Outcome] | None:
    """Return the outcomes of a case from a journal, None if they are not those of just these contenders.

    contenders: name -> whether it is one of our methods.
    """
    if not isinstance(data, list):
        return None
    found = [outcome for item in data if (outcome := read_record(Outcome, item)) is not None]
    if len(found) != len(data) or {row.contender: row.is_own for row in found} != dict(contenders):
        return None
    known = all(row.verdict in VERDICTS and row.rule in ("", *RULES) for row in found)
    return found if known and len(found) == len(contenders) else None
