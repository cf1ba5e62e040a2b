"""What a user states: ranges, lists, distributions, tables; and what is wrong with them."""

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.sweeps.cases.build_cases import MOST_CASES, build_cases
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    TensegrityError,
)


def test_ranges_and_lists_make_a_grid() -> None:
    cases = build_cases(["a=0:1:5", "b=1:1000:4:log", "c=3,-1.5,2e1"])
    a, b, c = (axis.values for axis in cases.axes)
    assert a.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert np.allclose(b, [1, 10, 100, 1000], rtol=1e-15)
    assert (b[0], b[-1], c.tolist()) == (1.0, 1000.0, [3.0, -1.5, 20.0])
    assert (cases.shape, cases.count, cases.method, cases.seed) == ((5, 4, 3), 60, "grid", None)


def test_python_states_them_as_a_mapping_too() -> None:
    text = build_cases(["a=0:1:5", "b=1,2"], ["c=normal(0,1)"], n=4, seed=3)
    same = build_cases(
        {"a": np.linspace(0, 1, 5), "b": (1, 2)}, {"c": ("normal", 0, 1)}, n=4, seed=3, method="random"
    )
    assert text.describe() == same.describe()
    assert np.array_equal(text.values(), same.values())


def test_a_range_may_go_down_or_have_one_value() -> None:
    assert build_cases(["a=1:0:3"]).values().tolist() == [[1.0], [0.5], [0.0]]
    assert build_cases(["a=2:2:1"]).values().tolist() == [[2.0]]
    assert build_cases({"a": 5.0}).values().tolist() == [[5.0]]


@pytest.mark.parametrize(
    ("over", "error", "words"),
    [
        ("a", InvalidValueError, "KEY="),
        ("a=", InvalidValueError, "KEY="),
        ("=1:2:3", InvalidValueError, "KEY="),
        ("a=1:2", InvalidValueError, "not a range"),
        ("a=1:2:3:4:5", InvalidValueError, "not a range"),
        ("a=1:2:3:lin", InvalidValueError, "log"),
        ("a=1:1:3", InvalidValueError, "empty range"),
        ("a=1:2:0", InvalidValueError, "whole number from 1"),
        ("a=1:2:-3", InvalidValueError, "whole number from 1"),
        ("a=1:2:2.5", InvalidValueError, "whole number from 1"),
        ("a=1:2:1e12", InvalidValueError, "too many values"),
        ("a=-1:2:3:log", InvalidValueError, "not positive"),
        ("a=0:2:3:log", InvalidValueError, "not positive"),
        ("a=nan:2:3", NonFiniteError, "start is not finite"),
        ("a=1:inf:3", NonFiniteError, "stop is not finite"),
        ("a=1,nan", NonFiniteError, "value is not finite"),
        ("a=1,,2", InvalidValueError, "a value is missing"),
        ("a=1,x", InvalidValueError, "not a number"),
        ("a=1_0,2", InvalidValueError, "not a number"),
        ("a=1,2,1", InvalidValueError, "1.0 appears twice"),
    ],
)
def test_a_wrong_range_is_a_named_error(over: str, error: type[TensegrityError], words: str) -> None:
    with pytest.raises(error) as caught:
        build_cases([over], options={"over": "--over"})
    assert words in str(caught.value)
    assert str(caught.value).startswith("--over")


@pytest.mark.parametrize(
    ("stated", "error", "words"),
    [
        ({}, InvalidValueError, "nothing varies"),
        ({"over": ["a=1,2", "a=3,4"]}, DuplicateNameError, "varies twice"),
        ({"over": ["a=1,2"], "sample": ["a=normal(0,1)"], "n": 3}, DuplicateNameError, "varies twice"),
        ({"sample": ["a=normal(0,1)", "a=normal(0,2)"], "n": 3}, DuplicateNameError, "varies twice"),
        ({"sample": ["a=normal(0,1)"]}, InvalidValueError, "number of samples is missing"),
        ({"sample": ["a=normal(0,1)"], "n": 0}, InvalidValueError, "number of samples"),
        ({"over": ["a=1,2"], "n": 5}, InvalidValueError, "without distributions"),
        ({"sample": ["a=normal(0,1)"], "n": 3, "table": {"b": [1]}}, InvalidValueError, "together"),
        ({"over": {"a": []}}, InvalidValueError, "no values"),
        ({"over": {"a": [1.0, None]}}, InvalidValueError, "not a number"),
        ({"over": {"a": [True]}}, InvalidValueError, "not a number"),
        ({"table": {"a": [1.0, 2.0], "b": [1.0]}}, InvalidValueError, "table"),
        ({"table": {"a": [1.0, np.nan]}}, InvalidValueError, "row 1, column a"),
        ({"table": {"a": ["x"]}}, InvalidValueError, "table"),
        ({"table": {"a": []}}, InvalidValueError, "table"),
        ({"table": 3}, InvalidValueError, "not a table"),
    ],
)
def test_wrong_combinations_are_named_errors(
    stated: dict[str, Any], error: type[TensegrityError], words: str
) -> None:
    with pytest.raises(error) as caught:
        build_cases(**stated)
    assert words in str(caught.value)


def test_many_cases_need_an_express_yes() -> None:
    with pytest.raises(InvalidValueError, match=r"1,000,000 \(1,000 x 1,000\)"):
        build_cases(["a=0:1:1000", "b=0:1:1000"])
    assert build_cases(["a=0:1:1000", "b=0:1:1000"], yes=True).count == 10**6
    assert build_cases({}, ["a=normal(0,1)"], n=MOST_CASES).count == MOST_CASES


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_table_has_a_case_in_every_row(tmp_path: Path, separator: str) -> None:
    file = tmp_path / "cases.csv"
    rows = (("shape.height", "loads[0].force[2]"), ("0.3", " -3"), ("", ""), ("1e-1", "+4.5"))
    file.write_text("\n".join(separator.join(row) for row in rows) + "\n", encoding="utf-8")
    cases = build_cases(table=file)
    assert cases.keys == ("shape.height", "loads[0].force[2]")
    assert cases.values().tolist() == [[0.3, -3.0], [0.1, 4.5]]
    assert (
        cases.describe()
        == build_cases(table={cases.keys[0]: [0.3, 0.1], cases.keys[1]: [-3, 4.5]}).describe()
    )
    both = build_cases(["g=1,2"], table=file)
    assert both.values()[:, 0].tolist() == [1, 1, 2, 2]
    assert both.values()[2:, 1:].tolist() == cases.values().tolist()


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("", SceneSyntaxError, "empty"),
        ("a,b\n", StructureError, "no cases"),
        ("a,a\n1,2\n", DuplicateNameError, "line 1"),
        ("a,,b\n1,2,3\n", InvalidValueError, "line 1"),
        ("a,b\n1,2\n3\n", SceneSyntaxError, "line 3"),
        ("a,b\n1,2\n3,4,5\n", SceneSyntaxError, "line 3"),
        ("a,b\n1,2\n\n3,x\n", InvalidValueError, "line 4, column b"),
        ("a,b\n1,\n", InvalidValueError, "line 2, column b"),
        ("a,b\n1,nan\n", NonFiniteError, "line 2, column b"),
        ("a,b\n1,1e999\n", NonFiniteError, "line 2, column b"),
        ("a,b\n1,1_000\n", InvalidValueError, "line 2, column b"),
        ('a;b\n1;"2,5"\n', InvalidValueError, "line 2, column b"),
    ],
)
def test_a_wrong_table_is_an_error_that_names_line_and_column(
    tmp_path: Path, text: str, error: type[TensegrityError], words: str
) -> None:
    file = tmp_path / "cases.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(error) as caught:
        build_cases(table=file)
    assert words in str(caught.value)
    assert "cases.csv" in str(caught.value)


def test_a_table_that_is_not_there_is_a_named_error(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="cannot be read"):
        build_cases(table=tmp_path / "none.csv")
    with pytest.raises(SceneError, match="folder"):
        build_cases(table=tmp_path)


@pytest.mark.parametrize("method", ["random", "latin_hypercube", "sobol"])
def test_a_million_cases_take_less_than_100_mb(method: str) -> None:
    laws = dict.fromkeys("abcd", "normal(0,1)")
    tracemalloc.start()
    cases = build_cases({}, laws, n=10**6, method=method, yes=True)
    for first in range(0, 10**6, 250_000):
        assert np.isfinite(cases.values(first, first + 4096)).all()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6
