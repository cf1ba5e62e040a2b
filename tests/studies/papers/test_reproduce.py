"""The papers as a page: which chapters, what they say, what is left behind when a study fails."""

import json
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tensegrity_codegen.report.pages.page import (
    Cause,
    Chapter,
    Page,
    Remark,
    Section,
    Verdict,
    read_section,
    render_page,
    section_as_json,
)
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.studies.papers import reproduce as module
from tensegrity_codegen.studies.papers.lin.chapter import (
    error_section,
    extension_section,
    measured_section,
)
from tensegrity_codegen.studies.papers.lin.tables import compare_tables
from tensegrity_codegen.studies.papers.reproduce import (
    PAPERS,
    build_page,
    choose_papers,
    read_errata,
    reproduce,
)
from tensegrity_codegen.studies.papers.scs.chapter import equilibrium_section
from tensegrity_codegen.studies.papers.scs.figures import load_paper_tower
from tensegrity_codegen.studies.papers.scs.maps import map_section
from tensegrity_codegen.studies.papers.sk import chapter as sk
from tensegrity_codegen.studies.papers.sk import inverse_time
from tensegrity_codegen.studies.papers.sk.inverse_time import METHODS
from tensegrity_codegen.system.errors import ConvergenceError, OutputError, UnknownNameError
from tests.report.browser import find_browser, open_page
from tests.report.page_checks import check_in_browser
from tests.report.page_html import check_static

ROOT = Path(__file__).resolve().parent.parent.parent.parent
in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")


@pytest.fixture(scope="module")
def page() -> Page:
    """All papers in small sizes."""
    return build_page(tuple(PAPERS), quick=True)


def section(page: Page, anchor: str) -> Section:
    return next(s for chapter in page.chapters for s in chapter.sections if s.anchor == anchor)


def table(page: Page, anchor: str, place: int = 0) -> Table:
    return [block for block in section(page, anchor).blocks if isinstance(block, Table)][place]


def values(found: Table, column: str) -> list[object]:
    place = [item.name for item in found.columns].index(column)
    return [row[place].value for row in found.rows]


# --- choice and errors -----------------------------------------------------------------------------


def test_papers_are_chosen_by_name_in_their_own_order() -> None:
    assert choose_papers(["scs", "sk", "sk"]) == ("sk", "scs")
    assert choose_papers(["all"]) == choose_papers([]) == ("sk", "lin", "scs")


def test_an_unknown_paper_is_named_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError) as caught:
        reproduce(["sks"], tmp_path)
    assert caught.value.given == "sks"
    assert caught.value.allowed == "sk, lin, scs, all"
    assert "'sk'" in caught.value.hint
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_said_before_the_work(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    with pytest.raises(OutputError):
        reproduce(["scs"], file / "folder")


def test_a_study_that_fails_is_named_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> Section:
        raise ConvergenceError("no equilibrium was found", where="lin_prism")

    (tmp_path / "reproduce.html").write_text("the last one", encoding="utf-8")
    monkeypatch.setattr(sk, "pattern_section", fail)
    monkeypatch.setattr(sk, "inverse_section", lambda nodes: make_plain("first"))
    with pytest.raises(ConvergenceError, match="no equilibrium") as caught:
        reproduce(["sk"], tmp_path, quick=True, overwrite=True)
    assert caught.value.where == "study S&K Fig. 3: lin_prism"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["journal", "reproduce.html"]
    assert (tmp_path / "reproduce.html").read_text("utf-8") == "the last one"


def test_finished_sections_are_taken_from_the_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[str] = []

    def build(name: str, fails: bool) -> Section:
        built.append(name)
        if fails:
            raise ConvergenceError("no equilibrium was found")
        return make_plain(name)

    names = ("inverse", "pattern", "storage", "trajectory", "drift", "offset")
    for failing in ("storage", ""):
        for name in names:
            step = partial(build, name, name == failing)
            monkeypatch.setattr(sk, f"{name}_section", lambda *_, step=step: step())
        with suppress(ConvergenceError):
            reproduce(["sk"], tmp_path, quick=True)
    assert built == ["inverse", "pattern", "storage", "storage", "trajectory", "drift", "offset"]
    assert (tmp_path / "reproduce.html").exists()
    reproduce(["sk"], tmp_path, overwrite=True)  # in full size nothing of it is used
    assert built[7:] == list(names)


def make_plain(anchor: str) -> Section:
    return Section(anchor, "Fig. 0", "Nothing", "new", "nothing", ())


def test_progress_grows_to_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    names = ("inverse", "storage", "trajectory", "drift", "offset", "pattern")
    for name in names:
        build: Callable[..., Section] = lambda *_, name=name: make_plain(name)  # noqa: E731
        monkeypatch.setattr(sk, f"{name}_section", build)
    seen: list[float] = []
    made = module.reproduce(["sk"], tmp_path / "new", progress=seen.append)
    assert seen == sorted(seen)
    assert seen[0] == 0.0
    assert len(seen) == 1 + len(names)
    assert seen[-1] == pytest.approx(1.0)
    assert made.html.exists()
    assert json.loads(made.data.read_text("utf-8"))["papers"][0]["name"] == "S&K"


# --- what the chapters say -------------------------------------------------------------------------


@pytest.mark.thorough
def test_every_table_and_figure_of_the_papers_has_a_section(page: Page) -> None:
    sources = {chapter.anchor: {s.source for s in chapter.sections} for chapter in page.chapters}
    assert {"Fig. 2", "Fig. 3", "Fig. 4", "Fig. 5"} <= sources["sk"]
    assert {"Table 1", "Table 2", "Table 3", "Fig. 4", "Abstract", "Sections 1, 3.2"} <= sources["lin"]
    assert {f"Fig. {number}" for number in range(4, 12)} <= sources["scs"]
    assert "(44), (45), (52), (53)" in sources["scs"]


@pytest.mark.thorough
def test_what_differs_has_a_remark_that_says_why(page: Page) -> None:
    silent = [
        s.anchor for chapter in page.chapters for s in chapter.sections if s.verdict == "differs"
        and not any(isinstance(block, Remark) and block.verdict == "differs" for block in s.blocks)
    ]  # fmt: skip
    assert silent == []


@pytest.mark.thorough
def test_motions_with_equal_steps_differ_by_rounding(page: Page) -> None:
    # S&K Fig. 5: the paper has 1e-5, with variable steps.
    found = table(page, "sk-fig-5")
    assert found.rows[0][2].value < 1e-13
    assert found.rows[0][1].value is None
    assert found.rows[1][1].value == 1e-5


@pytest.mark.thorough
def test_lin_table_2_is_off_by_what_the_parameters_explain(page: Page) -> None:
    # LIN Table 2 and MODEL: up to 1.94 mm; mean error against Table 1 2.50 %.
    cells = [cell.value for row in table(page, "lin-table-2").rows for cell in row[1:]]
    assert max(abs(value["difference"]) for value in cells) == pytest.approx(1.9385, abs=1e-3)
    assert cells[0]["paper"] == 31.3242
    assert values(table(page, "lin-table-2", 1), "mean error to Table 1")[0] == pytest.approx(2.495, abs=1e-3)


def test_the_difference_to_table_2_grows_at_three_springs() -> None:
    # LIN Table 2: ours less print, at 0 and at 10 N; three columns grow by more than a third.
    data = compare_tables()
    first, last = np.abs(data["ours_minus_paper"])[[0, -1]]
    growth = dict(zip(data["columns"], 100 * (last / first - 1), strict=True))
    assert {name for name in growth if growth[name] > 20} == {"B1B2", "B3B1", "A3B1"}
    (remark,) = [block for block in extension_section(data).blocks if isinstance(block, Remark)]
    for name, percent in (("B₃B₁", 67), ("A₃B₁", 62), ("B₁B₂", 38)):
        assert f"{name} by {percent} %" in remark.text
    assert "by −14 to 12 %" in remark.text


def test_results_state_their_largest_errors_and_causes() -> None:
    data = compare_tables()
    measured, table_2, table_3 = measured_section(data), extension_section(data), error_section(data)
    assert measured.outcome == "differs: we differ"
    assert measured.errors[0][0] == pytest.approx(3.6913, abs=1e-4)
    assert (table_2.outcome, table_3.outcome) == ("differs: data missing", "agrees")
    assert table_3.errors[0][0] == pytest.approx(10.9906, abs=1e-4)
    assert "10.99 %" in table_3.result


def test_the_height_behind_the_printed_tensions_is_stated() -> None:
    # SCS (45): T_D is 43.0058 N at Z = 1.1106553 m and 43.0117 N at 1.11066 m.
    section = equilibrium_section(load_paper_tower())
    (remark,) = [block for block in section.blocks if isinstance(block, Remark)]
    assert section.outcome == "agrees: ours corrected"
    assert "Z = 1.1106553 m" in section.result
    assert "Z = 1.11066 m, two digits less, T_D of (45) is 43.0117 N" in remark.text


def test_the_share_of_taut_configurations_is_of_all_azimuths() -> None:
    # 262 and 1042 of 360 x 89 angles, in steps of a degree, all with azimuths below 120 deg.
    result = map_section(load_paper_tower(), 1.0).result
    assert "0.82 % of all angles" in result
    assert "3.25 %" in result
    assert "from 0 to 120° at 2.5 and 9.8 %" in result


def test_the_time_to_apply_an_inverse_is_stated_beside_the_time_to_form_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def times(**last: float) -> dict[str, list[float]]:
        return {name: [0.5 * seconds, seconds] for name, seconds in last.items()}

    measured = {
        "n_nodes": [12, 24],
        "form": times(pseudo_inverse=0.4, dense=3e-3, sparse=4e-4, factored=1e-6),
        "apply": times(pseudo_inverse=8e-5, dense=8e-5, sparse=3.8e-5, factored=7.9e-5),
        "form_exponent": dict.fromkeys(METHODS, 1.0),
        "apply_exponent": dict.fromkeys(METHODS, 1.0),
        "largest_difference": 1e-14,
    }
    monkeypatch.setattr(inverse_time, "measure_inverse_times", lambda nodes: measured)
    result = inverse_time.inverse_section([12, 24]).result
    assert "400 times less to form" in result
    assert "79 µs to apply for 38 µs" in result


@pytest.mark.thorough
def test_the_largest_load_is_that_of_the_first_contact(page: Page) -> None:
    maxima = values(table(page, "lin-maximum-load"), "ours: maximum")
    assert maxima == pytest.approx([13.611547, 13.576837], abs=1e-6)


@pytest.mark.thorough
def test_every_printed_tension_is_met(page: Page) -> None:
    # SCS (44), (45), (52), (53): within 0.006 N.
    found = table(page, "scs-equilibria")
    assert len(found.rows) == 13
    assert max(abs(float(str(value))) for value in values(found, "difference")) < 0.006


@pytest.mark.thorough
def test_curves_of_the_tower_end_where_the_text_says(page: Page) -> None:
    rows = {row[0].value: row for row in table(page, "scs-fig-10").rows}
    assert rows["T_S, saddle"][1].value == pytest.approx(0.49, abs=0.006)
    assert rows["T_D, diagonal"][6].value == pytest.approx(11.29, abs=0.006)


@pytest.mark.thorough
def test_the_controls_as_printed_miss_the_plan(page: Page) -> None:
    found = table(page, "scs-tracking")
    errors = list(zip(values(found, "controls"), values(found, "angles of the bars"), strict=True))
    printed = [error for controls, error in errors if controls != "ours"]
    ours = [error for controls, error in errors if controls == "ours"]
    assert len(printed) == len(ours) == 3
    assert min(float(str(x)) for x in printed) > 100 * max(float(str(x)) for x in ours)


@pytest.mark.thorough
def test_sections_come_back_from_json_as_they_were(page: Page) -> None:
    chapters = []
    for chapter in page.chapters:
        sections = [read_section(json.loads(json.dumps(section_as_json(s)))) for s in chapter.sections]
        assert None not in sections
        chapters.append(replace(chapter, sections=tuple(s for s in sections if s is not None)))
    again = replace(page, chapters=tuple(chapters))
    assert render_page(again) == render_page(page)
    words = [json.dumps(p.as_dict(), default=lambda value: value.tolist()) for p in (page, again)]
    assert words[0] == words[1]


@pytest.mark.thorough
def test_the_page_is_data_without_holes(page: Page) -> None:
    text = json.dumps(page.as_dict(), allow_nan=False, default=lambda value: value.tolist())
    assert len(json.loads(text)["papers"]) == 3
    assert render_page(page).count("<figure") == sum(
        block.kind == "figure" for c in page.chapters for s in c.sections for block in s.blocks
    )


def test_the_errata_are_those_of_the_document() -> None:
    document = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
    headings = re.findall(r"^### ((?:S&K|LIN|SCS) \d+: .+)$", document, re.MULTILINE)
    assert [entry.name for paper in read_errata().values() for entry in paper] == headings


@pytest.mark.parametrize(
    ("verdicts", "title"),
    [
        (["agrees"] * 8 + ["differs"] * 3 + ["new"], "8 of 11 printed results agree, 3 differ"),
        (["agrees", "differs", "differs"], "1 of 3 printed results agree, 2 differ"),
        (["agrees"], "1 of 1 printed result agrees, 0 differ"),
        (["differs"], "0 of 1 printed result agrees, 1 differs"),
        (["new", "unstated"], "2 results, none of them with numbers in print"),
    ],
)
def test_the_heading_counts_what_agrees(
    verdicts: list[Verdict], title: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sections = tuple(Section(f"s{k}", "Fig. 1", "T", kind, "r", ()) for k, kind in enumerate(verdicts))
    chapter = Chapter("sk", "S&K", "a paper", "Somewhere.", sections)
    monkeypatch.setitem(PAPERS, "sk", replace(PAPERS["sk"], build=lambda *_: chapter))
    page = build_page(("sk",))
    assert page.title == title
    numbers = [word for word in title.replace(",", "").split() if word.isdigit()]
    check_static(render_page(page), numbers)


def test_the_heading_counts_causes_and_names_the_largest_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[tuple[Verdict, Cause, float]] = [
        ("agrees", "", 0.5), ("agrees", "ours_corrected", 1.25), ("differs", "paper_wrong", 3.691),
        ("differs", "data_missing", 1.9), ("differs", "data_missing", 0.2), ("differs", "we_differ", 0.1),
    ]  # fmt: skip
    sections = tuple(
        Section(f"s{k}", f"Fig. {k}", "T", verdict, "r", (), cause, ((error, "mm"),))
        for k, (verdict, cause, error) in enumerate(found)
    )
    chapter = Chapter("sk", "S&K", "a paper", "Somewhere.", sections)
    monkeypatch.setitem(PAPERS, "sk", replace(PAPERS["sk"], build=lambda *_: chapter))
    page = build_page(("sk",))
    assert page.title == (
        "2 of 6 printed results agree (ours corrected 1), 4 differ (paper wrong 1, data missing 2, "
        "we differ 1); largest errors 3.69 mm"
    )
    assert "3.69 mm (Fig. 2)" in page.lead
    assert "differs: paper wrong" in render_page(page)


@pytest.mark.thorough
def test_the_page_of_all_papers_has_the_standard(page: Page) -> None:
    verdicts = [section.verdict for chapter in page.chapters for section in chapter.sections]
    check_static(render_page(page), [str(verdicts.count("agrees")), str(verdicts.count("differs"))])


@pytest.mark.thorough
@in_browser
def test_a_browser_shows_every_picture_of_all_papers(page: Page, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text(render_page(page), encoding="utf-8")
    found = open_page(file, 400)
    assert found["drawings_shown"] + found["images_shown"] == found["figures"] > 25
    assert found["tables_shown"] == found["tables"] > 20
    check_in_browser(file, [])
