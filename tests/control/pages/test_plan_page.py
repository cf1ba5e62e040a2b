"""The page of a plan: what stands on it, and what a browser shows of it."""

import re
from functools import cache
from pathlib import Path

import pytest

from tensegrity_codegen.control.pages.plan_page import build_plan_page
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.report.pages.page import Figure, Page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.report.pages.render_page import render_page
from tests.control.planning.structures import CLASSES, actuate, assemble, build_prism, compile_plan, limit
from tests.report.page_checks import check_in_browser, in_browser
from tests.report.page_html import check_static

pytest.importorskip("matplotlib")


COMMAND = "tensegrity-codegen plan prism.toml --to '<twist>=165'"
TITLES = {
    "found": r"Reached: twist 155 to 165 deg in 1 s; smallest cable tension [\d.]+ N, limit 1 N",
    "blocked": r"Blocked at [\d.]+ % of the way, twist [\d.]+ of 165 deg: limited by least tension of o.*",
    "infeasible": r"No plan exists: in the shape .* a motion shortens 9 cables, lengthens none .*",
}


NUMBERS = {"found": ["155", "165", "1"], "blocked": ["165", "1"], "infeasible": ["9"]}


@cache
def page_of(status: str) -> Page:
    structure = build_prism(155.0)
    if status == "infeasible":
        shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "twist": 160.0}
        structure = assemble({"name": "prism", "classes": CLASSES, "shape": shape})
        structure = structure.with_changes(rest_length=structure.member_length())
    actuated = limit(actuate(structure, "vertical" if status == "blocked" else ""))
    found = plan(compile_plan(actuated), "twist=165", steps=5, duration=1.0)
    assert found.status == status
    return build_plan_page(found, actuated, actuated.limits, COMMAND)


def sections(page: Page) -> dict[str, tuple]:
    return {section.anchor: section.blocks for section in page.chapters[0].sections}


PATH = ["shapes", "targets", "rest-lengths", "tensions", "clearance", "stiffness", "binding"]


@pytest.mark.parametrize("status", TITLES)
def test_the_finding_is_the_title(status: str) -> None:
    page = page_of(status)
    assert re.fullmatch(TITLES[status], page.title), page.title
    assert page.subject == "Plan of prism"
    text = render_page(page)
    check_static(text, NUMBERS[status])
    assert "&lt;twist&gt;" in text
    assert "<twist>" not in text


def test_a_plan_that_is_found_shows_its_path_with_limits() -> None:
    found = sections(page_of("found"))
    assert list(found) == ["outcome", *PATH, "command"]
    assert [type(block) for block in found["shapes"]] == [Figure] * 4
    (tension,) = found["tensions"]
    assert tension.data["horizontal"] == [[1.0, "limit: least tension 1 N"]]
    (clearance,) = found["clearance"]
    assert clearance.data["horizontal"] == [[2.0, "limit: clearance 2 mm"]]
    assert clearance.data["series"][0]["y"][-1] > 19.0
    table = next(block for block in found["rest-lengths"] if isinstance(block, Table))
    assert len(table.rows) == 12


def test_a_blocked_plan_shows_what_binds() -> None:
    tables = [block for block in sections(page_of("blocked"))["binding"] if isinstance(block, Table)]
    assert [row[1].value for row in tables[-1].rows] == ["opposite1", "opposite2", "opposite3"]
    (tension,) = sections(page_of("blocked"))["tensions"]
    assert "opposite1" in [series["name"] for series in tension.data["series"]]


def test_an_infeasible_plan_shows_the_proof() -> None:
    found = sections(page_of("infeasible"))
    assert list(found) == ["outcome", "proof", "command"]
    _, figure, table = found["proof"]
    assert len(figure.data["displacement"]) == 6
    assert sorted(row[1].value for row in table.rows)[:9] == pytest.approx([-1.0] * 9)


@in_browser
@pytest.mark.parametrize("status", TITLES)
def test_in_a_browser(tmp_path: Path, status: str) -> None:
    path = tmp_path / "page.html"
    path.write_text(render_page(page_of(status)), encoding="utf-8")
    check_in_browser(path, NUMBERS[status])
