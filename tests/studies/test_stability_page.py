"""The page of stiff and extreme cases: the finding in numbers, good or bad, and what a browser shows."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest

from tensegrity_codegen.report.pages.page import Figure, Page, render_page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.studies.stability import page
from tensegrity_codegen.studies.stability.judge import VERDICTS, Limits, Outcome
from tensegrity_codegen.studies.stability.page import (
    build_page,
    describe_counts,
    describe_finding,
    sort_worst,
)
from tensegrity_codegen.system.errors import MissingExtraError
from tensegrity_codegen.system.extras import require_plot
from tests.report.page_checks import check_in_browser, in_browser
from tests.report.page_html import check_static

pytest.importorskip("matplotlib")
OWN = ("auto", "rk853", "rk54", "radau", "rk4")
PEERS = ("MuJoCo RK4", "CVODES (CasADi)", "SciPy DOP853")
LONG = "estimated error 9.86e+285 times the tolerance in the velocity of node n2: loosen `rtol` and `atol`"


def make_outcomes(cases: int, methods: Sequence[str] = (*OWN, *PEERS)) -> tuple[Outcome, ...]:
    """Return outcomes with every verdict but wrong ones, errors growing with the number of the case."""
    return tuple(make_one(k, name) for k in range(cases) for name in methods)


def make_one(k: int, name: str) -> Outcome:
    is_own = name in OWN
    kinds = ("survived", "survived", "stopped", "survived", "over time", "unchecked")
    verdict = kinds[(k + len(name)) % 6] if is_own else ("survived", "not able")[k % 2]
    error = 10.0 ** (k % 9 - 9) if verdict == "survived" else None
    status = {"stopped": "tolerance_not_met", "survived": "ok"}.get(verdict, verdict)
    rule = ("plain", "told", "positions")[k % 3] if error is not None else ""
    case = f"bars 1e+{k} times as stiff as cables <b>"
    tension = None if error is None else error / 100
    return Outcome("stiffness ratio", case, name, is_own, verdict, error, status, LONG, 0.1, rule, tension)


def spoil(rows: Sequence[Outcome], *places: int) -> tuple[Outcome, ...]:
    """Return outcomes of which those at the places are wrong."""
    wrong = {"verdict": "wrong", "error": 123.4, "status": "ok", "rule": "plain"}
    return tuple(replace(row, **wrong) if k in places else row for k, row in enumerate(rows))  # type: ignore[arg-type]


def build(outcomes: dict[str, tuple[Outcome, ...]], *, draws: bool = False) -> Page:
    """Return the page, without diagrams unless they are looked at."""
    with patch.object(page, "require_plot", require_plot if draws else refuse):
        return build_page(outcomes, 0.1, Limits())


def refuse() -> None:
    raise MissingExtraError("pictures need matplotlib")


def count(rows: Sequence[Outcome], *verdicts: str) -> int:
    return sum(row.is_own and row.verdict in verdicts for row in rows)


def test_the_heading_counts_what_is_wrong() -> None:
    rows = make_outcomes(60)
    checked = count(rows, "survived")
    page = build({"prism": rows})
    assert page.title == f"0 of {checked} checked results wrong"
    check_static(render_page(page), ["0", str(checked)])
    own = [k for k, row in enumerate(rows) if row.is_own]
    bad = spoil(rows, own[3], own[4], own[7])
    checked = count(bad, "survived", "wrong")
    page = build({"prism": bad})
    names = [rows[own[k]].contender for k in (3, 4, 7)]
    assert page.title.startswith(f"3 of {checked} checked results wrong: ")
    assert all(f"{name} {names.count(name)}" in page.title for name in names)
    text = render_page(page)
    check_static(text, ["3", str(checked)])
    first = page.chapters[0].sections[0]
    assert (first.title, first.verdict) == ("Wrong results", "wrong")
    assert text.index("Wrong results of our methods") < text.index("Number of cases by verdict")


def test_wrong_results_of_other_programs_are_not_counted_as_ours() -> None:
    rows = make_outcomes(12)
    peers = [k for k, row in enumerate(rows) if not row.is_own]
    assert describe_finding({"prism": spoil(rows, *peers)}).startswith("0 of ")


def test_the_heading_counts_runs_that_were_not_made() -> None:
    own = [row for row in make_outcomes(12) if row.is_own]
    rows = [*own, *(Outcome.not_run("g", f"late {k}", "auto", True, "the time budget") for k in range(7))]
    checked = count(rows, "survived", "wrong")
    assert describe_finding({"prism": rows}) == (
        f"0 of {checked} checked results wrong; 7 of {len(rows)} runs not made"
    )


def test_nothing_checked_is_the_finding_too() -> None:
    rows = tuple(Outcome.not_run("g", f"case {k}", "auto", True, "the time budget") for k in range(7))
    page = build({"prism": rows})
    assert page.title == "0 results of 7 cases could be checked"
    assert "7 were not run" in page.lead
    text = render_page(page)
    check_static(text, ["0", "7"])
    assert "7 cases; the same command runs them" in text
    assert build({}).title == "0 results of 0 cases could be checked"


def test_the_lead_counts_every_run_once() -> None:
    rows = spoil(make_outcomes(60), 0)
    text = describe_counts({"prism": rows, "tower": rows})
    assert text.startswith("120 cases of prism, tower, run with 5 methods: 600 runs.")
    assert f"{2 * count(rows, 'survived'):,} results are right, 2 wrong" in text
    assert f"{2 * count(rows, 'over time')} took longer than the time limit" in text


def test_the_worst_cases_are_visible_and_all_are_folded() -> None:
    rows = make_outcomes(60)
    own = [k for k, row in enumerate(rows) if row.is_own]
    bad = spoil(rows, own[-1])
    page = build({"prism": bad})
    tables = {b.caption: b for s in page.chapters[0].sections for b in s.blocks if isinstance(b, Table)}
    grid = tables["Verdict and error over tolerance"]
    assert len(grid.rows) == 60
    assert grid.head_rows[0][1].value == bad[own[-1]].case
    assert "1 with wrong results first" in grid.head_text
    worst = next(table for name, table in tables.items() if "largest of" in name)
    shown = [row[3].value for row in worst.rows]
    assert shown == [row.error for row in sort_worst(r for r in bad if r.is_own)][: len(shown)]
    assert shown[0] == 123.4
    assert "All 60 rows" in render_page(page)


def test_every_verdict_has_a_word_and_every_method_its_look() -> None:
    rows = make_outcomes(30)
    given = {row.verdict for row in rows if row.is_own}
    assert given < set(VERDICTS)
    text = render_page(build({"prism": rows}))
    assert "tolerance_not_met" not in text
    assert "&lt;b&gt;" in text
    sections = build({"prism": rows}, draws=True).chapters[0].sections
    figure = next(block for section in sections for block in section.blocks if isinstance(block, Figure))
    assert {series["name"] for series in figure.data["series"]} == set(OWN)
    for color in (5, 0, 2, 1, 4):  # auto, rk853, rk54, radau, rk4
        assert f"var(--line-{color})" in figure.picture.svg


def test_without_matplotlib_the_page_has_no_diagram() -> None:
    page = build({"prism": make_outcomes(5)})
    assert not [b for s in page.chapters[0].sections for b in s.blocks if isinstance(b, Figure)]


@in_browser
@pytest.mark.parametrize("wrong", [(), (0, 1, 17)], ids=["good", "wrong results"])
def test_a_browser_shows_all_of_it(wrong: tuple[int, ...], tmp_path: Path) -> None:
    rows = spoil(make_outcomes(60), *wrong)
    page = build({"prism": rows, "tower": make_outcomes(118)}, draws=True)
    file = tmp_path / "page.html"
    file.write_text(render_page(page), encoding="utf-8")
    check_in_browser(file, [str(len(wrong))])


@in_browser
def test_a_browser_shows_a_page_without_results(tmp_path: Path) -> None:
    rows = tuple(Outcome.not_run("g", f"case {k}", "auto", True, "the time budget") for k in range(70))
    file = tmp_path / "page.html"
    file.write_text(render_page(build({"prism": rows})), encoding="utf-8")
    check_in_browser(file, ["0", "70"])
