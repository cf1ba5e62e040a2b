"""The outcomes as one page and one data file."""

import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensegrity_codegen.report.pages.render_page import render_page
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.judge import NOT_RUN, RULES, Limits, Outcome
from tensegrity_codegen.studies.stability.page import build_page
from tensegrity_codegen.studies.stability.run_cases import run_cases
from tensegrity_codegen.studies.study import hash_study, prepare_study
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.output_folder import write_folder
from tensegrity_codegen.system.progress import part_of
from tensegrity_codegen.system.resumption import Resumption

PAGE_NAME, DATA_NAME = "stability.html", "stability.json"
JOURNAL_NAME = "journal"


@dataclass(frozen=True)
class StabilityReport:
    """Outcomes by name of the scene, and the files that they stand in."""

    outcomes: dict[str, tuple[Outcome, ...]]
    html: Path
    data: Path
    t_end: float
    limits: Limits

    @property
    def cases_not_run(self) -> tuple[tuple[str, str, str], ...]:
        """Scene, group and name of every case that was not run."""
        rows = [(name, row) for name, rows in self.outcomes.items() for row in rows]
        return tuple(dict.fromkeys((n, r.group, r.case) for n, r in rows if r.verdict == NOT_RUN))

    def count(self, verdict: str, *, own: bool) -> int:
        """Return how often a verdict fell on our methods, or on peers."""
        rows = [row for rows in self.outcomes.values() for row in rows]
        return sum(row.verdict == verdict and row.is_own == own for row in rows)

    def count_rule(self, rule: str) -> int:
        """Return how many results of our methods were judged by one of RULES."""
        return sum(row.rule == rule and row.is_own for rows in self.outcomes.values() for row in rows)

    def as_dict(self) -> dict[str, Any]:
        """Return all outcomes in JSON's types."""
        return {
            "t_end": self.t_end,
            "limits": dataclasses.asdict(self.limits),
            "rules": {rule: self.count_rule(rule) for rule in RULES},
            "not_run": [{"scene": s, "group": g, "case": c} for s, g, c in self.cases_not_run],
            "scenes": {name: [row.as_dict() for row in rows] for name, rows in self.outcomes.items()},
        }


def write_stability(
    structures: Sequence[Structure],
    folder: Path,
    *,
    t_end: float,
    limits: Limits,
    compiler: str | None,
    flags: str,
    progress: Callable[[float], None] | None = None,
    fresh: bool = False,
    overwrite: bool = False,
    notice: Callable[[Resumption], None] | None = None,
) -> StabilityReport:
    """Run all cases of some structures and write stability.html and .json into `folder`.

    Finished cases go into a journal in the folder at once. The same call again takes them from there, if
    code, scene, options and machine are the same, and runs the others; with `fresh` it runs all. `notice` is
    called with what is taken. All scenes share limits.total: each
    has an equal part of the time that is left when it begins.

    Raises
    ------
    InvalidValueError
        For a time out of range.
    DuplicateNameError
        For two scenes of one name.
    OutputError
        For a folder that cannot be written, or that holds these files, without `overwrite`.
    """
    limits.check()
    prepare_study(structures, t_end, folder, (PAGE_NAME, DATA_NAME), overwrite=overwrite)
    end, outcomes = time.monotonic() + limits.total, dict[str, tuple[Outcome, ...]]()
    options = (t_end.hex(), repr(dataclasses.replace(limits, total=0.0)))  # the total changes no result
    for number, structure in enumerate(structures):
        now, left = time.monotonic(), len(structures) - number
        key = hash_study(structure, compiler, flags, *options)
        outcomes[structure.name] = run_cases(
            structure,
            t_end,
            limits,
            compiler=compiler,
            flags=flags,
            journal=Journal(
                folder / JOURNAL_NAME / f"{structure.name}.jsonl", key, fresh=fresh, notice=notice
            ),
            deadline=now + max(0.0, end - now) / left,
            progress=part_of(progress, number / len(structures), 1.0 / len(structures)),
        )
    found = StabilityReport(outcomes, folder / PAGE_NAME, folder / DATA_NAME, t_end, limits)
    data = json.dumps(found.as_dict(), indent=1, allow_nan=False) + "\n"
    page = render_page(build_page(outcomes, t_end, limits))
    files = {PAGE_NAME: page.encode("utf-8"), DATA_NAME: data.encode("utf-8")}
    write_folder(folder, files, overwrite=overwrite)
    return found
