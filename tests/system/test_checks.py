import numpy as np
import pytest

from tensegrity_codegen.system.checks import check_positive, check_whole, is_number, is_whole
from tensegrity_codegen.system.errors import InvalidValueError


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
