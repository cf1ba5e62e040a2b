"""Outputs of libraries with other members, joined by their labels."""

import numpy as np
import pytest

from tensegrity_codegen.analyses.cases.record import Output
from tensegrity_codegen.sweeps.engines.work import find_places, join_outputs
from tensegrity_codegen.system.errors import InvalidValueError


def tension(*members: str) -> Output:
    return Output("tension", ("member",), (len(members),), "float64", "N", "Tensions.", {"member": members})


def test_labels_are_joined_in_the_order_of_first_appearance() -> None:
    one, two = tension("a", "b"), tension("b", "c", "a")
    joint = join_outputs([(one,), (two,)])
    assert joint == (tension("a", "b", "c"),)
    places = find_places(two, joint[0])
    assert places is not None
    np.testing.assert_array_equal(places[0], [1, 2, 0])
    assert find_places(joint[0], joint[0]) is None


def test_an_output_of_one_library_alone_is_kept() -> None:
    energy = Output("energy", (), (), "float64", "J", "Energy.")
    assert join_outputs([(tension("a"),), (tension("a"), energy)]) == (tension("a"), energy)


def test_axes_without_labels_have_one_size() -> None:
    rows = [Output("modes", ("mode",), (size,), "float64", "Hz", "Frequencies.") for size in (2, 3)]
    with pytest.raises(InvalidValueError, match="another size"):
        join_outputs([(rows[0],), (rows[1],)])
