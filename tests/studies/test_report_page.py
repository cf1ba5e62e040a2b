"""The page of error against run time: the finding in numbers, good or bad, and what a browser shows."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.report.pages.page import Command, Figure, Page, render_page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.studies.work_precision.measure import MotionProblem, Reference, Row, find_fastest
from tensegrity_codegen.studies.work_precision.report import build_page
from tensegrity_codegen.studies.work_precision.scene_report import (
    SceneReport,
    compare_scene,
    describe_finding,
    describe_rows,
)
from tests.report.page_checks import check_in_browser, in_browser
from tests.report.page_html import check_static
from tests.runtime.build import prism

pytest.importorskip("matplotlib")
OURS = {"node_position": ("rk54", "rk853", "radau", "rk4"), "node_distance": ("rk54", "rk853")}
ADAMS = "CVODES (CasADi; Adams, functional iteration)"
PEERS = ("MuJoCo RK4", "MuJoCo Euler", ADAMS, "SciPy DOP853", "SciPy Radau")
PROGRAMS = ["MuJoCo", "CVODES", "SciPy"]
BODIES = "MuJoCo (rigid bars) RK4"


def make_row(name: str, k: int, speed: float, **more: object) -> Row:
    """Return the k-th run of a method: a tenth of the error takes twice the time; every seventh stops."""
    formulation, _, method = ("", "", name) if name.split()[0] in PROGRAMS else name.rpartition(", ")
    solved = "MuJoCo, rigid bars" if name == BODIES else name
    found = Row(
        name, "own" if formulation else "peer", formulation or solved, method, "tolerance", 10.0**-k,
        10.0 ** (-k - 1), speed * 2.0**k * 1e-4, "ok", "", 10 * k, 80 * k, 1e-9, None,
    )  # fmt: skip
    if k == 7:
        found = replace(found, status="step_too_small", error=math.inf)
    return replace(found, **more)  # type: ignore[arg-type]


def make_report(name: str = "prism", speeds: Mapping[str, float] | None = None, runs: int = 8) -> SceneReport:
    """Return a report of a scene; speeds: time of each method or program over a unit."""
    if speeds is None:
        own = [f"{formulation}, {method}" for formulation, methods in OURS.items() for method in methods]
        speeds = {title: 1.0 + k for k, title in enumerate(own)} | dict.fromkeys(PEERS, 9.9)
    rows = tuple(make_row(title, k, speed) for title, speed in speeds.items() for k in range(2, 2 + runs))
    structure = prism().with_changes(name=name)
    problem = MotionProblem(structure, np.linspace(0.0, 1.0, 3), is_kicked=True)
    reference = Reference(np.zeros((3, 6, 3)), "node_position, rk853", "node_position, radau", 3e-13)
    absent = {"rigid_bar, rk54": "has no rigid bars", "IDAS (CasADi)": "not attempted above 100 members"}
    return SceneReport(problem, reference, rows, absent)


@pytest.fixture(scope="module")
def report() -> SceneReport:
    return make_report()


@pytest.fixture(scope="module")
def page(report: SceneReport) -> Page:
    return build_page([report])


@pytest.fixture(scope="module")
def text(page: Page) -> str:
    return render_page(page)


def describe(report: SceneReport) -> str:
    return describe_finding([compare_scene(report)])


def test_the_page_states_the_finding(page: Page, text: str) -> None:
    assert page.title.startswith("9.9 times faster than the fastest other program, ")
    check_static(text, ["9.9", "1e-6"])
    (block,) = [block for block in page.chapters[0].sections[0].blocks if isinstance(block, Command)]
    lines = block.text.splitlines()
    assert lines[0] == '# formulation = "node_position" under [model]'
    assert all(line.startswith("tensegrity-codegen simulate prism.toml --t-end 1 ") for line in lines[1:])


def test_the_heading_compares_with_the_fastest_other_program() -> None:
    report = make_report(speeds={"node_position, rk54": 1.0, "SciPy DOP853": 9.9, "MuJoCo RK4": 30.0})
    assert describe(report) == (
        "9.9 times faster than the fastest other program, SciPy DOP853, at an error of 1e-6 m"
    )
    slower = make_report(speeds={"node_position, rk54": 3.3, "SciPy DOP853": 1.0})
    assert describe(slower).startswith("3.3 times slower than the fastest other program, SciPy DOP853,")
    much = make_report(speeds={"node_position, rk54": 1.0, "SciPy DOP853": 1234.0})
    assert describe(much).startswith("1,234 times faster")


def test_the_heading_names_program_and_setting() -> None:
    times = {"node_position, rk54": 1.0, "CVODES (CasADi; BDF, Newton, dense LU)": 44.0, ADAMS: 9.9}
    assert describe(make_report(speeds=times)) == (
        "9.9 times faster than the fastest other program, CVODES (CasADi; Adams, functional iteration), at "
        "an error of 1e-6 m"
    )


def test_the_heading_compares_equal_equations() -> None:
    """Rigid bars of ours against springs of another program are no comparison of programs."""
    times = {"node_position, rk853": 2.0, "rigid_bar, corrected, rk853": 1.0}
    at = "at an error of 1e-6 m"
    assert describe(make_report(speeds=times | {ADAMS: 8.0})) == (
        f"4.0 times faster than the fastest other program, {ADAMS}, {at} and equal equations; "
        "8.0 times faster with rigid bars (rigid_bar, corrected)"
    )
    assert describe(make_report(speeds=times | {ADAMS: 8.0, BODIES: 3.0})) == (
        f"3.0 times faster than the fastest other program, {BODIES}, {at}"
    )
    slower = make_report(
        speeds={"node_position, rk853": 2.0, "rigid_bar, corrected, rk853": 9.0, BODIES: 3.0}
    )
    assert describe(slower) == (
        f"3.0 times slower than the fastest other program, {BODIES}, {at} and equal equations; "
        "1.5 times faster with bars as in the scene (node_position)"
    )
    rigid_alone = make_report(speeds={"rigid_bar, corrected, rk853": 1.0, ADAMS: 8.0})
    assert describe(rigid_alone).endswith(f"{at}, ours with rigid bars (rigid_bar, corrected)")
    both = [compare_scene(make_report(name, speeds=times | {ADAMS: 8.0})) for name in ("prism", "tower")]
    assert describe_finding(both).startswith("4.0 (prism) and 4.0 (tower) times faster")
    assert describe_finding(both).endswith(f"{at} and equal equations")


def test_the_table_states_both_ratios() -> None:
    times = {"node_position, rk853": 2.0, "rigid_bar, corrected, rk853": 1.0, ADAMS: 8.0}
    report = make_report(speeds=times)
    table = next(
        b for s in build_page([report]).chapters[0].sections for b in s.blocks if isinstance(b, Table)
    )
    heads = [column.name for column in table.columns]
    cells = dict(zip(heads, (cell.value for cell in table.rows[3]), strict=True))
    assert cells["error wanted"] == 1e-6
    assert cells["its time over ours"] == 8.0
    assert cells["its bars"] == "bars as in the scene"
    assert cells["ours with these"] == "node_position, rk853"
    assert cells["its time over that"] == 4.0
    found = report.as_dict()["recommendations"][3]
    assert found["row"]["contender"] == "rigid_bar, corrected, rk853"
    assert (found["peer"]["contender"], found["alike"]["contender"]) == (ADAMS, "node_position, rk853")


def test_without_a_rival_the_heading_states_our_time() -> None:
    alone = make_report(speeds={"node_position, rk54": 1.0})
    assert describe(alone) == "rk54 (node_position) reaches an error of 1e-6 m in 3.2 ms a simulated second"
    rough = replace(alone, rows=(*alone.rows, make_row("MuJoCo Euler", 2, 1.0, error=0.5)))
    assert describe(rough).endswith(", no other program reaches it")


def test_the_error_of_the_heading_is_one_that_both_reach() -> None:
    report = make_report(speeds={"node_position, rk54": 1.0})
    rows = (*report.rows, make_row("MuJoCo Euler", 2, 10.0, error=5e-5))
    found = compare_scene(replace(report, rows=rows))
    assert found.wanted == 1e-4
    assert found.peer is not None
    assert found.peer.contender == "MuJoCo Euler"
    nothing = replace(report, rows=tuple(replace(row, error=1.0) for row in report.rows))
    assert describe(nothing) == "no method reaches an error of 1e-3 m"
    assert find_fastest(report.rows, 1.0, "peer") is None


def test_scenes_are_named_or_counted() -> None:
    fast = {"node_position, rk54": 1.0, "SciPy DOP853": 9.9}
    slow = {"node_position, rk54": 2.0, "SciPy DOP853": 1.0}
    two = [compare_scene(make_report(name, speeds=fast)) for name in ("prism", "tower")]
    assert describe_finding(two) == (
        "9.9 (prism) and 9.9 (tower) times faster than the fastest other program, SciPy DOP853, at an error "
        "of 1e-6 m"
    )
    both = describe_finding([two[0], compare_scene(make_report("net", speeds=slow))])
    assert both.startswith("prism: 9.9 times faster")
    assert "; net: 2.0 times slower" in both
    many = [*two, compare_scene(make_report("net", speeds=slow))]
    text = describe_finding(many)
    assert text.startswith("9.9 times faster in 2 of 3 scenes; 2.0 times slower in 1 of 3 scenes: ")
    assert text.endswith("against the fastest other program (SciPy) at an error of 1e-6 m")
    alone = compare_scene(make_report("mast", speeds={"node_position, rk54": 1.0}))
    assert describe_finding([*many, alone]).endswith("; and 2 more scenes")


def test_the_lead_counts_runs(report: SceneReport) -> None:
    assert (
        describe_rows([report])
        == "88 runs of 6 methods of ours and 3 other programs, on 1 scene; 11 did not reach the end."
    )
    assert "no other program" in describe_rows([make_report(speeds={"node_position, rk54": 1.0})])


def test_the_runs_that_none_beats_are_visible_and_all_are_folded(
    report: SceneReport, page: Page, text: str
) -> None:
    tables = {b.caption: b for s in page.chapters[0].sections for b in s.blocks if isinstance(b, Table)}
    runs = tables["Every run"]
    assert len(runs.rows) == len(report.rows) == 88
    best = sorted(report.front, key=lambda row: row.error)
    assert [row[2].value for row in runs.head_rows] == [row.error for row in best][: len(runs.head_rows)]
    assert "All 88 rows" in text
    assert "Not measured: 2 rows" in text
    assert "step_too_small" not in text


def test_a_method_has_one_colour_in_all_diagrams(page: Page) -> None:
    figures = [b for s in page.chapters[0].sections for b in s.blocks if isinstance(b, Figure)]
    names = [[series["name"] for series in figure.data["series"]] for figure in figures]
    assert names[0] == ["ours, the fastest of all", *PROGRAMS]
    assert names[2:] == [list(OURS["node_position"]), list(OURS["node_distance"])]
    for figure in figures[2:]:
        for color in (2, 0):  # rk54, rk853
            assert f"var(--line-{color})" in figure.picture.svg


@in_browser
@pytest.mark.parametrize("count", [1, 4])
def test_a_browser_shows_all_of_it(count: int, tmp_path: Path) -> None:
    page = build_page([make_report(f"a_scene_with_a_long_name_{k}") for k in range(count)])
    file = tmp_path / "page.html"
    file.write_text(render_page(page), encoding="utf-8")
    check_in_browser(file, ["9.9"] + ["4 of 4"] * (count == 4))
