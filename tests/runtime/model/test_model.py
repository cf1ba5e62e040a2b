"""Calling compiled functions: no copies where none are needed, the same numbers whatever is handed in."""

import gc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError
from tests.runtime.model.libraries import QUANTITIES, loaded_prism


def spread(array: np.ndarray) -> np.ndarray:
    """The same numbers, not contiguous."""
    wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]))
    wide[..., ::2] = array
    return wide[..., ::2]


FORMS: dict[str, Callable[[np.ndarray], Any]] = {
    "contiguous": lambda a: a,
    "read-only": lambda a: np.frombuffer(a.tobytes()).reshape(a.shape),
    "strided": spread,
    "reversed twice": lambda a: np.ascontiguousarray(a[::-1])[::-1],
    "fortran": np.asfortranarray,
    "swapped bytes": lambda a: a.astype(">f8"),
    "list": lambda a: a.tolist(),
    "flat": lambda a: a.ravel(),
    "subclass": np.ma.array,
    "single precision": lambda a: a.astype(np.float32),  # which holds these numbers
    "integers": lambda a: a.astype(int),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("quantity", ["member_tension", "node_force"])
def test_the_form_of_an_argument_does_not_matter(model: CompiledModel, quantity: str, form: str) -> None:
    change = {"coordinate": np.arange(15.0), "node_load": model.nominal("node_load") * 2.0}
    expected = model.compute(quantity, **change)
    assert not np.array_equal(expected, model.compute(quantity))
    found = model.compute(quantity, **{name: FORMS[form](array) for name, array in change.items()})
    np.testing.assert_array_equal(found, expected)


def test_arguments_are_not_changed(model: CompiledModel) -> None:
    given = {name: model.nominal(name) for name in ("coordinate", "node_load", "rest_length")}
    copies = {name: array.copy() for name, array in given.items()}
    model.compute("acceleration", **given)
    for name, array in given.items():
        np.testing.assert_array_equal(array, copies[name])


def test_functions_take_arrays_in_the_order_of_their_arguments(model: CompiledModel) -> None:
    function = model.function("node_force")
    assert function.arguments == ("coordinate", "rest_length", "node_load")
    values = [model.nominal(name) for name in function.arguments]
    np.testing.assert_array_equal(function(*values), model.compute("node_force"))
    assert function(*values).shape == function.spec.shape == (6, 3)


def test_omitted_arguments_take_the_scene_s_values(model: CompiledModel) -> None:
    given = {name: model.nominal(name) for name in ("coordinate", "rest_length")}
    np.testing.assert_array_equal(model.compute("member_tension", **given), model.compute("member_tension"))


def test_arguments_that_do_not_matter_are_ignored(model: CompiledModel) -> None:
    found = model.compute(
        "member_tension", velocity=np.full(15, np.nan), node_load=1 + model.nominal("node_load")
    )
    np.testing.assert_array_equal(found, model.compute("member_tension"))


def test_a_scalar_is_a_float(model: CompiledModel) -> None:
    assert type(model.compute("total_energy")) is float


def test_a_sparse_result_belongs_to_the_caller(model: CompiledModel) -> None:
    found, again = model.compute("tangent_stiffness"), model.compute("tangent_stiffness")
    found.indices[:] = 0
    found.indptr[:] = 0
    np.testing.assert_array_equal(model.compute("tangent_stiffness").toarray(), again.toarray())


def test_a_sparse_result_has_the_pattern_of_the_manifest(model: CompiledModel) -> None:
    found = model.compute("tangent_stiffness")
    assert isinstance(found, sparse.csc_array)
    assert found.shape == (15, 15)
    assert found.has_sorted_indices
    np.testing.assert_allclose(found.toarray(), found.toarray().T)


@pytest.mark.parametrize("quantity", ["member_tension", "node_force", "total_energy", "tangent_stiffness"])
def test_out_receives_the_result(model: CompiledModel, quantity: str) -> None:
    expected = model.compute(quantity)
    size = {"tangent_stiffness": lambda: expected.nnz, "total_energy": lambda: 1}
    shape = size[quantity]() if quantity in size else expected.shape
    out = np.full(shape, 7.0)
    found = model.compute(quantity, out=out)
    values = found.data if sparse.issparse(found) else np.atleast_1d(found)
    np.testing.assert_array_equal(out, values)
    np.testing.assert_array_equal(values, expected.data if sparse.issparse(expected) else expected)


def test_out_is_the_returned_array(model: CompiledModel) -> None:
    out = np.empty((6, 3))
    assert model.compute("node_force", out=out) is out


def read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "out",
    [
        np.empty(17),
        np.empty(18),
        np.empty((3, 6)),
        np.empty((6, 3), dtype=np.float32),
        np.empty((6, 6))[:, ::2],
        np.empty((3, 6)).T,
        read_only(np.empty((6, 3))),
        [[0.0] * 3] * 6,
    ],
    ids=["short", "flat", "turned", "single", "strided", "fortran", "read-only", "list"],
)
def test_an_out_that_does_not_fit_is_refused(model: CompiledModel, out: Any) -> None:
    with pytest.raises(InvalidValueError, match="`out` has the wrong type or shape") as caught:
        model.compute("node_force", out=out)
    assert "(6, 3)" in caught.value.allowed


def test_an_out_that_is_an_argument_is_refused(model: CompiledModel) -> None:
    coordinate = model.nominal("coordinate")
    before = coordinate.copy()
    with pytest.raises(InvalidValueError, match="`out` has the wrong type or shape"):
        model.compute("acceleration", coordinate=coordinate, out=coordinate)
    np.testing.assert_array_equal(coordinate, before)


@pytest.mark.parametrize(
    "value",
    [np.zeros(14), np.zeros((3, 5)), np.zeros((15, 1)), 0.0, [], [[1.0], [2.0, 3.0]], "text", None, [1j]],
)
def test_a_value_of_the_wrong_shape_or_kind_names_the_argument(model: CompiledModel, value: Any) -> None:
    with pytest.raises(InvalidValueError) as caught:
        model.compute("member_tension", coordinate=value)
    assert caught.value.where == "coordinate"
    assert caught.value.allowed == "shape (15,)"


@pytest.mark.parametrize("count", [0, 2, 4])
def test_a_wrong_number_of_arguments_lists_the_right_ones(model: CompiledModel, count: int) -> None:
    values = [model.nominal("coordinate")] * count
    with pytest.raises(InvalidValueError, match="wrong number of arguments") as caught:
        model.function("node_force")(*values)
    assert caught.value.given == count
    assert caught.value.allowed == "3: coordinate, rest_length, node_load"


def test_unknown_words_suggest_the_closest(model: CompiledModel) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'coordinate'"):
        model.compute("member_tension", coordinates=np.zeros(15))
    with pytest.raises(UnknownNameError, match="did you mean 'member_tension'"):
        model.compute("member_tensions")
    with pytest.raises(UnknownNameError, match="did you mean 'rest_length'"):
        model.nominal("rest_lengths")
    assert not model.has("state_jacobian")
    with pytest.raises(UnknownNameError, match="add it to the quantities and build again"):
        model.function("state_jacobian")


def test_a_non_finite_argument_is_named_also_when_it_was_converted(model: CompiledModel) -> None:
    coordinate = model.nominal("coordinate").tolist()
    coordinate[4] = float("inf")
    with pytest.raises(NonFiniteError, match=r"'coordinate' is not finite at \(4,\)") as caught:
        model.compute("member_tension", coordinate=coordinate)
    assert caught.value.where == "member_tension"


def test_nominal_values_are_copies(model: CompiledModel) -> None:
    model.nominal("coordinate")[:] = 0.0
    assert model.nominal("coordinate").any()
    assert model.nominal("node_load").shape == (2, 3)


def test_a_model_lists_what_it_computes(model: CompiledModel) -> None:
    assert model.quantities == QUANTITIES
    assert all(model.has(name) for name in QUANTITIES)


def test_a_function_outlives_its_model(model: CompiledModel) -> None:
    function = loaded_prism().function("total_energy")
    gc.collect()
    arguments = [model.nominal(name) for name in function.arguments]
    assert function(*arguments) == model.compute("total_energy")


# --- a few states, one after the other ---------------------------------------------------------------


def test_rows_are_those_of_single_calls_and_what_is_not_finite_is_nan(model: CompiledModel) -> None:
    places = model.nominal("coordinate") + 0.01 * np.arange(4.0)[:, None]
    places[2] = np.nan
    rows = model.compute_rows("member_tension", {"coordinate": places}, {}, len(places))
    for k in (0, 1, 3):
        np.testing.assert_array_equal(rows[k], model.compute("member_tension", coordinate=places[k]))
    assert np.isnan(rows[2]).all()
    assert model.compute_rows("total_energy", {"coordinate": places[:0]}, {}, 0).shape == (0, 1)


def test_rows_of_another_size_are_refused(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="wrong shape"):
        model.compute_rows("member_tension", {"coordinate": np.zeros((3, 2))}, {}, 3)


def test_facts_are_found_once(model: CompiledModel) -> None:
    found = [model.keep("a test", lambda: object()) for _ in range(2)]
    assert found[0] is found[1]
    assert model.keep("another test", lambda: 1) == 1
