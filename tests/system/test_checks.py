import inspect

import numpy as np
import pytest

from tensegrity_codegen import (
    build_controller,
    simulate,
    simulate_batch,
    simulate_control,
    simulate_control_batch,
    study_control,
)
from tensegrity_codegen.system.checks import (
    MovedArgumentError,
    check_positive,
    check_whole,
    is_number,
    is_whole,
    with_moved,
)
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError


@pytest.mark.parametrize("value", [3, np.int32(3), np.uint8(3)])
def test_whole_numbers_are_integers_of_python_and_numpy(value):
    assert is_whole(value)
    assert check_whole(value, "count", 3, 3) == 3


@pytest.mark.parametrize("value", [2, 5, 3.0, "3", True, None, [3], np.array([3])])
def test_whole_numbers_out_of_range_and_other_things_are_refused(value):
    with pytest.raises(InvalidValueError, match="count: out of range") as caught:
        check_whole(value, "count", 3, 4)
    assert "a whole number from 3 to 4" in str(caught.value)


def test_range_without_an_end_says_so():
    with pytest.raises(InvalidValueError, match="a whole number from 1 on"):
        check_whole(0, "threads", 1)


@pytest.mark.parametrize("value", [1, 1.5, np.float32(1.5), np.int64(1)])
def test_numbers_are_real_and_finite(value):
    assert is_number(value)
    assert check_positive(value, "t_end") == float(value)


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, "1", None, True, [1.0], 1j])
def test_what_is_no_positive_number_is_refused_with_its_unit(value):
    with pytest.raises(InvalidValueError, match="step: out of range") as caught:
        check_positive(value, "step", "[s]")
    assert "a finite number > 0 [s]" in str(caught.value)


@with_moved(speed="motion=Motion(speed=...)")
def drive(distance: float, *, motion: float = 1.0) -> float:
    """Return a product."""
    return distance * motion


def test_a_moved_argument_says_where_it_is_now() -> None:
    with pytest.raises(MovedArgumentError) as caught:
        drive(1.0, speed=2.0)  # type: ignore[call-arg]
    assert caught.value.where == "speed"
    assert "motion=Motion(speed=...)" in str(caught.value)
    assert isinstance(caught.value, TypeError)
    assert isinstance(caught.value, TensegrityError)


def test_other_calls_are_those_of_the_function() -> None:
    assert drive(3.0, motion=2.0) == 6.0
    assert list(inspect.signature(drive).parameters) == ["distance", "motion"]
    with pytest.raises(TypeError, match="unexpected keyword argument"):
        drive(1.0, sped=2.0)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("function", "name", "place"),
    [
        (simulate, "step", "Stepping(step=...)"),
        (simulate, "until_contact", "Until(contact=True)"),
        (simulate, "condition", "Until(condition=..., stops=False)"),
        (simulate_batch, "atol", "Stepping(atol=...)"),
        (simulate_control, "gust", "Disturbance(gust=...)"),
        (simulate_control, "delay", "ActuatorLimits(delay=...)"),
        (simulate_control_batch, "knots", "ControllerCode(knots=...)"),
        (build_controller, "precision", "ControllerCode(precision=...)"),
        (study_control, "seed", "Draws(seed=...)"),
    ],
)
def test_functions_name_the_object(function: object, name: str, place: str) -> None:
    with pytest.raises(MovedArgumentError) as caught:
        function(None, None, **{name: None})  # type: ignore[operator]
    assert place in caught.value.allowed
    assert name not in inspect.signature(function).parameters  # type: ignore[arg-type]
