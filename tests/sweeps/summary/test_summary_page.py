"""The page of a sweep: finding in the title, all parts, and what a browser shows of it."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.sweep import build_commands
from tensegrity_codegen.report.pages.page import Command, Figure, Page, Paragraph, render_page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.sweeps.summary.statistics import Indices
from tensegrity_codegen.sweeps.summary.summary import summarize
from tensegrity_codegen.sweeps.summary.summary_page import build_summary_page
from tests.report.page_checks import check_in_browser, in_browser
from tests.report.page_html import check_static
from tests.sweeps.summary.sweeps import keep, make_grid, make_saltelli, make_sample, make_sweep

pytest.importorskip("matplotlib")
pytest.importorskip("SALib")
COMMAND = "tensegrity-codegen sweep summary made.zarr --result '<a b_c>'"
MAKERS = {
    "grid": lambda: make_grid(failed=5),
    "sample": lambda: make_sample(600),
    "many": lambda: make_sample(20_000),
    "saltelli": lambda: make_saltelli(64),
}


@cache
def page_of(name: str) -> Page:
    return build_summary_page(summarize(MAKERS[name](), build_commands=build_commands), COMMAND)


def figures_of(page: Page, anchor: str) -> list[Figure]:
    (section,) = [item for item in page.chapters[0].sections if item.anchor == anchor]
    return [block for block in section.blocks if isinstance(block, Figure)]


def test_the_finding_is_the_title_and_every_part_is_there() -> None:
    page = page_of("grid")
    assert page.title == (
        "103 of 108 cases converged, 5 did not (no equilibrium); member_tension[max] −1 to 52.2 N"
    )
    assert page.subject == "Sweep of prism"
    names = [section.anchor for section in page.chapters[0].sections]
    assert names == ["outcome", "failures", "keys", "results", "varied", "causes", "worst", "command"]
    outcome = next(block for block in page.chapters[0].sections[0].blocks if isinstance(block, Table))
    assert [[cell.value for cell in row] for row in outcome.rows] == [
        ["converged", 103, pytest.approx(100 * 103 / 108), 0, ""],
        ["no equilibrium", 5, pytest.approx(100 * 5 / 108), 103, "nothing balances the loads"],
    ]


def test_axes_have_the_units_of_keys() -> None:
    made = replace(MAKERS["sample"](), key_units={"loads[0].force[2]": "N", "shape.height": "1"})
    text = render_page(build_summary_page(summarize(made), COMMAND))
    assert "loads[0].force[2] [N]</text>" in text
    assert "height [1]" not in text
    long = make_sweep(np.arange(3.0)[:, None], ["a" * 90], [])
    assert len(long.label_key(long.keys[0])) == 36


def test_what_results_depend_on_is_one_table_with_intervals() -> None:
    (section,) = [item for item in page_of("saltelli").chapters[0].sections if item.anchor == "causes"]
    (table,) = [block for block in section.blocks if isinstance(block, Table)]
    assert [row[1].value for row in table.rows] == ["c", "b", "a"]  # the strongest first
    indices = summarize(MAKERS["saltelli"]()).chosen[0].indices
    assert isinstance(indices, Indices)
    assert [row[4].value["value"] for row in table.rows] == pytest.approx(sorted(indices.total)[::-1])
    assert " ± " in table.rows[0][3].lines[0][1]
    sample = next(item for item in page_of("sample").chapters[0].sections if item.anchor == "causes")
    texts = [block.text for block in sample.blocks if isinstance(block, Paragraph)]
    assert texts == [
        "No Sobol' indices of elastic_energy, height: they need a grid of all keys, or the sampling saltelli."
    ]


def test_one_value_in_all_cases_has_no_diagrams() -> None:
    grid = make_grid(6, 4)
    sweep = make_sweep(
        grid.key_values,
        grid.keys,
        [keep("height", np.full(24, 0.3), "m")],
        axes=dict(grid.axes),
        method="grid",
    )
    page = build_summary_page(summarize(sweep), COMMAND)
    assert page.title == "All 24 cases converged; height 0.3 m in all cases"
    names = [section.anchor for section in page.chapters[0].sections]
    assert "keys" not in names
    assert figures_of(page, "results") == []


def test_few_failures_by_chance_are_not_blamed_on_a_key() -> None:
    values = np.random.default_rng(2).uniform(size=(400, 2))
    status = np.full(400, 1)
    status[7] = 2
    sweep = make_sweep(values, ["a", "b"], [keep("height", values[:, 0], "m")], status=status)
    page = build_summary_page(summarize(sweep), COMMAND)
    (section,) = [item for item in page.chapters[0].sections if item.anchor == "failures"]
    assert section.result.startswith("no key alone tells failed cases from good ones")
    assert figures_of(page, "failures") == []
    assert "differ" not in page.lead


def test_figures_follow_the_kind_of_cases() -> None:
    assert "mean" in figures_of(page_of("grid"), "keys")[0].data  # a heat map
    assert len(figures_of(page_of("sample"), "keys")[0].data["x"]) > 400  # a point a case
    counts = figures_of(page_of("many"), "keys")[0].data["count"]  # a two-dimensional histogram
    assert sum(map(sum, counts)) == summarize(make_sample(20_000)).chosen[0].distribution.count
    assert figures_of(page_of("saltelli"), "causes")[0].data["key"] == ["a", "b", "c"]


def test_one_axis_of_a_grid_beside_samples_is_drawn_where_it_matters_most() -> None:
    rng = np.random.default_rng(3)
    grid = np.repeat(np.linspace(-20.0, 0.0, 21), 5)
    values = np.column_stack([grid, rng.normal(500.0, 50.0, len(grid)), rng.normal(size=len(grid))])
    height = 3.0 * values[:, 0] + 0.02 * values[:, 1]
    sweep = make_sweep(
        values, ("gravity[2]", "spring", "noise"), [keep("height", height, "m")],
        axes={"gravity[2]": np.unique(grid)},
    )  # fmt: skip
    drawn = figures_of(build_summary_page(summarize(sweep), COMMAND), "keys")
    assert [figure.caption for figure in drawn] == [
        "height over gravity[2]: a point a case.",
        "height over spring: a point a case.",
    ]
    assert drawn[0].data == {"x": grid.tolist(), "y": height.tolist()}


def test_a_grid_of_one_key_is_a_curve() -> None:
    grid = make_grid(12, 1)
    sweep = make_sweep(
        grid.key_values[:, :1], grid.keys[:1], list(grid.kept.values()),
        axes=dict(grid.axes[:1]), method="grid",
    )  # fmt: skip
    page = build_summary_page(summarize(sweep, ["elastic_energy"]), COMMAND)
    assert figures_of(page, "keys")[0].data["x"] == grid.axes[0][1].tolist()


def test_commands_can_be_copied_character_by_character() -> None:
    text = re.sub("</?span[^>]*>", "", render_page(page_of("grid")))
    assert re.search(r'<pre class="command"[^>]*>tensegrity-codegen sweep case made.zarr 103 --out', text)
    assert "--result &#39;&lt;a b_c&gt;&#39;</pre>" in text
    assert not re.search(r"(?:src|href)=\"(?!#|data:)", text)
    worst = next(item for item in page_of("grid").chapters[0].sections if item.anchor == "worst")
    commands = [block for block in worst.blocks if isinstance(block, Command)]
    assert len(commands) == len(next(block for block in worst.blocks if isinstance(block, Table)).rows)


TITLES = (
    "0 of 2 cases converged, 2 did not (no equilibrium)",
    "1 of 2 cases converged, 1 did not (no equilibrium); member_tension[max] −1 N",
    "All 2 cases converged; member_tension[max] −1 to 5 N",
)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_cases_or_none_that_converged_have_a_page(count: int) -> None:
    grid = make_grid(2, 1)
    sweep = make_sweep(
        grid.key_values, grid.keys, list(grid.kept.values()), status=[1] * count + [2] * (2 - count),
        axes=dict(grid.axes), method="grid",
    )  # fmt: skip
    page = build_summary_page(summarize(sweep), COMMAND)
    assert page.title == TITLES[count]
    check_static(render_page(page), [])


@in_browser
@pytest.mark.parametrize("name", MAKERS)
def test_in_a_browser(tmp_path: Path, name: str) -> None:
    path = tmp_path / "page.html"
    path.write_text(render_page(page_of(name)), encoding="utf-8")
    check_in_browser(path, [f"{MAKERS[name]().count:,}"])


def test_options_are_words_of_the_command_line_without_defaults() -> None:
    options = {"sample_time": 0.005, "mpc": False, "only_observable": True, "t_end": 1.0, "effort": None}
    made = replace(MAKERS["sample"](), operation="control", options=options)
    (section,) = [item for item in build_summary_page(summarize(made), COMMAND).chapters[0].sections
                  if item.anchor == "varied"]  # fmt: skip
    (text,) = [block.text for block in section.blocks if isinstance(block, Paragraph)]
    assert text == "Options of control that are no defaults: --only-observable --t-end 1.0"
