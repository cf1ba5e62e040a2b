"""The outcomes as one page and one data file."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.files import write_folder
from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.page import Chapter, Page, Paragraph, Section, Verdict
from tensegrity_codegen.report.page_table import Cell, Column, Table, text_cell
from tensegrity_codegen.report.render_page import render_page
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.studies.processor import name_processor
from tensegrity_codegen.studies.progress import part_of
from tensegrity_codegen.studies.stability.judge import RULES, VERDICTS
from tensegrity_codegen.studies.stability.run import Limits, Outcome, run_cases
from tensegrity_codegen.version import VERSION

__all__ = ["StabilityReport", "write_stability"]

PAGE_NAME, DATA_NAME = "stability.html", "stability.json"
LEAD = (
    "Stiff and extreme cases made from each scene, with every method. Whoever calls a result good is held to "
    "it: its error against a reference that two methods, or extended precision with shorter steps, certify "
    "must be at most ten times the tolerance asked for. Only where a run itself says by how much velocities "
    "of bars are off that vibrate unseen, velocities are held to that; such results are marked and counted. "
    "Tensions are held to what errors within the tolerance come to in them. Methods with a fixed step are "
    "told no tolerance and held to a hundredth of the mean member length and of the largest speed, peers to "
    "a hundredth of the mean member length in coordinates alone."
)
MARKS = {"plain": "", "told": " (speeds as told)", "positions": " (positions only)"}


@dataclass(frozen=True)
class StabilityReport:
    """Outcomes by name of the scene, and the files that they stand in."""

    outcomes: dict[str, tuple[Outcome, ...]]
    html: Path
    data: Path

    def count(self, verdict: str, *, own: bool) -> int:
        """Return how often a verdict fell on our methods, or on peers."""
        rows = [row for rows in self.outcomes.values() for row in rows]
        return sum(row.verdict == verdict and row.is_own == own for row in rows)

    def count_rule(self, rule: str) -> int:
        """Return how many results of our methods were held to one of RULES."""
        return sum(row.rule == rule and row.is_own for rows in self.outcomes.values() for row in rows)

    def as_dict(self) -> dict[str, Any]:
        """Return all outcomes in JSON's types."""
        return {
            "rules": {rule: self.count_rule(rule) for rule in RULES},
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
) -> StabilityReport:
    """Run all cases of some structures and write stability.html and .json into `folder`.

    Raises InvalidValueError for a time out of range, OutputError.
    """
    for key, value in (("--t-end", t_end), ("--limit", limits.run)):
        if not (0.0 < value < float("inf")):
            raise InvalidValueError("out of range", where=key, given=value, allowed="a finite number > 0 [s]")
    outcomes: dict[str, tuple[Outcome, ...]] = {}
    for number, structure in enumerate(structures):
        move = part_of(progress, number / len(structures), 1.0 / len(structures))
        outcomes[structure.name] = run_cases(
            structure, t_end, limits, compiler=compiler, flags=flags, progress=move
        )
    found = StabilityReport(outcomes, folder / PAGE_NAME, folder / DATA_NAME)
    data = json.dumps(found.as_dict(), indent=1, allow_nan=False) + "\n"
    page = render_page(_page(outcomes, t_end))
    write_folder(folder, {PAGE_NAME: page.encode("utf-8"), DATA_NAME: data.encode("utf-8")})
    return found


def _page(outcomes: dict[str, tuple[Outcome, ...]], t_end: float) -> Page:
    return Page(
        title="Stiff and extreme cases",
        lead=LEAD,
        chapters=tuple(
            _chapter(name, rows, f"scene{n}", t_end) for n, (name, rows) in enumerate(outcomes.items())
        ),
        facts=(
            f"tensegrity_codegen {VERSION}.",
            f"Processor: {name_processor()}.",
            *(f"{word}: {meaning}." for word, meaning in VERDICTS.items()),
            *(f"Rule {rule!r}: {meaning}." for rule, meaning in RULES.items()),
        ),
        summary_heads=("part", "what", "result"),
    )


def _chapter(name: str, rows: tuple[Outcome, ...], anchor: str, t_end: float) -> Chapter:
    own = tuple(row for row in rows if row.is_own)
    peers = tuple(row for row in rows if not row.is_own)
    sections = [
        _survival(rows, f"{anchor}-who"),
        _grid(own, f"{anchor}-own", "ours", "Our methods", "error over tolerance"),
    ]
    if peers:
        sections.append(_grid(peers, f"{anchor}-peers", "peers", "Peers", "error [m]"))
    sections.append(_reasons(own, f"{anchor}-reasons"))
    return Chapter(
        anchor, name, f"{t_end:g} s", f"{len({(r.group, r.case) for r in rows})} cases.", tuple(sections)
    )


def _survival(rows: tuple[Outcome, ...], anchor: str) -> Section:
    """Return the table of how often each method and each peer came to which verdict."""
    contenders = list(dict.fromkeys(row.contender for row in rows))
    columns = (Column("who", numeric=False), *(Column(word) for word in VERDICTS))
    counts = {(name, word): 0 for name in contenders for word in VERDICTS}
    for row in rows:
        counts[row.contender, row.verdict] += 1
    cells = tuple(
        (text_cell(name), *(text_cell(str(counts[name, word])) for word in VERDICTS)) for name in contenders
    )
    block = Table("Cases by verdict", columns, cells)
    return Section(anchor, "all", "Who survives", "plain", f"{len(contenders)} contenders", (block,))


def _grid(rows: tuple[Outcome, ...], anchor: str, source: str, title: str, what: str) -> Section:
    contenders = list(dict.fromkeys(row.contender for row in rows))
    by_case: dict[tuple[str, str], dict[str, Outcome]] = {}
    for row in rows:
        by_case.setdefault((row.group, row.case), {})[row.contender] = row
    columns = (
        Column("case", numeric=False),
        Column("value", numeric=False),
        *(Column(name, numeric=False) for name in contenders),
    )
    table = Table(
        f"Verdict, with {what} where it is certified",
        columns,
        tuple(
            (text_cell(group), text_cell(case), *(_cell(found.get(name)) for name in contenders))
            for (group, case), found in by_case.items()
        ),
    )
    counts = {word: sum(row.verdict == word for row in rows) for word in VERDICTS}
    result = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    result += _told(rows) if source == "ours" else ""
    verdict: Verdict = "differs" if source == "ours" and counts["wrong"] else "plain"
    return Section(anchor, source, title, verdict, result, (table,))


def _told(rows: tuple[Outcome, ...]) -> str:
    """Return by which rules results with a certified error were judged, in words."""
    counts = {rule: sum(row.rule == rule for row in rows) for rule in RULES}
    return (
        f"; of those certified {counts['plain']} by the plain rule, {counts['told']} with velocities as "
        f"the run told, {counts['positions']} in positions only"
    )


def _cell(row: Outcome | None) -> Cell:
    if row is None:
        return text_cell("–")
    if row.error is None:
        return text_cell(row.verdict if row.verdict != "stopped" else f"stopped: {row.status}")
    mark = MARKS.get(row.rule, "") if row.is_own else ""
    return Cell((("", f"{row.verdict}, {format_number(row.error, '.1e')}{mark}"),), row.error)


def _reasons(rows: tuple[Outcome, ...], anchor: str) -> Section:
    stopped = [row for row in rows if row.verdict in ("stopped", "over time", "wrong")]
    columns = tuple(
        Column(name, numeric=False) for name in ("case", "value", "method", "verdict", "what it said")
    )
    cells = tuple(
        tuple(text_cell(word) for word in (r.group, r.case, r.contender, r.verdict, r.message))
        for r in stopped
    )
    block = Table("What our methods said", columns, cells) if cells else Paragraph("None of them stopped.")
    return Section(anchor, "words", "Where ours stopped, and why", "plain", f"{len(stopped)} runs", (block,))
