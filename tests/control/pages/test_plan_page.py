"""The page of a plan: what stands on it, and what a browser shows of it."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from tensegrity_codegen.control.pages.plan_page import _clearance, build_plan_page
from tensegrity_codegen.control.pages.plans import describe_plan_finding
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.report.pages.page import Figure, Page, render_page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.runtime.records.plan_result import Binding, Block, Contradiction, PlanResult
from tensegrity_codegen.structure.limits import Limits
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
LIMITS = Limits(least_tension=np.array([1.0, 1.0, -np.inf]))


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


PATH = ["rest-lengths", "tensions", "clearance", "stiffness", "binding"]


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
    assert list(found) == ["shapes", "targets", *PATH, "command"]
    assert [type(block) for block in found["shapes"]] == [Figure] * 4
    assert found["shapes"][0].caption == "Progress 100 %: twist 165 deg; dotted: the start."
    (tension,) = found["tensions"]
    assert tension.data["horizontal"] == [[1.0, "limit: least tension 1 N"]]
    (clearance,) = found["clearance"]
    assert clearance.data["horizontal"] == [[2.0, "limit: clearance 2 mm"]]
    assert clearance.data["series"][0]["y"][-1] > 19.0
    table = next(block for block in found["rest-lengths"] if isinstance(block, Table))
    assert len(table.rows) == 12


def test_the_finding_is_said_once() -> None:
    page = page_of("found")
    assert page.lead.startswith("A path of 5 steps reaches the target")
    text = render_page(page)
    assert text.count("reaches the target") == 1
    free = not sections(page)["binding"]
    assert text.lower().count("no limit binds along the path") == free


def test_a_blocked_plan_shows_what_binds() -> None:
    tables = [block for block in sections(page_of("blocked"))["binding"] if isinstance(block, Table)]
    assert [row[1].value for row in tables[-1].rows] == ["opposite1", "opposite2", "opposite3"]
    (tension,) = sections(page_of("blocked"))["tensions"]
    assert "opposite1" in [series["name"] for series in tension.data["series"]]


def test_an_infeasible_plan_shows_the_proof() -> None:
    found = sections(page_of("infeasible"))
    assert list(found) == ["targets", "proof", "command"]
    _, figure, table = found["proof"]
    assert len(figure.data["displacement"]) == 6
    assert sorted(row[1].value for row in table.rows)[:9] == pytest.approx([-1.0] * 9)


@in_browser
@pytest.mark.parametrize("status", TITLES)
def test_in_a_browser(tmp_path: Path, status: str) -> None:
    path = tmp_path / "page.html"
    path.write_text(render_page(page_of(status)), encoding="utf-8")
    check_in_browser(path, NUMBERS[status])


# The headline of a plan: what is reached, when, and what limits it, as numbers of the plan.


def make_plan(**changes: object) -> PlanResult:
    """A plan of three members, two of them cables, and one target."""
    progress = np.array([0.0, 0.5, 1.0])
    tension = np.array([[9.0, 4.0, -20.0], [8.0, 2.5, -21.0], [7.0, 3.0, -22.0]])
    plan = PlanResult(
        "found", "", progress, ("twist",), ("deg",), np.array([[155.0], [160.0], [165.0]]),
        np.array([165.0]), ("a",), np.zeros((3, 1)), np.ones((3, 1)), ("n1", "n2"), ("c1", "c2", "b1"), (),
        np.array([True, True, False]), np.zeros((3, 2, 3)), tension, np.zeros((3, 0)), np.ones(3),
        np.zeros(3), np.zeros((3, 1)), ((), (), ()), time=np.array([0.0, 1.0, 3.1416]),
    )  # fmt: skip
    return replace(plan, **changes)  # type: ignore[arg-type]


def say(plan: PlanResult, limits: Limits = LIMITS) -> str:
    return describe_plan_finding(plan, limits)


def test_a_target_that_is_reached_has_time_and_smallest_tension() -> None:
    expected = "Reached: twist 155 to 165 deg in 3.14 s; smallest cable tension 2.5 N, limit 1 N"
    assert say(make_plan()) == expected
    assert say(make_plan(time=None)) == expected.replace(" in 3.14 s", "")
    free = Limits(least_tension=np.full(3, -np.inf))
    assert say(make_plan(), free) == expected.replace(", limit 1 N", "")
    no_cables = make_plan(is_cable=np.zeros(3, dtype=bool))
    assert say(no_cables) == "Reached: twist 155 to 165 deg in 3.14 s"


def test_what_is_missed_is_stated() -> None:
    missed = make_plan(target=np.array([[155.0], [160.0], [164.98]]))
    assert say(missed).startswith("Reached within 0.02 deg: twist 155 to 165 deg")
    both = make_plan(
        target_name=("x", "y"), target_unit=("m", "deg"), goal=np.array([1.0, 10.0]),
        target=np.array([[0.0, 0.0], [0.5, 5.0], [0.99, 9.9]]),
    )  # fmt: skip
    assert say(both).startswith("Reached within 1 % of the way: x 0 to 1 m, y 0 to 10 deg")


def test_close_goals_and_many_targets_are_told_apart() -> None:
    close = make_plan(target=np.array([[165.001], [165.0005], [165.002]]), goal=np.array([165.002]))
    assert "twist 165.001 to 165.002 deg" in say(close)
    names = ("a", "b", "c")
    many = make_plan(
        target_name=names, target_unit=("m",) * 3, goal=np.ones(3),
        target=np.array([[0.0] * 3, [0.5] * 3, [1.0] * 3]),
    )  # fmt: skip
    assert say(many).startswith("Reached: 3 targets in 3.14 s")


def test_a_target_that_is_met_at_the_start_needs_no_path() -> None:
    rows = {"progress": np.zeros(1), "target": np.array([[165.0]]), "binding": ((),)}
    assert say(make_plan(**rows)) == "Reached at the start: twist 165 to 165 deg; nothing moves"


@pytest.mark.parametrize(("names", "text"), [("c1", " of c1"), ("", "")])
def test_a_blocked_path_states_where_and_by_what(names: str, text: str) -> None:
    binding = (
        Binding("clearance", names, 0.002, 0.0, "m", 3.0),
        Binding("least_tension", "c2", 1.0, 0.0, "N", 1.0),
    )
    block = Block(0.4242, np.array([160.0]), 0.0, binding, "")
    blocked = make_plan(status="blocked", block=block, target=np.array([[155.0], [158.0], [159.24]]))
    assert say(blocked) == (
        f"Blocked at 42.4 % of the way, twist 159.2 of 165 deg: limited by clearance{text}, least tension; "
        "smallest cable tension 2.5 N, limit 1 N"
    )
    assert say(replace(blocked, block=replace(block, binding=()))).startswith(
        "Blocked at 42.4 % of the way, twist 159.2 of 165 deg; smallest"
    )


def test_an_impossible_target_names_the_contradiction() -> None:
    proof = Contradiction("member_tension[c1]", "c1", "least_tension", 0.5, 1.0, "N", "")
    plan = make_plan(status="infeasible", certificate=proof, progress=np.zeros(0))
    assert (
        say(plan) == "No plan exists: member_tension[c1] needs 0.5 N of c1, the limit (least tension) is 1 N"
    )
    assert say(replace(plan, certificate=None)) == "No plan exists"


def test_long_names_of_bars_stand_below_each_other() -> None:
    structure = limit(actuate(build_prism(155.0)))
    found = plan(compile_plan(structure), "twist=156", steps=1)
    for names, columns in ((found.bar_pair_name, 2), (("boom_strut_of_the_lower_stage",) * 3, 1)):
        with mock.patch("tensegrity_codegen.control.pages.plan_page.joined_figure") as draw:
            _clearance(replace(found, bar_pair_name=names), structure.limits)
        assert draw.call_args.args[1].legend_columns == columns
