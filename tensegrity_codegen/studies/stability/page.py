"""The page of outcomes: what is wrong, verdicts by method, errors, all cases, messages."""

from collections.abc import Iterator, Sequence

from tensegrity_codegen.report.pages.page import Block, Chapter, Page, Remark, Section, Verdict
from tensegrity_codegen.report.pages.page_table import Column, Table, text_cell
from tensegrity_codegen.studies.stability.error_figure import draw_errors
from tensegrity_codegen.studies.stability.finding import WORDS, describe_counts, describe_finding
from tensegrity_codegen.studies.stability.judge import RULES, VERDICTS
from tensegrity_codegen.studies.stability.outcome import NOT_RUN, Limits, Outcome
from tensegrity_codegen.studies.stability.page_tables import (
    RULE_WORDS,
    build_grid,
    build_messages,
    build_verdicts,
    build_worst,
)
from tensegrity_codegen.system.provenance import describe_provenance

LEAD = (
    "A result that a method reports as good is right if its certified error is at most ten times the "
    "tolerance, of other programs at most a hundredth of the mean member length where that is more. A "
    "reference is certified by two methods that agree, or by extended precision with two step lengths."
)
FIXED = (
    "Methods with a fixed step have no tolerance: their results are right within a hundredth of the mean "
    "member length, and of the largest speed. Of other programs, whose tolerances bound the error of each "
    "step, positions alone are judged."
)


def build_page(outcomes: dict[str, tuple[Outcome, ...]], t_end: float, limits: Limits) -> Page:
    """Return the page of outcomes by name of the scene; t_end [s] and limits are stated on it."""
    return Page(
        title=describe_finding(outcomes),
        subject=f"Stiff and extreme cases of {', '.join(outcomes)}",
        lead=f"{describe_counts(outcomes)} {LEAD}",
        chapters=tuple(
            _chapter(name, rows, f"scene{n}", t_end, is_alone=len(outcomes) == 1)
            for n, (name, rows) in enumerate(outcomes.items())
        ),
        facts=(
            *describe_provenance(),
            f"At most {limits.run:g} s of CPU time a run, {limits.reference:g} s a run for a reference, "
            f"{limits.total:g} s by the clock for everything.",
            FIXED,
            *(f"{WORDS[word]}: {meaning}." for word, meaning in VERDICTS.items()),
            *(f"Checked by {RULE_WORDS[rule]}: {meaning}." for rule, meaning in RULES.items()),
        ),
        summary_heads=("part", "what", "result"),
    )


def _chapter(name: str, rows: tuple[Outcome, ...], anchor: str, t_end: float, *, is_alone: bool) -> Chapter:
    own = tuple(row for row in rows if row.is_own)
    peers = tuple(row for row in rows if not row.is_own)
    sections = [
        *_wrong(own, f"{anchor}-wrong"),
        *_errors(own, name, f"{anchor}-errors"),
        _verdicts(rows, f"{anchor}-who"),
        *_list_not_run(rows, f"{anchor}-not-run"),
        _grid(own, f"{anchor}-own", "Every case with our methods", "error over tolerance"),
    ]
    if peers:
        sections.append(_grid(peers, f"{anchor}-peers", "Every case with other programs", "error [m]"))
    sections.append(_messages(own, f"{anchor}-reasons"))
    cases = f"{len({(r.group, r.case) for r in rows})} cases of {t_end:g} s"
    title = cases if is_alone else describe_finding({name: rows})
    return Chapter(anchor, name, title, "" if is_alone else f"{cases}.", tuple(sections))


def _wrong(own: Sequence[Outcome], anchor: str) -> Iterator[Section]:
    """Yield a section of wrong results of our methods, none if there are none."""
    wrong = [row for row in own if row.verdict == "wrong"]
    if wrong:
        remark = Remark("wrong", "These results have status ok, and must not be used.")
        table = build_messages(wrong, "Wrong results of our methods")
        yield Section(anchor, "ours", "Wrong results", "wrong", describe_finding({"": own}), (remark, table))


def _list_not_run(rows: Sequence[Outcome], anchor: str) -> Iterator[Section]:
    """Yield a section of the cases that were not run, none if all were."""
    cases = dict.fromkeys((row.group, row.case, row.message) for row in rows if row.verdict == NOT_RUN)
    if cases:
        columns = tuple(Column(name, numeric=False) for name in ("case", "value", "reason"))
        table = Table("Cases without a result", columns, tuple(tuple(map(text_cell, case)) for case in cases))
        result = f"{len(cases)} cases; the same command runs them, if it may replace this page"
        yield Section(anchor, "all", "Not run", "plain", result, (table,))


def _verdicts(rows: Sequence[Outcome], anchor: str) -> Section:
    methods = len({row.contender for row in rows if row.is_own})
    peers = len({row.contender for row in rows if not row.is_own})
    result = f"{methods} methods of ours" + (f", {peers} of other programs" if peers else "")
    return Section(anchor, "all", "Verdicts by method", "plain", result, (build_verdicts(rows),))


def _errors(own: Sequence[Outcome], name: str, anchor: str) -> Iterator[Section]:
    """Yield the diagram and the table of the largest errors, nothing where none is certified."""
    known = [row for row in own if row.error is not None]
    if known:
        worst = max(known, key=lambda row: row.error or 0.0)
        result = (
            f"largest: {worst.error:.3g} times the tolerance, {worst.contender}, {worst.group}: {worst.case}"
        )
        blocks: tuple[Block, ...] = (*draw_errors(known, name, f"{anchor}-figure"), build_worst(own))
        yield Section(anchor, "ours", "Errors over tolerance", "plain", result, blocks)


def _grid(rows: Sequence[Outcome], anchor: str, title: str, what: str) -> Section:
    counts = {word: sum(row.verdict == word for row in rows) for word in VERDICTS}
    result = ", ".join(f"{count} {WORDS[word]}" for word, count in counts.items() if count)
    is_own = all(row.is_own for row in rows)
    verdict: Verdict = "wrong" if is_own and counts["wrong"] else "plain"
    return Section(anchor, "ours" if is_own else "others", title, verdict, result, (build_grid(rows, what),))


def _messages(own: Sequence[Outcome], anchor: str) -> Section:
    stopped = [row for row in own if row.verdict in ("stopped", "over time", "unchecked")]
    table = build_messages(stopped, "Runs of our methods without a checked result")
    blocks: tuple[Block, ...] = (table,) if stopped else ()
    return Section(
        anchor, "ours", "Messages of runs without a checked result", "plain", f"{len(stopped)} runs", blocks
    )
