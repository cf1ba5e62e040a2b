"""Profiles: values between knots against closed forms and SciPy, and what is refused."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tensegrity_codegen import Profile
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError

TIME = np.array([0.0, 0.1, 0.5, 0.6, 2.0])
VALUE = np.array([0.0, 1.0, -2.0, 3.0, 0.5])


def test_lines_go_through_all_knots() -> None:
    profile = Profile(TIME, {"motor": VALUE})
    for t in np.linspace(0.0, 2.0, 401):
        assert profile(t)["motor"] == pytest.approx(np.interp(t, TIME, VALUE), abs=1e-14)
    assert profile.pieces.is_kink.tolist() == [False, True, True, True, False]


def test_a_straight_line_has_no_kinks() -> None:
    assert not Profile([0.0, 1.0, 3.0], {"motor": [0.0, 1.0, 3.0]}).pieces.is_kink.any()


def test_cubic_is_the_spline_of_scipy() -> None:
    profile, spline = Profile(TIME, {"motor": VALUE}, "cubic"), CubicSpline(TIME, VALUE)
    for t in np.linspace(0.0, 2.0, 401):
        assert profile(t)["motor"] == pytest.approx(float(spline(t)), rel=1e-13, abs=1e-13)
    assert profile.pieces.is_kink[2]  # where the third derivative jumps


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_two_equal_times_are_a_jump(kind: Any) -> None:
    profile = Profile([0.0, 0.5, 1.0, 1.0, 1.5, 2.0], {"motor": [0.0, 0.0, 0.0, 3.0, 3.0, 3.0]}, kind)
    assert [float(profile(t)["motor"]) for t in (0.0, np.nextafter(1.0, 0.0), 1.0, 1.7)] == [
        0.0,
        0.0,
        3.0,
        3.0,
    ]
    assert profile.pieces.time.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert profile.pieces.is_kink.tolist() == [False, False, True, False, False]


def test_arrays_keep_their_shape_and_order() -> None:
    values = {"b": np.arange(8.0).reshape(2, 4), "a": np.arange(12.0).reshape(2, 2, 3), "c": [1.0, 3.0]}
    found = Profile([0.0, 2.0], values)(1.0)
    assert list(found) == ["b", "a", "c"]
    for name, value in values.items():
        np.testing.assert_allclose(found[name], np.mean(value, axis=0))


def test_the_arrays_are_copies_that_nobody_changes() -> None:
    value = np.array([0.0, 1.0])
    profile = Profile([0.0, 1.0], {"motor": value})
    value[:] = 9.0
    assert float(profile(1.0)["motor"]) == 1.0
    with pytest.raises(ValueError, match="read-only"):
        profile.values["motor"][0] = 1.0


@pytest.mark.parametrize(
    ("time", "values", "message"),
    [
        ([0.0, 2.0, 1.0], [0, 0, 0], "the time goes back"),
        ([0.5, 2.0], [0, 0], "does not start at 0"),
        ([0.0], [0], "too few knots"),
        ([0.0, 0.0, 1.0], [0, 0, 0], "jump at the start"),
        ([0.0, 1.0, 1.0], [0, 0, 0], "jump at the start or the end"),
        ([0.0, 1.0, 1.0, 1.0, 2.0], [0, 0, 0, 0, 0], "more than two knots"),
        ([0.0, 1.0], [0, 0, 0], "one value at each knot"),
        ([0.0, 1.0], 3.0, "not an array of numbers"),
        ([0.0, 1.0], ["a", "b"], "not an array of numbers"),
        ([0.0, "x"], [0, 0], "not an array of numbers"),
    ],
)
def test_bad_knots_are_named(time: Any, values: Any, message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Profile(time, {"motor": values})


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_are_finite(bad: float) -> None:
    with pytest.raises(NonFiniteError, match="not a finite number"):
        Profile([0.0, 1.0], {"motor": [0.0, bad]})
    with pytest.raises(NonFiniteError, match="not a finite number"):
        Profile([0.0, bad], {"motor": [0.0, 0.0]})


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_slopes_are_finite(kind: Any) -> None:
    with pytest.raises(NonFiniteError, match="slopes"):
        Profile([0.0, 1e-310, 1.0, 2.0], {"motor": [0.0, 1e10, 0.0, 0.0]}, kind)


def test_no_values_and_no_such_kind() -> None:
    with pytest.raises(InvalidValueError, match="no values"):
        Profile([0.0, 1.0], {})
    with pytest.raises(UnknownNameError, match="kind of profile"):
        Profile([0.0, 1.0], {"motor": [0, 0]}, "cubik")  # type: ignore[arg-type]
