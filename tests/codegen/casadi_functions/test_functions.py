"""The same library as CasADi functions, by casadi.external."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.subjects import bare, everything
from tests.comparison import dense


@pytest.fixture(scope="module", params=[bare, *thorough(everything)], ids=["bare", "everything"])
def subject(request: pytest.FixtureRequest) -> tuple[CompiledModel, dict[str, PrunedFunction]]:
    structure, wanted = request.param()
    wanted = replace(wanted, interfaces=("casadi",))
    functions = prune(build_model(structure, wanted), wanted.quantities)
    model = build_library(structure, wanted).load()
    return model, {function.quantity.name: function for function in functions}


def test_the_interface_is_there_on_request_only() -> None:
    structure, request = bare()
    quantity, name = request.quantities[0], structure.name
    with_it = emit(structure, replace(request, interfaces=("casadi",)))
    without = emit(structure, request)
    for made, expected in ((with_it, True), (without, False)):
        assert (f"{name}_{quantity}_sparsity_out(" in made.files[f"{name}.c"]) is expected
        (part,) = [part for part in made.manifest.parts if part.name == "casadi_interface"]
        assert part.is_included is expected
        assert made.manifest.interfaces == (("casadi",) if expected else ())


def test_single_precision_has_no_interface() -> None:
    structure, request = bare()
    with pytest.raises(FormulationError, match="interfaces need double precision") as caught:
        emit(structure, replace(request, interfaces=("casadi",), precision="single"))
    assert caught.value.where == f"{structure.name}: model.interfaces"


def test_an_unknown_interface_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown interface") as caught:
        ModelRequest((), interfaces=("casad",))
    assert caught.value.allowed == "casadi, casadi_hessian, acados"
    assert "casadi" in caught.value.hint


def external(model: CompiledModel, quantity: str) -> Any:
    return ca.external(f"{model.manifest.name}_{quantity}", str(model.path))


def test_names_and_sparsities_are_those_of_the_manifest(subject: Any) -> None:
    model, functions = subject
    for spec in model.manifest.functions:
        found, own = external(model, spec.quantity), functions[spec.quantity].function
        assert tuple(found.name_in()) == spec.arguments
        assert found.name_out() == [spec.quantity]
        assert [found.sparsity_in(k) for k in range(found.n_in())] == [
            own.sparsity_in(k) for k in range(own.n_in())
        ]
        assert found.sparsity_out(0) == own.sparsity_out(0)
        if spec.pattern is not None:
            assert list(found.sparsity_out(0).row()) == spec.pattern.row.tolist()


def test_values_are_those_of_the_c_interface_to_the_last_bit(subject: Any) -> None:
    model, _ = subject
    for spec in model.manifest.functions:
        arguments = [ca.DM(np.atleast_1d(model.nominal(name)).T) for name in spec.arguments]
        (found,) = external(model, spec.quantity).call(arguments)
        expected = dense(model.compute(spec.quantity))
        values = np.array(ca.densify(found))
        values = values if spec.pattern is not None else values.T.reshape(expected.shape)
        np.testing.assert_array_equal(values, expected, err_msg=spec.quantity)


def test_a_null_pointer_counts_as_zeros(subject: Any) -> None:
    """CasADi passes NULL for an argument of zeros; an unset argument of a buffer is one."""
    model, _ = subject
    function = external(model, "member_tension")
    missing = "velocity" if "velocity" in function.name_in() else "coordinate"
    buffer, evaluate = function.buffer()
    nominal = {name: model.nominal(name) for name in function.name_in()}
    for index, name in enumerate(function.name_in()):
        if name != missing:
            buffer.set_arg(index, memoryview(nominal[name]))
    result = np.empty(len(model.manifest.member_name))
    buffer.set_res(0, memoryview(result))
    evaluate()
    expected = model.compute("member_tension", **{missing: np.zeros_like(nominal[missing])})
    np.testing.assert_array_equal(result, expected)
    assert not np.array_equal(result, model.compute("member_tension"))


def test_a_result_that_nobody_wants_is_not_written(subject: Any) -> None:
    model, _ = subject
    buffer, evaluate = external(model, "member_tension").buffer()
    evaluate()
    assert buffer.ret() == 0


def test_a_bad_argument_stops_casadi(subject: Any) -> None:
    model, _ = subject
    function = external(model, "member_tension")
    arguments = [ca.DM(model.nominal(name).T) for name in function.name_in()]
    with pytest.raises(RuntimeError):
        function(ca.DM(arguments[0]) * np.nan, *arguments[1:])


def test_an_external_function_takes_part_in_expressions(subject: Any) -> None:
    model, _ = subject
    function = external(model, "member_tension")
    symbols = [ca.MX.sym(name, *function.size_in(k)) for k, name in enumerate(function.name_in())]
    whole = ca.Function("sum", symbols, [ca.sum1(function(*symbols))])
    values = [ca.DM(model.nominal(name).T) for name in function.name_in()]
    assert float(whole(*values)) == pytest.approx(model.compute("member_tension").sum(), rel=1e-14)
