"""The page of a benchmark run: the finding in numbers, good or bad, and what a browser shows."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from harness.acceptance import Floor
from harness.page import style_candidates, table_of
from harness.report import Report, write_report
from harness.session import Row
from harness.tables import compare_rows, comparison_cells, describe_finding

from tensegrity_codegen.report.pages.diagram import find_style
from tests.report.page_checks import check_in_browser, in_browser
from tests.report.page_html import check_static

SIZES = {"prism": 12, "tower10": 93, "tower100": 903, "tower1000": 9003}
OURS = (
    "unrolled (gcc native)",
    "unrolled, batch of 8 (gcc native)",
    "lanes (clang native)",
    "table (gcc native)",
)
SAME = "CasADi C, our expression (gcc)"
PEERS = (
    "CasADi C, unrolled (gcc)",
    SAME,
    "CasADi VM",
    "numba",
    "MuJoCo, mj_forward",
)


def make_rows(own: float = 1.0, quantities: tuple[str, ...] = ("node_force", "elastic_energy")) -> list[Row]:
    """Return rows in which the k-th of our functions takes own + k, the k-th peer 4 + k times a unit."""
    rows = []
    for structure, members in SIZES.items():
        for quantity in quantities:
            common = {"structure": structure, "members": members, "quantity": quantity, "called": "C"}
            for k, name in enumerate(OURS):
                time = 10.0 if "batch" in name else own + k
                made = {"code_bytes": 100 * members, "compile_seconds": 0.1 * (k + 1), "error": 0.0}
                rows.append(Row(**common, name=name, side="ours", ns=members * time, **made))  # type: ignore[arg-type]
            for k, name in enumerate(PEERS):
                rows.append(Row(**common, name=name, side="peer", ns=members * (4.0 + k)))  # type: ignore[arg-type]
            rows.append(Row(**common, name="JAX, jit", side="peer", note="not installed: jax"))  # type: ignore[arg-type]
    many = {"structure": "prism x 1000", "members": 12, "quantity": "node_force"}
    rows.append(Row(**many, name="C, lanes (gcc native)", side="ours", ns=10.0))  # type: ignore[arg-type]
    rows.append(Row(**many, name="numba, loop over states", side="peer", ns=140.0))  # type: ignore[arg-type]
    return rows


MACHINE = {"run": "Measured at a commit", "compilers": "gcc 12; clang 14", "pinned": "one core"}
FLOOR = Floor({1: {"fma": 0.1, "sqrt": 2.0, "div": 1.0}, 8: {"fma": 0.02, "sqrt": 0.3, "div": 0.2}})

LARGE = {
    56: {
        "members": 1002,
        "seconds": 0.8,
        "peak": None,
        "code_bytes": 47731,
        "table_bytes": 9000,
        "quantities": ["node_force"],
    },
    5556: {"error": "not ready within 240 s"},
}


def test_the_finding_counts_comparisons_and_their_ratios() -> None:
    rows = make_rows()
    assert len(compare_rows(rows)) == 9
    assert describe_finding(rows) == (
        "Fastest in 9 of 9 comparisons, 4.0 times as fast as the fastest other at the median, "
        "4.0 at worst (prism, node_force: CasADi C, unrolled (gcc))"
    )
    assert describe_finding(make_rows(own=8.0)) == (
        "Fastest in 1 of 9 comparisons, 0.50 times as fast as the fastest other at the median, "
        "0.50 at worst (prism, node_force: CasADi C, unrolled (gcc))"
    )
    alone = [row for row in rows if row.side == "ours"]
    assert describe_finding(alone) == "33 functions timed, 0 comparisons with other ways"
    assert describe_finding([]) == "0 functions timed, 0 comparisons with other ways"


def test_rows_in_which_another_way_is_faster_count_and_are_listed() -> None:
    rows = [*make_rows(), Row("prism", 12, "elastic_energy", SAME, "peer", ns=6.0)]
    assert "Fastest in 8 of 9 comparisons" in describe_finding(rows)
    assert f"0.50 at worst (prism, elastic_energy: {SAME})" in describe_finding(rows)
    assert comparison_cells(rows)[2][-3:] == [SAME, "0.5", "0.50"]


def test_a_batch_is_compared_with_many_states_alone() -> None:
    rows = [replace(row, ns=0.001) if "batch" in row.name else row for row in make_rows()]
    assert {item.own.name for item in compare_rows(rows)} == {
        "unrolled (gcc native)",
        "C, lanes (gcc native)",
    }
    assert SAME not in {item.peer.name for item in compare_rows(rows)}
    cells = comparison_cells(rows)
    assert cells[1][-1] == "4.0"
    assert cells[-1][-1] == "14"


def test_cells_become_columns_with_units() -> None:
    table = table_of("Caption", [["what", "time [ns]", "empty"], ["a", "1,234", ""], ["b", "0.5", ""]])
    assert [(c.name, c.unit, c.numeric) for c in table.columns] == [("what", "", False), ("time", "ns", True)]


def test_a_way_has_the_colour_that_it_has_elsewhere() -> None:
    styles = style_candidates([*OURS, *PEERS])
    assert len(set(styles.values())) == len(styles)
    for name, style in styles.items():
        assert style.color == find_style(name).color
    assert styles["lanes (clang native)"].dash == "dashed"


def test_a_report_states_the_finding_and_no_targets(tmp_path: Path) -> None:
    scripts = {"startup.py": "<b>1 s</b>"}
    report = Report(MACHINE, make_rows(quantities=("node_force",)), [], FLOOR, LARGE, scripts)
    paths = {path.name for path in write_report(report, tmp_path)}
    assert paths >= {"bench.md", "bench.json", "bench.csv", "bench.html", "time_node_force.png"}
    assert all((tmp_path / name).stat().st_size for name in paths)
    assert "Against the fastest other way" in (tmp_path / "bench.md").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))["acceptance"] == []
    text = (tmp_path / "bench.html").read_text(encoding="utf-8")
    check_static(text, ["5 of 5", "4.0"])
    assert "&lt;b&gt;1 s" in text
    assert "asked" not in text
    assert "not installed: jax" in text
    assert "not ready within" in text
    assert ">47,731<" in text
    assert "prism, 12 members: node_force: 10 rows" in text  # one row for each reason without a time


@in_browser
@pytest.mark.parametrize("own", [1.0, 8.0], ids=["faster", "slower"])
def test_a_browser_shows_all_of_it(own: float, tmp_path: Path) -> None:
    report = Report(MACHINE, make_rows(own), [], FLOOR, LARGE, {"startup.py": "line\n" * 40})
    write_report(report, tmp_path)
    check_in_browser(tmp_path / "bench.html", ["9"])
