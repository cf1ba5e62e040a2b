"""The page of a plan: what stands on it, and what a browser shows of it."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from tensegrity_codegen.report.pages.page import Figure, Page, Table
from tensegrity_codegen.report.pages.render_page import render_page
from tensegrity_codegen.report.plan_page import build_plan_page
from tensegrity_codegen.runtime.planning.plan import plan
from tests.report.browser import find_browser, open_page
from tests.runtime.planning.structures import CLASSES, actuate, assemble, build_prism, compile_plan, limit

pytest.importorskip("matplotlib")
in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")


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
    return build_plan_page(found, actuated, actuated.limits)


def sections(page: Page) -> dict[str, tuple]:
    return {section.anchor: section.blocks for section in page.chapters[0].sections}


PATH = ["shapes", "targets", "rest-lengths", "tensions", "clearance", "stiffness", "binding"]


def test_a_plan_that_is_found_shows_its_path_with_limits() -> None:
    found = sections(page_of("found"))
    assert list(found) == ["outcome", *PATH]
    assert [type(block) for block in found["shapes"]] == [Figure] * 4
    (tension,) = found["tensions"]
    assert tension.data["horizontal"] == [[1.0, "least tension"]]
    (clearance,) = found["clearance"]
    assert clearance.data["horizontal"] == [[2.0, "clearance"]]
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
    assert list(found) == ["outcome", "proof"]
    _, figure, table = found["proof"]
    assert len(figure.data["displacement"]) == 6
    assert sorted(row[1].value for row in table.rows)[:9] == pytest.approx([-1.0] * 9)


@in_browser
@pytest.mark.parametrize(("status", "width"), [("found", 400), ("blocked", 1400), ("infeasible", 1400)])
def test_in_a_browser(tmp_path: Path, status: str, width: int) -> None:
    path = tmp_path / "page.html"
    text = render_page(page_of(status))
    assert not re.search(r"(?:src|href)=\"(?!#|data:)", text)
    path.write_text(text, encoding="utf-8")
    found = open_page(path, width)
    assert found["console"] == []
    assert found["content_width"] <= width
    assert found["outside"] == found["doubled_ids"] == found["lost_links"] == []
    assert found["drawings_shown"] + found["images_shown"] == found["figures"]
    assert found["tables_shown"] == found["tables"]
