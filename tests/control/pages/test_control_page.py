"""The page of a study of feedback: what stands on it, and what a browser shows of it."""

import re
from functools import cache
from pathlib import Path
from unittest import mock

import pytest

from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
from tensegrity_codegen.control.feedback.study.stated_errors import RandomGust, StatedErrors
from tensegrity_codegen.control.feedback.study.study import study_control
from tensegrity_codegen.control.pages import control_figures
from tensegrity_codegen.control.pages.control_page import STATUS, build_control_page
from tensegrity_codegen.report.pages.page import Figure, Page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.report.pages.render_page import render_page
from tensegrity_codegen.structure.outline import outline_bodies
from tests.control.feedback.pinned_prism import build_prism, move_prism
from tests.report.page_checks import check_in_browser, in_browser
from tests.report.page_html import check_static

pytest.importorskip("matplotlib")
COMMAND = "tensegrity-codegen control pinned_prism.toml --to '<twist>'"


@cache
def study_prism() -> tuple[ControlStudy, Page]:
    model = build_prism()
    errors = StatedErrors(gusts=(RandomGust("bar*_B", 3.0, 0.1, 0.1),))
    study = study_control(model, move_prism(model, duration=0.5), errors=errors, draws=2, t_end=1.0)
    assert model.structure is not None
    with mock.patch.object(control_figures, "FRAMES", 12):
        return study, build_control_page(study, model, outline_bodies(model.structure), COMMAND)


def test_the_finding_is_the_title_and_every_part_is_there() -> None:
    study, page = study_prism()
    assert "deg without feedback" in page.title
    assert "with the estimator" in page.title
    assert page.subject == "Feedback control of pinned_prism"
    (chapter,) = page.chapters
    names = [section.anchor for section in chapter.sections]
    assert names == [
        *("outcome", "motion", "errors", "commands", "tensions", "estimate"),
        *("limits", "draws", "design", "command"),
    ]
    assert chapter.title == STATUS[study.status]


def test_tables_have_the_numbers_of_the_study() -> None:
    study, page = study_prism()
    sections = {section.anchor: section for section in page.chapters[0].sections}
    loops = next(block for block in sections["outcome"].blocks if isinstance(block, Table))
    worst = [row[1].value for row in loops.rows]
    assert worst == [1000 * float(loop.end_error.max()) for loop in study.loops.values()]
    draws = next(block for block in sections["draws"].blocks if isinstance(block, Table))
    assert len(draws.rows) == 2
    assert [row[3].value for row in draws.rows] == (1000 * study.loops["estimator"].end_error).tolist()


def test_diagrams_mark_limits_and_the_film_moves() -> None:
    _, page = study_prism()
    sections = {section.anchor: section for section in page.chapters[0].sections}
    figures = [block for block in sections["commands"].blocks if isinstance(block, Figure)]
    assert figures[-1].data["horizontal"] == [[0.1, "limit 0.1 m/s"]]
    tensions = [block for block in sections["tensions"].blocks if isinstance(block, Figure)]
    assert tensions[0].data["horizontal"] == [[5.0, "limit: least tension 5 N"]]
    film = [block for block in sections["motion"].blocks if isinstance(block, Figure)][-1]
    assert film.picture.png.startswith("data:image/gif;base64,")
    assert len(film.data["time"]) > 10


def test_words_are_escaped_and_nothing_is_loaded_from_elsewhere() -> None:
    text = render_page(study_prism()[1])
    check_static(text, [])
    assert '<pre class="command"' in text
    assert "&lt;twist&gt;" in text
    assert "<twist>" not in text
    assert not re.search(r"(?:src|href)=\"(?!#|data:)", text)
    assert 'name="viewport"' in text


@in_browser
def test_in_a_browser(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(render_page(study_prism()[1]), encoding="utf-8")
    check_in_browser(path, [])
