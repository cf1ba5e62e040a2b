"""Time laws: the quintic, tables, what is refused."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.time_law import read_law
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError

PART = np.linspace(0.0, 1.0, 1001)


def quintic(x: np.ndarray) -> np.ndarray:
    return 10 * x**3 - 15 * x**4 + 6 * x**5


def test_the_quintic() -> None:
    s, rate, bend = read_law("quintic").at(PART)
    np.testing.assert_allclose(s, quintic(PART), atol=1e-14)
    np.testing.assert_allclose(rate, 30 * PART**2 * (1 - PART) ** 2, atol=1e-13)
    np.testing.assert_allclose(bend, 60 * PART * (1 - PART) * (1 - 2 * PART), atol=1e-12)


def test_a_table_of_the_quintic_is_the_quintic() -> None:
    time = np.linspace(0.0, 2.0, 12)
    law = read_law(np.column_stack([time, quintic(time / 2)]))
    assert law.own_duration == 2.0
    np.testing.assert_allclose(law.at(PART)[0], quintic(PART), atol=1e-13)


def test_a_law_that_returns_is_at_rest_at_the_far_end() -> None:
    law = read_law("quintic").returning()
    s, rate, bend = law.at(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    np.testing.assert_allclose(s, [0.0, 0.5, 1.0, 0.5, 0.0], atol=1e-15)
    np.testing.assert_allclose(rate, [0.0, 3.75, 0.0, -3.75, 0.0], atol=1e-12)
    np.testing.assert_allclose(bend, 0.0, atol=1e-12)
    x, step = PART[1:-1], 1e-6
    low, high = law.at(x - step), law.at(x + step)
    np.testing.assert_allclose((high[0] - low[0]) / (2 * step), law.at(x)[1], atol=1e-7)
    np.testing.assert_allclose((high[1] - low[1]) / (2 * step), law.at(x)[2], atol=1e-3)
    assert read_law([[0, 0], [3, 1]]).returning().own_duration == 6.0


@pytest.mark.parametrize(
    "table",
    [
        [[0, 0], [1, 0.01], [1.1, 0.9], [3, 0.9], [4, 1]],  # a spline through these goes back
        [[0, 0], [1, 0], [2, 1]],
        [[0, 0], [0.5, 0.2], [1.5, 0.9], [2, 1]],
    ],
)
def test_tables_are_met_and_never_go_back(table: Any) -> None:
    rows = np.array(table, dtype=float)
    law = read_law(rows)
    part = rows[:, 0] / rows[-1, 0]
    np.testing.assert_allclose(law.at(part)[0], rows[:, 1], atol=1e-12)
    s, rate, bend = law.at(np.linspace(0, 1, 20001))
    assert rate.min() >= -1e-9
    assert np.all((s >= 0) & (s <= 1))
    for at_rest in (rate, bend):
        np.testing.assert_allclose(at_rest[[0, -1]], 0.0, atol=1e-9 * np.abs(at_rest).max())
    before, after = law.piece(part[1:-1] - 1e-9, 2), law.piece(part[1:-1] + 1e-9, 2)
    np.testing.assert_allclose(before, after, atol=1e-5 * np.abs(bend).max())


@pytest.mark.parametrize(
    ("law", "error", "words"),
    [
        ("linear", UnknownNameError, "quintic"),
        ([[0, 0]], InvalidValueError, "two rows"),
        (3.0, InvalidValueError, "table"),
        ([["a", 1]], InvalidValueError, "not an array of numbers"),
        ([[0, 0], [1, 2]], InvalidValueError, "end of the path"),
        ([[0.1, 0], [1, 1]], InvalidValueError, "start"),
        ([[0, 0], [0, 0.5], [1, 1]], InvalidValueError, "times do not rise"),
        ([[0, 0], [0.5, 0.7], [0.7, 0.6], [1, 1]], InvalidValueError, "row 2"),
        ([[0, 0], [0.5, float("nan")], [1, 1]], NonFiniteError, "not finite"),
    ],
)
def test_what_is_no_time_law(law: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error) as caught:
        read_law(law)
    assert words in str(caught.value)
    assert "law" in str(caught.value)
