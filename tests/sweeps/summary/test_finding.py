"""The headline of a sweep: how many cases have a result, why others have none, the range of the first."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.report.long_table import LongTable
from tensegrity_codegen.sweeps.summary.finding import describe_finding, describe_lead, list_tables
from tensegrity_codegen.sweeps.summary.statistics import describe_count, is_difference_clear
from tensegrity_codegen.sweeps.summary.summary import summarize
from tests.sweeps.summary.sweeps import keep, make_grid, make_sample, make_sweep


def say(values: object, status: object = None, unit: str = "N", operation: str = "equilibrium") -> str:
    rows = np.asarray(values, dtype=float)
    codes = None if status is None else list(status)  # type: ignore[call-overload]
    sweep = make_sweep(
        np.arange(len(rows))[:, None] * 1.0, ["k"], [keep("t", rows, unit)], status=codes, operation=operation
    )
    return describe_finding(summarize(sweep))


def test_all_cases_with_the_range_of_the_first_result() -> None:
    assert say([3.0, 1.25, 30.0]) == "All 3 cases converged; t 1.25 to 30 N"
    assert say([2.0, 2.0], unit="1") == "All 2 cases converged; t 2 in all cases"
    assert say([1e-17, 5.0]) == "All 2 cases converged; t 0 to 5 N"
    assert say([1000.001, 1000.002]) == "All 2 cases converged; t 1000.001 to 1000.002 N"
    assert say([-4.0]) == "1 of 1 cases converged; t −4 N"


@pytest.mark.parametrize("scale", [1.0, -1.2345678e-13])
def test_numbers_stay_whole_in_80_columns(
    scale: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names fold; where numbers leave no room for names, lines are longer."""
    monkeypatch.setenv("COLUMNS", "80")
    made = make_sample(300)
    keys = tuple(f"classes.cable_of_the_upper_ring_{k}.spring_constant" for k in range(3))
    energy = keep("elastic_energy_of_all_members", scale * np.exp(made.key_values[:, 0]), "J")
    summary = summarize(replace(made, keys=keys, kept={energy.name: energy}))
    tables = [item for item in list_tables(summary) if isinstance(item, LongTable)]
    assert len(tables) == 5
    Output(as_json=False).result({}, *tables)
    out = capsys.readouterr().out
    words = out.split()
    for table in tables:
        for text in (text for row in range(table.count) for text in table.row(row)):
            assert not re.fullmatch(r"[-−+.,e\d±% ]+", text) or set(text.split()) <= set(words), text
    assert max(map(len, out.splitlines())) <= (80 if scale == 1.0 else 130)


def test_failed_and_missing_cases_are_counted_with_their_status() -> None:
    assert say([1.0, 2.0, 3.0], [1, 2, 3]) == (
        "1 of 3 cases converged, 2 did not (no equilibrium, not converged); t 1 N"
    )
    assert say([1.0, 2.0], [2, 2]) == "0 of 2 cases converged, 2 did not (no equilibrium)"
    assert say([1.0, 2.0], [1, 4]) == "1 of 2 cases converged, 1 not computed yet; t 1 N"


@pytest.mark.parametrize(
    ("operation", "text"),
    [
        ("simulate", "ran to their end, 1 did not"),
        ("evaluate", "were evaluated, 1 failed"),
        ("linearize", "were linearized, 1 failed"),
        ("other", "are ok, 1 failed"),
    ],
)
def test_each_operation_has_its_verb(operation: str, text: str) -> None:
    sweep = make_sweep(np.zeros((3, 1)), ["k"], [], status=[0, 0, 2], operation=operation)
    assert describe_count(sweep) == f"2 of 3 cases {text}"


def test_the_lead_has_ranges_of_keys_with_units() -> None:
    made = replace(make_grid(), key_units={"loads[0].force[2]": "N"})
    lead = describe_lead(summarize(made))
    assert lead.startswith("Varied: loads[0].force[2] −1 to 1 N, classes.cable.spring_constant 1 to 1,000. ")
    assert "of the variance of member_tension[max] alone" in lead
    one = make_sweep(np.full((4, 1), 2.0), ["k"], [])
    assert describe_lead(summarize(one)) == "Varied: k 2."
    many = make_sweep(np.zeros((4, 5)), list("abcde"), [])
    assert describe_lead(summarize(many)) == "Varied: a 0, b 0, c 0 and 2 more."
    assert describe_lead(summarize(make_sweep(np.zeros((1, 0)), [], []))) == ""


def test_only_differences_beyond_chance_are_clear() -> None:
    sweep = make_sample(2000)
    clear = {row.key: is_difference_clear(sweep, row) for row in summarize(sweep).failing}
    assert clear["loads[0].force[2]"]
    assert clear["classes.cable.spring_constant"]
    assert not clear["shape.height"]
    assert "Failed cases differ most in" in describe_lead(summarize(sweep))
