"""Texts of conditions: what is refused without a model, and by which words."""

import pytest

from tensegrity_codegen.runtime.simulate.condition_text import parse_condition
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError


@pytest.mark.parametrize("text", ["abs+1", "abs < 1", "min(min)", "max", "sum(sqrt, 1)", "-min"])
def test_a_function_is_no_value(text: str) -> None:
    with pytest.raises(InvalidValueError, match="needs an argument in parentheses"):
        parse_condition(text)


@pytest.mark.parametrize(
    "text",
    ["1/0 < 1", "time / 0", "0 ** -1", "sqrt(-1)", "1e999 < time", "9" * 490, "2 ** 5000", "1 - 1e400"],
)
def test_a_constant_part_that_is_not_finite_is_named(text: str) -> None:
    with pytest.raises(NonFiniteError) as caught:
        parse_condition(text)
    assert caught.value.given


@pytest.mark.parametrize("text", ["abs(1, 2)", "sqrt()", "min()", "sqrt(time, 1) < 2"])
def test_a_wrong_number_of_arguments_is_refused(text: str) -> None:
    with pytest.raises(InvalidValueError, match="takes one argument"):
        parse_condition(text)


@pytest.mark.parametrize(
    "text",
    [
        *("True", "1j", "'a' < 'b'", "min(*member_length)", "max(time, key=abs)", "member_length[-'a']"),
        *("member_length[True]", "member_length[1.5]", "min[0]", "time[0] < 1", "member_length[0][0]"),
        *("-" * 499 + "1", "\udc80", "time\0", "(1 < 2) < 3"),
    ],
)
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(InvalidValueError):
        parse_condition(text)


@pytest.mark.parametrize("text", ["exp(time)", "getattr(time)", "lengths < 1", "lengths[0]"])
def test_unknown_words_are_named(text: str) -> None:
    with pytest.raises(UnknownNameError):
        parse_condition(text)
