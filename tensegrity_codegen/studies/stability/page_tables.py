"""Tables of the page of outcomes; the worst rows of long tables stay visible."""

from collections import Counter
from collections.abc import Sequence

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table, number_cell, text_cell
from tensegrity_codegen.studies.stability.finding import WORDS, sort_worst
from tensegrity_codegen.studies.stability.judge import RULES, VERDICTS
from tensegrity_codegen.studies.stability.outcome import Outcome

# Rule -> how a page writes it.
RULE_WORDS = {
    "plain": "positions and velocities",
    "told": "positions, and the stated bound of velocities",
    "positions": "positions only",
}
MARKS = {"told": " *", "positions": " **"}
MOST_WORST, MOST_HEAD = 10, 8


def build_verdicts(rows: Sequence[Outcome]) -> Table:
    """Return how often each method and each peer has which verdict, verdicts that never occur left out."""
    counts = Counter((row.contender, row.verdict) for row in rows)
    used = [
        word for word in VERDICTS if word in ("survived", "wrong") or any(r.verdict == word for r in rows)
    ]
    own = {row.contender: row.is_own for row in sorted(rows, key=lambda row: not row.is_own)}
    columns = (
        Column("method", numeric=False),
        Column("code", numeric=False),
        *(Column(WORDS[word]) for word in used),
    )
    cells = tuple(
        (
            text_cell(name),
            text_cell("ours" if is_own else "other"),
            *(text_cell(str(counts[name, word])) for word in used),
        )
        for name, is_own in own.items()
    )
    return Table("Number of cases by verdict", columns, cells)


def build_worst(own: Sequence[Outcome]) -> Table:
    """Return the largest certified errors of our methods, wrong results first."""
    worst = sort_worst(own)[:MOST_WORST]
    columns = (
        Column("case", numeric=False),
        Column("value", numeric=False),
        Column("method", numeric=False),
        Column("error over tolerance"),
        Column("error of tensions", "%"),
        Column("verdict", numeric=False),
    )
    cells = tuple(
        (
            text_cell(row.group),
            text_cell(row.case),
            text_cell(row.contender),
            number_cell(row.error, ".3g"),
            number_cell(None if row.tension_error is None else 100 * row.tension_error, ".1e"),
            text_cell(_verdict(row)),
        )
        for row in worst
    )
    count = sum(row.error is not None for row in own)
    return Table(
        f"The {len(worst)} largest of {count:,} certified errors", columns, cells, note=_explain(worst)
    )


def build_grid(rows: Sequence[Outcome], what: str) -> Table:
    """Return a row a case, a column a method; `what` the number beside a verdict is."""
    contenders = list(dict.fromkeys(row.contender for row in rows))
    by_case: dict[tuple[str, str], dict[str, Outcome]] = {}
    for row in rows:
        by_case.setdefault((row.group, row.case), {})[row.contender] = row
    columns = (
        Column("case", numeric=False),
        Column("value", numeric=False),
        *(Column(name, numeric=False) for name in contenders),
    )
    cells = tuple(
        (text_cell(group), text_cell(case), *(_cell(found.get(name)) for name in contenders))
        for (group, case), found in by_case.items()
    )
    order = list(dict.fromkeys((row.group, row.case) for row in sort_worst(rows)))
    places = {case: k for k, case in enumerate(by_case)}
    head = tuple(places[case] for case in order[:MOST_HEAD])
    wrong = len({(row.group, row.case) for row in rows if row.verdict == "wrong"})
    note = f"{len(head)} with the largest errors" + (f", {wrong} with wrong results first" if wrong else "")
    return Table(
        f"Verdict and {what}", columns, cells, note=_explain(rows), head=head, head_note=note if head else ""
    )


def build_messages(rows: Sequence[Outcome], caption: str) -> Table:
    """Return what runs reported."""
    columns = tuple(Column(name, numeric=False) for name in ("case", "value", "method", "verdict", "message"))
    cells = tuple(
        tuple(text_cell(word) for word in (r.group, r.case, r.contender, _verdict(r), r.message))
        for r in rows
    )
    return Table(caption, columns, cells)


def _verdict(row: Outcome) -> str:
    if row.verdict == "stopped":
        return f"stopped: {row.status.replace('_', ' ')}"
    return WORDS[row.verdict] + (MARKS.get(row.rule, "") if row.is_own else "")


def _cell(row: Outcome | None) -> Cell:
    if row is None:
        return text_cell("–")
    if row.error is None:
        return text_cell(_verdict(row))
    mark = MARKS.get(row.rule, "") if row.is_own else ""
    return Cell((("", f"{WORDS[row.verdict]}, {format_number(row.error, '.3g')}{mark}"),), row.error)


def _explain(rows: Sequence[Outcome]) -> str:
    """Return what the marks in cells mean, of those that occur."""
    used = [rule for rule in RULES if rule in MARKS and any(row.is_own and row.rule == rule for row in rows)]
    return " ".join(f"{MARKS[rule].strip()} Checked by {RULE_WORDS[rule]}." for rule in used)
