"""The compiled library against CasADi's virtual machine, bit for bit, and against plain NumPy."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.manifest import STATUS
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import draws, thorough
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.subjects import all_parameters, bare, everything, offered
from tests.comparison import dense, run_in_casadi
from tests.random_structures import structures
from tests.reference import ReferenceModel

SLOW = draws(4)


def build(structure: Structure, request: ModelRequest) -> CompiledModel:
    return build_library(structure, request).load()


def arguments_near(model: CompiledModel, seed: int) -> dict[str, np.ndarray]:
    """Return arguments a little off the nominal ones."""
    rng = np.random.default_rng(seed)
    found = {}
    for spec in model.manifest.arguments:
        nominal = model.nominal(spec.name)
        found[spec.name] = nominal + 1e-4 * rng.uniform(-1, 1, nominal.shape) * np.maximum(
            np.abs(nominal), 0.1
        )
    return found


def assert_same_bits(found: Any, expected: np.ndarray, what: str) -> None:
    np.testing.assert_array_equal(dense(found).reshape(expected.shape), expected, err_msg=what)


@pytest.mark.thorough
@given(structures(most_nodes=6), st.booleans(), st.integers(0, 2**32 - 1))
@SLOW
def test_random_structures_equal_the_virtual_machine_and_numpy(
    structure: Structure, changeable: bool, seed: int
) -> None:
    parameters = all_parameters(structure) if changeable else {}
    functions = offered(structure, ModelRequest((), parameters=parameters))
    model = build(structure, ModelRequest(tuple(functions), parameters=parameters))
    reference = ReferenceModel(structure, parameters)
    arguments = arguments_near(model, seed)
    for name, function in functions.items():
        assert model.function(name).arguments == function.arguments
        found = model.compute(name, **arguments)
        assert_same_bits(found, run_in_casadi(function, arguments), name)
        expected = dense(reference.compute(name, **arguments))
        np.testing.assert_allclose(
            dense(found), expected, rtol=0, atol=1e-12 * np.abs(expected).max(), err_msg=name
        )


@pytest.fixture(scope="module")
def full() -> CompiledModel:
    return build(*everything())


@pytest.fixture(scope="module")
def small() -> CompiledModel:
    return build(*bare())


@pytest.mark.optimised
@pytest.mark.parametrize("family", EACH_FAMILY)
@pytest.mark.parametrize("subject", [bare, *thorough(everything)], ids=["bare", "everything"])
def test_the_two_subjects_equal_the_virtual_machine(subject: Any, family: str) -> None:
    require_compiler(family)
    structure, request = subject()
    if family != "gcc":  # whose library is there already
        request = replace(request, integrators=())
    functions = offered(structure, request)
    model = build_library(structure, request, compiler=family).load()
    for seed in range(5):
        arguments = arguments_near(model, seed)
        for name in request.quantities:
            assert_same_bits(
                model.compute(name, **arguments), run_in_casadi(functions[name], arguments), name
            )


def test_what_has_every_feature_equals_the_virtual_machine_without_optimisation(full: CompiledModel) -> None:
    functions, arguments = offered(*everything()), arguments_near(full, 0)
    for name in full.quantities:
        assert_same_bits(full.compute(name, **arguments), run_in_casadi(functions[name], arguments), name)


def test_at_the_scene_s_own_values_the_matrix_pattern_is_that_of_the_manifest(full: CompiledModel) -> None:
    for spec in full.manifest.functions:
        if spec.pattern is not None:
            found = full.compute(spec.quantity)
            assert found.indices.tolist() == spec.pattern.row.tolist()
            assert found.indptr.tolist() == spec.pattern.column_start.tolist()
            assert found.shape == spec.shape


def raw_call(model: CompiledModel, quantity: str, **changes: np.ndarray | None) -> tuple[str, np.ndarray]:
    """Call the C function itself, None as a null pointer; return the status word and what was written."""
    function, ffi = model.function(quantity), model.library.ffi
    size = len(function.spec.pattern.row) if function.spec.pattern else int(np.prod(function.spec.shape))
    result = np.full(size, 123.0)
    arrays = [changes.get(name, model.nominal(name)) for name in function.arguments]
    pointers = [ffi.NULL if a is None else ffi.from_buffer("double[]", a) for a in arrays]
    out = ffi.NULL if "out" in changes else ffi.from_buffer("double[]", result)
    status = model.library.symbol(function.spec.symbol)(*pointers, out)
    return STATUS[status], result


def every_argument(model: CompiledModel) -> list[tuple[str, str]]:
    return [(spec.quantity, name) for spec in model.manifest.functions for name in spec.arguments]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf], ids=str)
def test_every_non_finite_entry_is_reported_and_gives_nan(full: CompiledModel, value: float) -> None:
    for quantity, name in every_argument(full):
        nominal = full.nominal(name)
        for entry in {0, nominal.size - 1}:
            changed = nominal.copy()
            changed.flat[entry] = value
            status, result = raw_call(full, quantity, **{name: changed})
            assert status == "non_finite_input", (quantity, name)
            assert np.isnan(result).all(), (quantity, name)


def test_every_null_pointer_is_reported_and_nothing_is_written(full: CompiledModel) -> None:
    for quantity, name in every_argument(full):
        status, result = raw_call(full, quantity, **{name: None})
        assert status == "null_pointer"
        assert (result == 123.0).all()
    for spec in full.manifest.functions:
        assert raw_call(full, spec.quantity, out=None)[0] == "null_pointer"


def test_an_overflow_is_reported_and_gives_nan(full: CompiledModel) -> None:
    status, result = raw_call(full, "member_length", coordinate=np.full(8, 1e300))
    assert status == "non_finite_result"
    assert np.isnan(result).all()


def test_coincident_nodes_are_reported_and_give_nan(small: CompiledModel) -> None:
    status, result = raw_call(small, "acceleration", coordinate=np.zeros(6))
    assert status == "non_finite_result"
    assert np.isnan(result).all()
    assert raw_call(small, "member_tension", coordinate=np.zeros(6))[0] == "ok"


def test_python_names_the_argument_and_the_entry(full: CompiledModel) -> None:
    load = full.nominal("node_load")
    load[2, 1] = np.nan
    with pytest.raises(NonFiniteError, match=r"argument 'node_load' is not finite at \(2, 1\)"):
        full.compute("acceleration", node_load=load)


def test_python_says_what_may_make_a_result_not_finite(small: CompiledModel) -> None:
    with pytest.raises(NonFiniteError) as caught:
        small.compute("acceleration", coordinate=np.zeros(6))
    assert "coincide" in caught.value.hint


def test_four_threads_share_one_library(full: CompiledModel) -> None:
    inputs = [arguments_near(full, seed) for seed in range(200)]
    names = ("acceleration", "state_jacobian", "total_energy")

    def work(arguments: dict[str, np.ndarray]) -> list[np.ndarray]:
        return [dense(full.compute(name, **arguments)) for name in names]

    alone = [work(arguments) for arguments in inputs]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(work, inputs))
    for one, other in zip(alone, together, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
