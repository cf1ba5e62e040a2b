"""Cases of grids: their order, and that no division changes a bit."""

import itertools

import numpy as np
import pytest

from tensegrity_codegen.sweeps.cases.cases import MOST_LISTED, Axis, Cases
from tensegrity_codegen.system.errors import InvalidValueError

AXES = (
    Axis("a", np.array([1.0, 2.0])),
    Axis("b", np.array([0.1, 0.2, 0.3])),
    Axis("c", np.array([7.0, 8.0])),
)


def test_the_last_axis_of_a_grid_varies_fastest() -> None:
    cases = Cases(AXES)
    expected = list(itertools.product(*(axis.values.tolist() for axis in AXES)))
    assert (cases.keys, cases.shape, cases.count, cases.method) == (("a", "b", "c"), (2, 3, 2), 12, "grid")
    assert [tuple(row) for row in cases.values().tolist()] == expected


@pytest.mark.parametrize("size", [1, 5, 12])
def test_a_grid_has_the_same_values_however_it_is_divided(size: int) -> None:
    cases = Cases(AXES)
    pieces = [cases.values(first, min(first + size, 12)) for first in range(0, 12, size)]
    assert np.array_equal(np.concatenate(pieces), cases.values())


def test_cases_can_be_selected_in_any_order() -> None:
    numbers = np.array([5, 0, 11, 5])
    assert np.array_equal(Cases(AXES).select(numbers), Cases(AXES).values()[numbers])


@pytest.mark.parametrize("bounds", [(-1, 2), (3, 2), (0, 13)])
def test_a_range_that_is_not_among_the_cases_is_an_error(bounds: tuple[int, int]) -> None:
    with pytest.raises(InvalidValueError, match="not a range of cases"):
        Cases(AXES).values(*bounds)


def test_descriptions_differ_where_a_value_differs() -> None:
    many = np.linspace(0.0, 1.0, MOST_LISTED + 1)
    other = many.copy()
    other[500] = np.nextafter(other[500], 1.0)
    descriptions = [Cases((Axis("a", values),)).describe() for values in (many, many.copy(), other)]
    assert descriptions[0] == descriptions[1]
    assert descriptions[0] != descriptions[2]
    assert Cases(AXES).describe() == Cases(AXES).describe()
    assert Cases(AXES).describe() != Cases(AXES[::-1]).describe()
