"""The page of a study of feedback: what stands on it, and what a browser shows of it."""

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.study.control_study import (
    ControlStudy,
    LoopResult,
    RunMeasures,
    find_high_tensions,
    find_long_steps,
    find_low_tensions,
)
from tensegrity_codegen.control.feedback.study.stated_errors import RandomGust, StatedErrors
from tensegrity_codegen.control.feedback.study.study import study_control
from tensegrity_codegen.control.pages import control_figures
from tensegrity_codegen.control.pages.control_page import (
    build_control_page,
    describe_control_finding,
    find_least_bound,
)
from tensegrity_codegen.report.pages.page import Figure, Page, render_page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.structure.limits import Limits
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
        *("outcome", "errors", "motion", "commands", "tensions", "estimate"),
        *("limits", "draws", "design", "command"),
    ]
    text = render_page(page)
    assert study.message not in text  # the table and the heading have these numbers
    assert not re.search(r"\d ms\b", text)
    assert "tension unknown</text>" in text  # of the rigid bars


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


# The headline of a study of feedback: errors with and without feedback, smallest tension, limits.


def measure(error: float, **changes: Any) -> RunMeasures:
    """Measures of one draw whose error at the end is given in mm."""
    made = RunMeasures("ok", error / 1000, error / 500, math.nan, "n1", 12.0, "c1", 12.5, {}, {}, {"ok": 9})
    return replace(made, **changes)


def study_of(status: str, *, moves: bool = True, angles: bool = False, **rows: Any) -> Any:
    """What the headline reads of a study: its status, motion, draws and loops."""
    run: Any = None
    loops = {name: LoopResult(name, tuple(measures), run) for name, measures in rows.items()}
    return SimpleNamespace(
        status=status, motion=SimpleNamespace(velocity=np.ones(3) * moves), drawn=(None, None),
        tuning=SimpleNamespace(scales=SimpleNamespace(is_angle=np.full(2, angles))), loops=loops,
    )  # fmt: skip


OPEN = (measure(6.4), measure(5.0))


def limit(least: float) -> Limits:
    return Limits(least_tension=np.array([least, -np.inf]))


def test_a_motion_that_is_kept() -> None:
    study = study_of("holds", open=OPEN, true_state=(measure(0.01),) * 2, estimator=(measure(0.4),) * 2)
    assert describe_control_finding(study, 2.0) == (
        "Feedback with the estimator keeps the motion within 0.4 mm at the end, 6.4 mm without feedback; "
        "smallest cable tension 12.5 N, limit 2 N"
    )
    rest = study_of("holds", moves=False, open=OPEN, true_state=(measure(0.01),) * 2)
    assert describe_control_finding(rest).startswith(
        "Feedback with the true state keeps the equilibrium within 0.01 mm at the end"
    )
    assert "limit" not in describe_control_finding(rest)


def test_draws_that_end_worse_are_counted() -> None:
    study = study_of("holds", open=OPEN, true_state=(measure(1.0), measure(5.5)))
    assert "6.4 mm without feedback, worse than that in 1 of 2 draws;" in describe_control_finding(study)


def test_angles_are_stated_in_degrees() -> None:
    rows = {
        "open": (measure(6.4, end_angle=math.radians(1.25)),),
        "true_state": (measure(0.4, end_angle=math.radians(0.0707)),),
    }
    text = describe_control_finding(study_of("holds", angles=True, **rows))
    assert "within 0.0707 deg at the end, 1.25 deg without feedback" in text


@pytest.mark.parametrize("opened", [0, 1])
def test_an_unstable_loop_is_named_with_its_draws(opened: int) -> None:
    stopped = measure(1e6, status="not_finite")
    rows = {"open": (stopped if opened else OPEN[0], OPEN[1]), "true_state": (measure(0.1),) * 2}
    study = study_of("unstable", **rows, estimator=(stopped, measure(1.0)))
    expected = "unstable without feedback" if opened else "6.4 mm without feedback"
    assert describe_control_finding(study) == (
        f"Feedback is unstable with the estimator in 1 of 2 draws; {expected}"
    )


def test_programs_that_are_not_solved_are_stated() -> None:
    study = study_of("not_solved", open=OPEN, true_state=(measure(0.1, status="not_solved"), measure(0.1)))
    assert describe_control_finding(study) == (
        "Feedback is not solved with the true state in 1 of 2 draws; 6.4 mm without feedback"
    )


def test_feedback_that_does_harm_is_stated() -> None:
    study = study_of("does_not_hold", open=OPEN, true_state=(measure(9.0), measure(2.0)))
    assert describe_control_finding(study) == (
        "Feedback does not keep the motion: 9 mm from it at the end with the true state, "
        "6.4 mm without feedback"
    )


def test_limits_that_are_exceeded_are_in_the_headline() -> None:
    broken = {"least_tension": ("c1", "c2"), "clearance": ("bar1_bar2",)}
    slack = (measure(0.4, end_tension=0.0, least_tension=0.0, broken=broken),)
    study = study_of("holds", open=OPEN[:1], true_state=slack)
    assert describe_control_finding(study, 2.0).endswith(
        "; smallest cable tension 0 N, limit 2 N; least tension not kept by c1, c2; clearance not kept by "
        "bar1_bar2"
    )
    assert find_low_tensions(study.loops, limit(2.0)) == ()  # it is among the limits that are not kept


def test_tensions_below_their_limit_on_the_way_are_stated() -> None:
    early = (measure(0.4, least_tension=0.25), measure(0.3))
    study = study_of("holds", open=OPEN, estimator=early)
    assert "12.5 N at the end, 0.25 N on the way, limit 2 N" in describe_control_finding(study, 2.0)
    (text,) = find_low_tensions(study.loops, limit(2.0))
    assert text == "estimator: c1 falls to 0.25 N on the way, below the least tension of 2 N"
    assert find_low_tensions(study.loops, limit(0.2)) == ()
    slack = study_of("holds", open=OPEN, estimator=(measure(0.4, least_tension=0.0),))
    (text,) = find_low_tensions(slack.loops, Limits())
    assert text == "estimator: c1 goes slack on the way"


def test_structures_without_cables_have_no_tension() -> None:
    bare = {"least_tension": math.nan, "end_tension": math.nan, "least_member": ""}
    study = study_of("holds", open=OPEN[:1], true_state=(measure(0.4, **bare),))
    assert describe_control_finding(study).endswith("6.4 mm without feedback")
    assert find_low_tensions(study.loops, limit(2.0)) == ()


def test_the_largest_of_the_least_tensions_is_the_limit() -> None:
    assert find_least_bound(np.array([-np.inf, 1.0, 3.0])) == 3.0
    assert find_least_bound(np.array([-np.inf])) == -math.inf
    assert find_least_bound(np.zeros(0)) == -math.inf


def test_a_step_that_takes_longer_than_half_a_sample_is_stated() -> None:
    loops: Any = {
        name: SimpleNamespace(run=SimpleNamespace(sample_cost=cost))
        for name, cost in (("open", 0.001), ("true_state", 0.021), ("estimator", 0.02))
    }
    (text,) = find_long_steps(loops, 0.005, is_mpc=True)
    assert "about 20 ms on this machine, and a sample is 5 ms: it cannot run in time" in text
    assert find_long_steps(loops, 0.05, is_mpc=True) == ()
    loops["open"].run.sample_cost = math.nan
    assert find_long_steps(loops, 0.005, is_mpc=True) == ()


def test_tensions_above_their_limit_on_the_way_are_stated() -> None:
    run = SimpleNamespace(
        member_name=("c1", "c2"),
        time=np.array([0.0, 0.1]),
        member_tension=np.array([[450.0, 9.0], [20.0, 9.0]]),
    )
    loops: Any = {name: SimpleNamespace(run=run, broken={}) for name in ("open", "true_state")}
    limits = Limits(most_tension=np.array([400.0, np.inf]))
    (text,) = find_high_tensions(loops, limits)
    assert text == "true state: c1 has 450 N at 0 s, above the largest tension of 400 N"
    assert find_high_tensions(loops, Limits(most_tension=np.array([500.0, np.inf]))) == ()
    assert find_high_tensions(loops, Limits()) == ()


def test_an_error_of_the_start_as_large_as_the_structure_is_doubted() -> None:
    study, page = study_prism()
    wrong = replace(study, errors=StatedErrors(start_error=3.0))
    assert "is it 3mm?" in " ".join(wrong.warnings)
    assert "is it" not in " ".join(study.warnings)
    design = next(section for section in page.chapters[0].sections if section.anchor == "design")
    assert "stiffnesses that are more than 10 % off" in design.blocks[1].note  # type: ignore[union-attr]


def test_the_largest_tension_has_the_line_of_its_limit() -> None:
    study, _ = study_prism()
    model = build_prism()
    assert model.structure is not None
    most = np.full(model.structure.n_members, 70.0)
    limited = model.structure.with_changes(limits=replace(model.structure.limits, most_tension=most))
    with mock.patch.object(model, "structure", limited):
        (section,) = control_figures.build_tensions(study, model)
    assert section.blocks[1].data["horizontal"] == [[70.0, "limit: largest tension 70 N"]]  # type: ignore[union-attr]
