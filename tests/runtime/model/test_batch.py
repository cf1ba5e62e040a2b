"""Batches from Python: the same numbers as one by one, whatever is shared, however many threads."""

import threading
import time
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.library import SparseBatch
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.errors import InvalidValueError, LibraryError, NonFiniteError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.compilers import EACH_FAMILY, require_compiler, wait_until
from tests.comparison import dense
from tests.models import load
from tests.runtime.build import prism
from tests.runtime.model.libraries import QUANTITIES, loaded_prism


def scattered(model: CompiledModel, name: str, n_batch: int, seed: int = 0) -> np.ndarray:
    nominal = model.nominal(name)
    noise = 0.05 * np.random.default_rng(seed).normal(size=(n_batch, *nominal.shape))
    return (nominal * (1.0 + noise)).astype(model.dtype)


def one_by_one(model: CompiledModel, quantity: str, n_batch: int, **batched: np.ndarray) -> np.ndarray:
    results = [
        model.compute(quantity, **{name: array[k] for name, array in batched.items()}) for k in range(n_batch)
    ]
    plain = [result.data if sparse.issparse(result) else result for result in results]
    return np.array(plain, dtype=model.dtype)


# --- results ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("n_batch", [1, 9, 100, *thorough(7, 8, 1000)])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_batch_is_what_single_calls_give(model: CompiledModel, quantity: str, n_batch: int) -> None:
    coordinate = scattered(model, "coordinate", n_batch)
    found = model.compute_batch(quantity, coordinate=coordinate)
    expected = one_by_one(model, quantity, n_batch, coordinate=coordinate)
    np.testing.assert_array_equal(np.asarray(found), expected)


@pytest.mark.thorough
@pytest.mark.parametrize("width", [4, *thorough(16)])
@pytest.mark.parametrize("precision", ["double", "single"])
def test_the_width_does_not_change_the_numbers(width: int, precision: str) -> None:
    model = loaded_prism(batch_width=width, precision=precision)
    coordinate = scattered(model, "coordinate", 21)
    for quantity in QUANTITIES:
        found = np.asarray(model.compute_batch(quantity, coordinate=coordinate))
        assert found.dtype == model.dtype
        np.testing.assert_array_equal(found, one_by_one(model, quantity, 21, coordinate=coordinate))


def test_an_empty_batch_gives_empty_results(model: CompiledModel) -> None:
    empty = np.zeros((0, 15))
    assert model.compute_batch("node_force", coordinate=empty).shape == (0, 6, 3)
    assert model.compute_batch("total_energy", coordinate=empty, threads=2).shape == (0,)
    assert len(model.compute_batch("tangent_stiffness", coordinate=empty)) == 0
    result, status = model.compute_batch("node_force", coordinate=empty, on_error="status")
    assert (result.shape, status.shape) == ((0, 6, 3), (0,))


def test_several_arguments_may_have_the_axis_and_others_share(model: CompiledModel) -> None:
    load, rest = scattered(model, "node_load", 9, 1), scattered(model, "rest_length", 9, 2)
    moved = model.nominal("coordinate") * 1.01
    found = model.compute_batch("node_force", coordinate=moved, node_load=load, rest_length=rest)
    expected = [
        model.compute("node_force", coordinate=moved, node_load=a, rest_length=b)
        for a, b in zip(load, rest, strict=True)
    ]
    np.testing.assert_array_equal(found, expected)
    assert not np.array_equal(found[0], found[1])


def test_a_function_takes_arrays_in_the_order_of_its_arguments(model: CompiledModel) -> None:
    function = model.function("node_force")
    assert function.arguments == ("coordinate", "rest_length", "node_load")
    load = scattered(model, "node_load", 3)
    found = function.batch(model.nominal("coordinate"), model.nominal("rest_length"), load)
    np.testing.assert_array_equal(found, model.compute_batch("node_force", node_load=load))


def test_lists_strides_and_other_number_types_are_taken(model: CompiledModel) -> None:
    coordinate = scattered(model, "coordinate", 5)
    expected = model.compute_batch("member_tension", coordinate=coordinate)
    wide = np.zeros((5, 30))
    wide[:, ::2] = coordinate
    for form in (coordinate.tolist(), wide[:, ::2], np.asfortranarray(coordinate), coordinate.astype(">f8")):
        np.testing.assert_array_equal(model.compute_batch("member_tension", coordinate=form), expected)
    single = coordinate.astype(np.float32)
    np.testing.assert_array_equal(
        model.compute_batch("member_tension", coordinate=single),
        model.compute_batch("member_tension", coordinate=single.astype(float)),
    )


def test_a_sparse_batch_has_one_pattern_and_its_matrices(model: CompiledModel) -> None:
    coordinate = scattered(model, "coordinate", 4)
    found = model.compute_batch("tangent_stiffness", coordinate=coordinate)
    pattern = model.function("tangent_stiffness").spec.pattern
    assert isinstance(found, SparseBatch)
    assert found.values.shape == (4, len(pattern.row))
    assert found.pattern is pattern
    for matrix, one in zip(found, coordinate, strict=True):
        expected = model.compute("tangent_stiffness", coordinate=one)
        np.testing.assert_array_equal(dense(matrix), dense(expected))
    found[1].data[:] = 0.0
    assert found.values[1].any()


def test_arguments_are_not_changed(model: CompiledModel) -> None:
    coordinate = scattered(model, "coordinate", 11)
    copy = coordinate.copy()
    model.compute_batch("acceleration", coordinate=coordinate, threads=2)
    np.testing.assert_array_equal(coordinate, copy)


# --- threads ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [2, 200, *thorough(3, 16)])
def test_the_number_of_threads_does_not_change_a_bit(model: CompiledModel, threads: int) -> None:
    coordinate, load = scattered(model, "coordinate", 1001), scattered(model, "node_load", 1001, 1)
    coordinate[777, 3] = np.nan
    for quantity in QUANTITIES:
        options = {"coordinate": coordinate, "node_load": load, "on_error": "status"}
        expected, expected_status = model.compute_batch(quantity, **options)
        found, status = model.compute_batch(quantity, threads=threads, **options)
        np.testing.assert_array_equal(np.asarray(found), np.asarray(expected))
        np.testing.assert_array_equal(status, expected_status)
        assert np.flatnonzero(status).tolist() == [777]


def test_python_runs_on_while_a_batch_is_computed(model: CompiledModel) -> None:
    coordinate = np.tile(model.nominal("coordinate"), (100_000, 1))
    ticks: list[float] = []
    done = threading.Event()

    def tick() -> None:
        while not done.is_set():
            ticks.append(time.perf_counter())

    other = threading.Thread(target=tick)
    other.start()
    batch = model.function("acceleration").batch
    call, measured = batch._call, [0.0, 0.0]

    def timed(*arguments: Any) -> int:
        measured[0] = time.perf_counter()
        status = call(*arguments)
        measured[1] = time.perf_counter()
        return int(status)

    def compute_and_count() -> int:
        """Return how many times the other thread noted while C computed."""
        model.compute_batch("acceleration", coordinate=coordinate)
        return sum(measured[0] < moment < measured[1] for moment in ticks)

    try:
        batch._call = timed
        # With the lock held by the call, the other thread could not note a single time within it.
        wait_until(lambda: compute_and_count() > 10, "Python ran while C computed")
    finally:
        batch._call = call
        done.set()
        other.join()


# --- what is wrong ---------------------------------------------------------------------------------


def test_the_first_bad_element_is_named_with_its_argument(model: CompiledModel) -> None:
    coordinate = scattered(model, "coordinate", 100)
    coordinate[[41, 97], [7, 2]] = np.nan, np.inf
    with pytest.raises(NonFiniteError) as caught:
        model.compute_batch("member_tension", coordinate=coordinate)
    assert "argument 'coordinate' is not finite at (7,)" in caught.value.problem
    assert caught.value.where == "member_tension: element 41 of 100, the first of 2 that failed"
    assert np.isnan(caught.value.given)


def test_a_bad_shared_argument_is_named(model: CompiledModel) -> None:
    load = model.nominal("node_load")
    load[1, 2] = np.inf
    with pytest.raises(NonFiniteError, match=r"argument 'node_load' is not finite at \(1, 2\)"):
        model.compute_batch("node_force", coordinate=scattered(model, "coordinate", 3), node_load=load)


def test_a_result_that_is_not_finite_is_said_of_its_element(model: CompiledModel) -> None:
    coordinate = scattered(model, "coordinate", 20)
    coordinate[12, 0] = 1e200  # whose square overflows
    with pytest.raises(NonFiniteError, match="the result is not finite") as caught:
        model.compute_batch("acceleration", coordinate=coordinate)
    assert caught.value.where == "acceleration: element 12 of 20"


def test_statuses_are_returned_where_asked(model: CompiledModel) -> None:
    coordinate = scattered(model, "coordinate", 20)
    expected = np.asarray(model.compute_batch("acceleration", coordinate=coordinate))
    coordinate[3, 1] = np.nan
    coordinate[12, 0] = 1e200  # whose square overflows
    found, status = model.compute_batch("acceleration", coordinate=coordinate, on_error="status")
    assert status[[3, 12]].tolist() == [1, 2]
    assert not np.delete(status, [3, 12]).any()
    assert np.isnan(found[[3, 12]]).all()
    np.testing.assert_array_equal(np.delete(found, [3, 12], axis=0), np.delete(expected, [3, 12], axis=0))


FITS = np.zeros((3, 15))


@pytest.mark.parametrize(
    "arguments",
    [
        {"coordinate": np.zeros((3, 14))},
        {"coordinate": np.zeros((2, 3, 15))},
        {"coordinate": np.zeros(14)},
        {"coordinate": 1.0},
        {"node_load": np.zeros((4, 6))},
        {"node_load": np.zeros((4, 3, 2))},
    ],
)
def test_a_wrong_shape_is_refused_with_both_right_ones(model: CompiledModel, arguments: Any) -> None:
    (name,) = arguments
    with pytest.raises(InvalidValueError, match="wrong shape") as caught:
        model.compute_batch("node_force", **arguments)
    assert caught.value.where == name
    assert "(n_batch, " in caught.value.allowed
    assert "shared" in caught.value.allowed


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (
            {"coordinate": FITS, "node_load": np.zeros((4, 2, 3))},
            "different batch lengths.*coordinate 3, node_load 4",
        ),
        ({"coordinate": FITS[0]}, "no argument has a batch axis"),
        ({"coordinate": [["a"] * 15]}, "not an array of numbers"),
        *(({"coordinate": FITS, "threads": n}, "not a number of threads") for n in (0, -1, 1.5, True, "2")),
        ({"coordinate": FITS, "on_error": "ignore"}, "raise, status"),
        ({"coordinates": FITS}, "did you mean 'coordinate'"),
        ({"quantity": "node_forces", "coordinate": FITS}, "did you mean 'node_force'"),
    ],
)
def test_what_makes_no_batch_is_refused(model: CompiledModel, arguments: Any, problem: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match=f"(?s){problem}"):
        model.compute_batch(arguments.pop("quantity", "node_force"), **arguments)


def test_a_double_is_not_rounded_for_a_single_library() -> None:
    with pytest.raises(InvalidValueError, match="would round"):
        loaded_prism("node_force", precision="single").compute_batch("node_force", coordinate=FITS)


def test_a_wrong_number_of_arguments_is_refused(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="wrong number of arguments"):
        model.function("node_force").batch(FITS)


def test_a_library_without_batch_functions_says_how_to_get_them() -> None:
    plain = load(prism(150.0, anchored={0: "xyz"}), "member_tension")
    with pytest.raises(LibraryError, match="no batch functions") as caught:
        plain.compute_batch("member_tension", coordinate=FITS)
    assert "batch_width = 8" in caught.value.hint
    assert 'for_="simulate_batch"' in caught.value.hint


# --- code for this machine -------------------------------------------------------------------------


NATIVE = ("member_length", "member_tension", "node_force")


def for_this_machine(family: str, *quantities: str) -> CompiledModel:
    """Functions for this machine, where estimates may stand in for square roots."""
    structure = prism(150.0, load={3: (0.0, 0.0, -1.0)})
    compiler = require_compiler(family)
    wanted = ModelRequest(quantities, batch_width=8)
    return build_library(structure, wanted, compiler=compiler.name, flags="native").load()


@pytest.fixture(scope="module", params=EACH_FAMILY)
def native(request: pytest.FixtureRequest) -> CompiledModel:
    return for_this_machine(request.param, *NATIVE)


@pytest.mark.thorough
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_native_batches_of_every_quantity_agree_with_single_calls(family: str) -> None:
    native = for_this_machine(family, *QUANTITIES, "member_length")
    for quantity in QUANTITIES:
        check_agreement(native, quantity)


@pytest.mark.parametrize("quantity", NATIVE)
def test_native_batches_agree_within_four_units_in_the_last_place(
    native: CompiledModel, quantity: str
) -> None:
    check_agreement(native, quantity)


def check_agreement(native: CompiledModel, quantity: str) -> None:
    coordinate = scattered(native, "coordinate", 500, 5)
    found = np.asarray(native.compute_batch(quantity, coordinate=coordinate))
    expected = one_by_one(native, quantity, 500, coordinate=coordinate)
    largest_term = 1e5 * native.compute("member_length").max()  # stiffness of the bars times length
    scale = {"member_length": 1.0, "acceleration": np.abs(expected).max()}.get(quantity, largest_term)
    assert np.abs(found - expected).max() <= 4 * np.spacing(scale)


@pytest.mark.parametrize("size", [1e-170, 1e-150, 1e-141, 1e-139, 1e-30, 1e30, 1e139, 1e141, 1e150, 1e170])
def test_native_roots_of_any_size_are_those_of_single_calls(native: CompiledModel, size: float) -> None:
    coordinate = scattered(native, "coordinate", 9) * size
    coordinate[3] = native.nominal("coordinate")
    found, status = native.compute_batch("member_length", coordinate=coordinate, on_error="status")
    for k in range(9):
        try:
            expected = native.compute("member_length", coordinate=coordinate[k])
        except NonFiniteError:
            assert status[k] == 2
            assert np.isnan(found[k]).all()
        else:
            assert status[k] == 0
            np.testing.assert_array_equal(found[k], expected)


def test_native_zero_lengths_are_those_of_single_calls(native: CompiledModel) -> None:
    coordinate = scattered(native, "coordinate", 9)
    coordinate[4] = 0.0
    found = native.compute_batch("member_length", coordinate=coordinate)
    assert not found[4].any()
    result, status = native.compute_batch("node_force", coordinate=coordinate, on_error="status")
    assert np.flatnonzero(status).tolist() == [4]
    assert status[4] == 2
    assert np.isnan(result[4]).all()
