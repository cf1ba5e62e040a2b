"""The page of an analysis: what stands on it, and what a browser shows of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.report.analysis_page import build_analysis_page
from tensegrity_codegen.report.pages.page import Figure, Page, Table
from tensegrity_codegen.report.pages.render_page import render_page
from tensegrity_codegen.runtime.analysis.analyse import analyse
from tests.reference import ReferenceModel
from tests.report.browser import find_browser, open_page
from tests.runtime.build import bar, cable, make_structure, prism

pytest.importorskip("matplotlib")
in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")


def page_of(structure) -> Page:
    found = analyse(ReferenceModel(structure), n_modes=8)
    return build_analysis_page(found, structure, structure.member_name)


@pytest.fixture(scope="module")
def stable() -> Page:
    return page_of(prism())


@pytest.fixture(scope="module")
def infeasible() -> Page:
    return page_of(prism(160.0))


def sections(page: Page) -> dict[str, tuple]:
    return {section.anchor: section.blocks for section in page.chapters[0].sections}


def test_a_stable_structure_has_mechanisms_and_modes(stable: Page) -> None:
    found = sections(stable)
    assert list(found) == ["verdict", "singular-values", "prestress", "mechanisms", "modes", "members"]
    assert len(found["mechanisms"]) == 1
    assert len(found["modes"]) == 6
    assert stable.chapters[0].title == "stable"
    (picture,) = found["prestress"]
    assert isinstance(picture, Figure)
    assert max(np.abs(picture.data["tension"])) == pytest.approx(1.0)


def test_a_proof_has_displacements_and_changes_of_length(infeasible: Page) -> None:
    tables = [block for block in sections(infeasible)["proof"] if isinstance(block, Table)]
    assert [len(table.rows) for table in tables] == [6, 12]
    change = [row[1].value for row in tables[1].rows]
    assert sorted(change)[:9] == pytest.approx([-1.0] * 9)


def test_planar_structures_with_nothing_to_move() -> None:
    triangle = make_structure(
        [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
        [bar(0, 1, 1.0), bar(1, 2, 2**0.5), cable(2, 0, 0.9)],
        axes="xz",
        anchored={0: "xz", 1: "z"},
        load={2: (0.0, 0.0, 5.0)},
    )
    page = page_of(triangle)
    assert "proof" in sections(page)  # without its load the cable can only be slack
    assert "<svg" in render_page(page)


@in_browser
@pytest.mark.parametrize(("name", "width", "tables"), [("stable", 400, 2), ("infeasible", 1400, 4)])
def test_in_a_browser(
    request: pytest.FixtureRequest, tmp_path: Path, name: str, width: int, tables: int
) -> None:
    path = tmp_path / "page.html"
    text = render_page(request.getfixturevalue(name))
    assert not re.search(r"(?:src|href)=\"(?!#|data:)", text)
    path.write_text(text, encoding="utf-8")
    found = open_page(path, width)
    assert found["console"] == []
    assert found["content_width"] <= width
    assert found["outside"] == found["doubled_ids"] == found["lost_links"] == []
    assert (found["drawings"] + found["images"], found["tables"]) == (9, tables)
    assert found["drawings_shown"] + found["images_shown"] == 9
    assert found["tables_shown"] == tables
