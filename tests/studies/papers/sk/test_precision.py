"""Expressions in other precisions, against CasADi's own evaluation in double precision."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from tensegrity_codegen.codegen.prune import PrunedFunction, prune
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.precision import evaluate_in
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.quantities import find_quantity
from tensegrity_codegen.tables.request import ModelRequest
from tests.comparison import run_in_casadi
from tests.random_structures import structures


@given(structures(most_nodes=8))
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
def test_double_is_bit_equal_and_single_and_extended_are_near(structure: Structure) -> None:
    model = build_model(structure, ModelRequest(()))
    (function,) = prune(model, ("member_tension",))
    arguments = {name: model.arguments[name].nominal for name in function.arguments}
    expected = run_in_casadi(function, arguments)
    np.testing.assert_array_equal(evaluate_in(np.float64, function, arguments), expected)
    single = evaluate_in(np.float32, function, arguments)
    assert single.dtype == np.float32
    scale = (structure.spring_constant + structure.axial_stiffness / structure.rest_length).max()
    np.testing.assert_allclose(single, expected, rtol=0, atol=3e-5 * max(scale, np.abs(expected).max()))
    more = evaluate_in(np.longdouble, function, arguments)
    np.testing.assert_allclose(more.astype(float), expected, rtol=0, atol=1e-12 * scale)


def test_an_unknown_operation_is_refused() -> None:
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x], [ca.sin(x)], ["coordinate"], ["y"])
    pruned = PrunedFunction(find_quantity("member_length"), function, ("coordinate",))
    with pytest.raises(FormulationError, match="no meaning in other precisions"):
        evaluate_in(np.float32, pruned, {"coordinate": np.ones(2)})
