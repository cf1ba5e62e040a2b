"""Quantities as functions with derivatives, without JAX and PyTorch."""

import numpy as np
import pytest

from tensegrity_codegen.learning.derivatives.quantity import QuantityFunction
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
)
from tests.learning.derivatives.products import check_products, draw_points


@pytest.mark.parametrize("quantity", ["acceleration", "member_tension", "member_length", "total_energy"])
def test_derivatives_are_those_of_differences_for_one_state_and_for_batches(
    quantities: CompiledModel, quantity: str
) -> None:
    function = QuantityFunction(quantities, quantity)
    for lead, shared in (((), ()), ((9,), ("rest_length", "damping")), ((2, 3), ("velocity",))):
        values = draw_points(function, lead, shared)
        found = function.evaluate(values)[quantity]
        assert found.shape == (*lead, *function.outputs[quantity])
        first = (0,) * len(lead)
        at = {name: value if name in shared else value[first] for name, value in values.items()}
        np.testing.assert_array_equal(found[first], quantities.compute(quantity, **at))
        check_products(function, values, rtol=1e-6)


def test_omitted_arguments_are_at_the_scene_and_others_do_not_matter(quantities: CompiledModel) -> None:
    function = QuantityFunction(quantities, "member_length")
    assert [*function.inputs] == ["coordinate"]
    found = function.evaluate({})["member_length"]
    np.testing.assert_array_equal(found, quantities.compute("member_length"))
    aligned = function.align({"coordinate": np.zeros(6), "velocity": np.zeros((4, 6))}, np.asarray)
    assert {name: value.shape for name, value in aligned.items()} == {"coordinate": (6,)}
    of_all = QuantityFunction(quantities, "acceleration")
    aligned = of_all.align({"coordinate": np.zeros((2, 3, 6)), "rest_length": np.zeros((3, 1))}, np.asarray)
    assert {name: value.shape for name, value in aligned.items()} == {
        "coordinate": (2, 3, 6),
        "rest_length": (1, 3, 1),
    }
    assert of_all.evaluate({"coordinate": np.zeros((0, 6))})["acceleration"].shape == (0, 6)


def test_a_state_that_fails_raises_or_is_not_a_number(quantities: CompiledModel) -> None:
    values = np.tile(quantities.nominal("coordinate"), (5, 1))
    values[3, 0] = np.nan
    with pytest.raises(NonFiniteError, match="element 3 of 5"):
        QuantityFunction(quantities, "acceleration").evaluate({"coordinate": values})
    function = QuantityFunction(quantities, "acceleration", on_error="nan")
    found = function.evaluate({"coordinate": values})["acceleration"]
    assert np.isnan(found).any(axis=1).tolist() == [False, False, False, True, False]
    back = function.pull({"coordinate": values}, {"acceleration": np.ones((5, 6))})["coordinate"]
    assert np.isnan(back).all(axis=1).tolist() == [False, False, False, True, False]


def test_what_a_library_lacks_is_named_with_what_to_compile(quantities: CompiledModel) -> None:
    with pytest.raises(UnknownNameError, match="member_tension"):
        QuantityFunction(quantities, "member_tensions")
    with pytest.raises(FormulationError, match=r"for_=.derivatives.*kinetic_energy_slopes"):
        QuantityFunction(quantities, "kinetic_energy")
    function = QuantityFunction(quantities, "acceleration")
    with pytest.raises(UnknownNameError, match="rest_length"):
        function.align({"rest_lengths": np.zeros(1)}, np.asarray)
    with pytest.raises(InvalidValueError, match="leading axes"):
        function.align({"coordinate": np.zeros(5)}, np.asarray)
    with pytest.raises(UnknownNameError, match="nan"):
        QuantityFunction(quantities, "acceleration", on_error="NaN")
