"""Calls with arguments that have moved into an object."""

import inspect

import pytest

from tensegrity_codegen import (
    build_controller,
    simulate,
    simulate_batch,
    simulate_control,
    simulate_control_batch,
    study_control,
)
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.moved_arguments import MovedArgumentError, with_moved


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
