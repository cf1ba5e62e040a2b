"""Exponents, numbers as text, tables, and the lines of the acceptance table."""

import numpy as np
import pytest
from harness import ensemble
from harness.acceptance import Evidence, Floor, Line, from_throughput, judge
from harness.session import Row, Session, relative_error
from harness.tables import (
    acceptance_cells,
    csv_text,
    fit_exponent,
    gather_untimed,
    growth_cells,
    markdown_table,
    number,
    summary_sections,
)
from harness.tools import Timing


@pytest.mark.parametrize("power", [0.0, 1.0, 1.5])
def test_the_exponent_of_a_power_law_is_its_power(power: float) -> None:
    sizes = [12, 93, 903, 9003]
    assert fit_exponent(sizes, [7.0 * size**power for size in sizes]) == pytest.approx(power, abs=1e-12)


def test_two_points_have_no_exponent() -> None:
    assert fit_exponent([10, 100], [1.0, 2.0]) is None


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, ""), (0.0, "0"), (1.2345, "1.23"), (99.96, "100"), (456787, "456,787"), (1.6e-7, "2e-07")],
)
def test_numbers_are_short(value: float | None, text: str) -> None:
    assert number(value) == text


def test_a_markdown_table_leaves_empty_columns_out() -> None:
    cells = [["a", "b", "c"], ["1", "", "x|y"], ["2", "", ""]]
    assert markdown_table(cells) == "| a | c |\n|---|---|\n| 1 | x/y |\n| 2 |  |\n"


def test_csv_has_a_heading_and_a_line_a_row() -> None:
    assert csv_text([{"a": 1, "b": "x, y"}]) == 'a,b\n1,"x, y"\n'


def test_the_median_ratio_is_taken_round_by_round() -> None:
    slow, fast = Timing(np.array([40.0, 10.0, 30.0])), Timing(np.array([10.0, 5.0, 10.0]))
    assert fast.times_faster_than(slow) == 3.0
    assert slow.median == 30.0


def test_candidates_without_a_time_share_a_row_for_each_reason() -> None:
    rows = [
        Row("prism", 12, "node_force", "a", "peer", note="not installed: a"),
        Row("prism", 12, "node_force", "b", "ours", ns=1.0),
        Row("prism", 12, "node_force", "c", "peer", note="not installed: a"),
    ]
    assert [row.name for row in gather_untimed(rows)] == ["b", "a, c"]


def test_growth_is_fitted_over_the_towers_alone() -> None:
    rows = [Row(f"tower{k}", k, "node_force", "x", "ours", ns=3.0 * k) for k in (10, 100, 1000)]
    rows.append(Row("prism", 12, "node_force", "x", "ours", ns=1e9))
    assert growth_cells(rows)[1:] == [["node_force", "x", "10 to 1,000", "1.00", "", ""]]


def test_errors_leave_out_what_a_peer_does_not_compute() -> None:
    reference = np.array([1.0, -4.0])
    assert relative_error(np.array([1.5, np.nan]), reference) == 0.125
    assert relative_error(np.array([1.0]), reference) == np.inf


def test_the_floor_of_a_member_is_no_lower_than_its_throughputs() -> None:
    row = {"fma": 0.02, "sqrt": 1.0, "div": 0.6, "rsqrt_newton": 0.2}
    assert from_throughput(row) == pytest.approx({"sqrt_div": 1.6, "rsqrt": 0.48})


def test_a_summary_has_a_row_a_candidate_and_a_column_a_structure() -> None:
    rows = [
        Row("prism", 12, "node_force", "a", "ours", ns=24.0),
        Row("tower100", 903, "node_force", "b", "peer", ns=9030.0),
        Row("prism x 100", 12, "node_force", "a", "ours", ns=50.0),
    ]
    sections = dict(summary_sections(rows))
    assert sections["node_force: ns a member, by number of members"] == [
        ["candidate", "prism 12", "tower 903"],
        ["a", "2", ""],
        ["b", "", "10"],
    ]
    assert sections["States a second and core"] == [["candidate", "node_force"], ["a", "20,000,000"]]


def evidence(ns: float, base: float) -> Evidence:
    """Return what a run of the prism alone leaves, ours at `ns` and CasADi's C at `base` [ns]."""
    names = {"table (gcc native)": ns, "CasADi C, unrolled (gcc)": base}
    rows = [
        Row("prism", 12, "node_force", name, "ours" if "native" in name else "peer", ns=value)
        for name, value in names.items()
    ]
    timings = {("prism", "node_force"): {name: Timing(np.full(3, value)) for name, value in names.items()}}
    session = Session(rows=rows, timings=timings)
    return Evidence(session, Floor({8: {"member_rsqrt": 0.5, "cached_rsqrt": 0.6}}), {})


@pytest.mark.parametrize(("ns", "holds"), [(30.0, True), (40.0, False)])
def test_a_line_holds_where_the_ratio_is_reached(ns: float, holds: bool) -> None:
    line = next(
        line for line in judge(evidence(ns, 100.0)) if line.asked.startswith("prism, 12 members, node")
    )
    assert line == Line(
        "prism, 12 members, node_force: 3 times CasADi C, unrolled (gcc)",
        f"{100 / ns:.1f} table (gcc native)",
        holds,
    )


def test_what_was_not_measured_does_not_hold_nor_fail() -> None:
    lines = judge(evidence(30.0, 100.0))
    icosahedron = next(line for line in lines if line.asked.startswith("icosahedron"))
    assert icosahedron.holds is None
    assert acceptance_cells([icosahedron])[1][2] == "not measured"


def test_what_no_emitter_serves_fails() -> None:
    found = evidence(30.0, 100.0)
    batch = next(line for line in judge(found) if "batch of 8, a structure" in line.asked)
    assert batch.holds is False


@pytest.mark.parametrize(("ns", "holds"), [(6.0, True), (60.0, False)])
def test_many_states_stand_beside_every_peer(ns: float, holds: bool) -> None:
    found = evidence(30.0, 100.0)
    rows = [
        Row("prism x 9", 12, "node_force", name, "peer", ns=10.0 + k) for k, name in enumerate(ensemble.PEERS)
    ]
    found.session.rows.extend(rows)
    found.session.rows.append(Row("prism x 9", 12, "node_force", "C, lanes", "ours", ns=ns))
    line = next(line for line in judge(found) if line.asked.startswith("prism x 9, node_force"))
    assert line.holds is holds
    assert line.measured.startswith(f"{1e9 / ns:,.0f} C, lanes")
    assert all(name in line.measured for name in ensemble.PEERS)
    del found.session.rows[-2]
    line = next(line for line in judge(found) if line.asked.startswith("prism x 9, node_force"))
    assert (line.holds, line.measured) == (None, f"not measured: {ensemble.PEERS[-1]}")
