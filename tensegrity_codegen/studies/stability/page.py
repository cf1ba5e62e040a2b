"""The page of outcomes: wrong results, verdicts by method, errors, all cases, messages."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, choose_styles, method_series
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Figure,
    Page,
    Remark,
    Section,
    Verdict,
    diagram_figure,
)
from tensegrity_codegen.report.pages.page_table import Cell, Table, make_table, text_cell
from tensegrity_codegen.studies.stability.judge import ALLOWED, NOT_RUN, RULES, VERDICTS, Limits, Outcome
from tensegrity_codegen.system.errors import MissingExtraError
from tensegrity_codegen.system.extras import require_plot
from tensegrity_codegen.system.provenance import describe_provenance

Outcomes = Mapping[str, Sequence[Outcome]]

# Verdict -> how a page writes it.
WORDS = {
    "survived": "right",
    "stopped": "stopped",
    "over time": "over the time limit",
    "unchecked": "no reference",
    "wrong": "wrong",
    "not able": "not possible",
    "not run": "not run",
}
CHECKED = ("survived", "wrong")


def describe_finding(outcomes: Outcomes) -> str:
    """Return how many checked results of our methods are wrong, of which methods, and what was not run."""
    own_rows = [row for rows in outcomes.values() for row in rows if row.is_own]
    checked = sum(row.verdict in CHECKED for row in own_rows)
    wrong = Counter(row.contender for row in own_rows if row.verdict == "wrong")
    if not checked:
        return f"0 results of {count_cases(outcomes):,} cases could be checked"
    text = f"{wrong.total():,} of {checked:,} checked results wrong"
    if wrong:
        text += ": " + ", ".join(f"{name} {count:,}" for name, count in wrong.most_common())
    missing = sum(row.verdict == NOT_RUN for row in own_rows)
    return f"{text}; {missing:,} of {len(own_rows):,} runs not made" if missing else text


def describe_counts(outcomes: Outcomes) -> str:
    """Return cases, methods, and every other verdict on our methods, as sentences."""
    own_rows = [row for rows in outcomes.values() for row in rows if row.is_own]
    counts = Counter(row.verdict for row in own_rows)
    methods = len({row.contender for row in own_rows})
    cases = count_cases(outcomes)
    plural = "" if cases == 1 else "s"
    opening = f"{cases:,} case{plural} of {', '.join(outcomes)}, "
    opening += f"run with {methods} methods: {len(own_rows):,} runs."
    clauses = [f"{counts['survived']:,} results are right"]
    texts = {
        "wrong": "{} wrong",
        "stopped": "{} runs stopped with a status",
        "over time": "{} took longer than the time limit",
        "unchecked": "{} have no certified reference",
        NOT_RUN: "{} were not run",
    }
    clauses += [text.format(f"{counts[key]:,}") for key, text in texts.items() if counts[key]]
    return f"{opening} {', '.join(clauses)}."


def count_cases(outcomes: Outcomes) -> int:
    """Return the number of cases of all scenes."""
    return len({(scene, row.group, row.case) for scene, rows in outcomes.items() for row in rows})


def sort_worst(rows: Iterable[Outcome]) -> list[Outcome]:
    """Return checked outcomes, wrong ones first, then by error, the largest first."""
    checked = [row for row in rows if row.error is not None or row.verdict == "wrong"]
    return sorted(checked, key=lambda row: (row.verdict != "wrong", -(row.error or 0.0)))


# Rule -> how a page writes it.
RULE_WORDS = {
    "plain": "positions and velocities",
    "told": "positions, and the stated bound of velocities",
    "positions": "positions only",
}
MARKS = {"told": " *", "positions": " **"}
MAX_WORST, MAX_HEAD = 10, 8


def build_verdicts(rows: Sequence[Outcome]) -> Table:
    """Return how often each method and each peer has which verdict, verdicts that never occur left out."""
    counts = Counter((row.contender, row.verdict) for row in rows)
    used = [
        verdict
        for verdict in VERDICTS
        if verdict in ("survived", "wrong") or any(r.verdict == verdict for r in rows)
    ]
    is_own_method = {row.contender: row.is_own for row in sorted(rows, key=lambda row: not row.is_own)}
    columns = {"method": "", "code": ""} | {WORDS[verdict]: "d" for verdict in used}
    cells = (
        (name, "ours" if is_own else "other", *(str(counts[name, verdict]) for verdict in used))
        for name, is_own in is_own_method.items()
    )
    return make_table("Number of cases by verdict", columns, cells)


def build_worst(own_rows: Sequence[Outcome]) -> Table:
    """Return the largest certified errors of our methods, wrong results first."""
    worst = sort_worst(own_rows)[:MAX_WORST]
    columns = {"case": "", "value": "", "method": "", "error over tolerance": ".3g"}
    columns |= {"error of tensions [%]": ".1e", "verdict": ""}
    cells = []
    for row in worst:
        tension_error = None if row.tension_error is None else 100 * row.tension_error
        cells.append((row.group, row.case, row.contender, row.error, tension_error, _verdict(row)))
    count = sum(row.error is not None for row in own_rows)
    caption = f"The {len(worst)} largest of {count:,} certified errors"
    return make_table(caption, columns, cells, note=_explain(worst))


def build_grid(rows: Sequence[Outcome], title: str) -> Table:
    """Return a row a case, a column a method."""
    contenders = list(dict.fromkeys(row.contender for row in rows))
    by_case: dict[tuple[str, str], dict[str, Outcome]] = {}
    for row in rows:
        by_case.setdefault((row.group, row.case), {})[row.contender] = row
    columns = dict.fromkeys(("case", "value", *contenders), "")
    cells = [
        (group, case, *(_cell(case_rows.get(name)) for name in contenders))
        for (group, case), case_rows in by_case.items()
    ]
    order = list(dict.fromkeys((row.group, row.case) for row in sort_worst(rows)))
    column_of = {case: k for k, case in enumerate(by_case)}
    head = tuple(column_of[case] for case in order[:MAX_HEAD])
    wrong = len({(row.group, row.case) for row in rows if row.verdict == "wrong"})
    note = f"{len(head)} with the largest errors" + (f", {wrong} with wrong results first" if wrong else "")
    return make_table(
        f"Verdict and {title}", columns, cells, note=_explain(rows), head=head, head_note=note if head else ""
    )


def build_messages(rows: Sequence[Outcome], caption: str) -> Table:
    """Return the messages of runs."""
    columns = dict.fromkeys(("case", "value", "method", "verdict", "message"), "")
    cells = ((row.group, row.case, row.contender, _verdict(row), row.message) for row in rows)
    return make_table(caption, columns, cells)


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
    """Return the meaning of the marks that occur in cells."""
    used = [rule for rule in RULES if rule in MARKS and any(row.is_own and row.rule == rule for row in rows)]
    return " ".join(f"{MARKS[rule].strip()} Checked by {RULE_WORDS[rule]}." for rule in used)


MIN_DRAWN_ERROR = 1e-8  # errors over tolerance below are drawn here


def draw_errors(rows: Sequence[Outcome], scene: str, name: str) -> Iterator[Figure]:
    """Yield the diagram of outcomes that have an error; nothing where pictures cannot be drawn."""
    try:
        require_plot()
    except MissingExtraError:
        return
    cases = {case: k + 1 for k, case in enumerate(dict.fromkeys((row.group, row.case) for row in rows))}
    styles = choose_styles(dict.fromkeys(row.contender for row in rows))
    series = []
    for method, style in styles.items():
        method_rows = [row for row in rows if row.contender == method]
        x = [cases[row.group, row.case] for row in method_rows]
        y = [max(row.error or 0.0, MIN_DRAWN_ERROR) for row in method_rows]
        series.append(replace(method_series(method, x, y, style), style="points"))
    diagram = Diagram(
        "number of the case",
        "error / tolerance",
        series,
        log_y=True,
        horizontal=((ALLOWED, "wrong above"),),
        legend_columns=5,
    )
    caption = (
        f"{scene}: certified errors of {len(rows)} results in {len(cases)} cases; below the dotted line a "
        f"result is right. Errors below {MIN_DRAWN_ERROR:g} are drawn there."
    )
    yield diagram_figure(name, diagram, caption, f"Error over tolerance of {len(rows)} results, logarithmic.")


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
            *(f"{WORDS[verdict]}: {meaning}." for verdict, meaning in VERDICTS.items()),
            *(f"Checked by {RULE_WORDS[rule]}: {meaning}." for rule, meaning in RULES.items()),
        ),
        summary_heads=("part", "what", "result"),
    )


def _chapter(name: str, rows: tuple[Outcome, ...], anchor: str, t_end: float, *, is_alone: bool) -> Chapter:
    own_rows = tuple(row for row in rows if row.is_own)
    peers = tuple(row for row in rows if not row.is_own)
    sections = [
        *_wrong(own_rows, f"{anchor}-wrong"),
        *_errors(own_rows, name, f"{anchor}-errors"),
        _verdicts(rows, f"{anchor}-who"),
        *_list_not_run(rows, f"{anchor}-not-run"),
        _grid(own_rows, f"{anchor}-own", "Every case with our methods", "error over tolerance"),
    ]
    if peers:
        sections.append(_grid(peers, f"{anchor}-peers", "Every case with other programs", "error [m]"))
    sections.append(_messages(own_rows, f"{anchor}-reasons"))
    cases = f"{len({(r.group, r.case) for r in rows})} cases of {t_end:g} s"
    title = cases if is_alone else describe_finding({name: rows})
    return Chapter(anchor, name, title, "" if is_alone else f"{cases}.", tuple(sections))


def _wrong(own_rows: Sequence[Outcome], anchor: str) -> Iterator[Section]:
    """Yield a section of wrong results of our methods, none if there are none."""
    wrong = [row for row in own_rows if row.verdict == "wrong"]
    if wrong:
        remark = Remark("wrong", "These results have status ok, and must not be used.")
        table = build_messages(wrong, "Wrong results of our methods")
        yield Section(anchor, "", "Wrong results", "wrong", describe_finding({"": own_rows}), (remark, table))


def _list_not_run(rows: Sequence[Outcome], anchor: str) -> Iterator[Section]:
    """Yield a section of the cases that were not run, none if all were."""
    cases = dict.fromkeys((row.group, row.case, row.message) for row in rows if row.verdict == NOT_RUN)
    if cases:
        table = make_table("Cases without a result", {"case": "", "value": "", "reason": ""}, cases)
        result = f"{len(cases)} cases; the same command runs them, if it may replace this page"
        yield Section(anchor, "", "Not run", "plain", result, (table,))


def _verdicts(rows: Sequence[Outcome], anchor: str) -> Section:
    methods = len({row.contender for row in rows if row.is_own})
    peers = len({row.contender for row in rows if not row.is_own})
    result = f"{methods} methods of ours" + (f", {peers} of other programs" if peers else "")
    return Section(anchor, "", "Verdicts by method", "plain", result, (build_verdicts(rows),))


def _errors(own_rows: Sequence[Outcome], name: str, anchor: str) -> Iterator[Section]:
    """Yield the diagram and the table of the largest errors, nothing where none is certified."""
    measured = [row for row in own_rows if row.error is not None]
    if measured:
        worst = max(measured, key=lambda row: row.error or 0.0)
        result = (
            f"largest: {worst.error:.3g} times the tolerance, {worst.contender}, {worst.group}: {worst.case}"
        )
        blocks: tuple[Block, ...] = (*draw_errors(measured, name, f"{anchor}-figure"), build_worst(own_rows))
        yield Section(anchor, "", "Errors over tolerance", "plain", result, blocks)


def _grid(rows: Sequence[Outcome], anchor: str, title: str, grid_title: str) -> Section:
    counts = {verdict: sum(row.verdict == verdict for row in rows) for verdict in VERDICTS}
    result = ", ".join(f"{count} {WORDS[verdict]}" for verdict, count in counts.items() if count)
    is_own = all(row.is_own for row in rows)
    verdict: Verdict = "wrong" if is_own and counts["wrong"] else "plain"
    return Section(anchor, "", title, verdict, result, (build_grid(rows, grid_title),))


def _messages(own_rows: Sequence[Outcome], anchor: str) -> Section:
    stopped = [row for row in own_rows if row.verdict in ("stopped", "over time", "unchecked")]
    table = build_messages(stopped, "Runs of our methods without a checked result")
    blocks: tuple[Block, ...] = (table,) if stopped else ()
    return Section(
        anchor, "", "Messages of runs without a checked result", "plain", f"{len(stopped)} runs", blocks
    )
