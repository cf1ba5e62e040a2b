"""Functions of JAX: values, transformations, derivatives by its own checks, refusals."""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.learning.derivatives import to_jax as module
from tensegrity_codegen.learning.derivatives.motion import MotionFunction
from tensegrity_codegen.learning.derivatives.quantity import QuantityFunction
from tensegrity_codegen.learning.derivatives.to_jax import to_jax, to_jax_motion
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, MissingExtraError
from tests.learning.derivatives.products import REFUSED
from tests.learning.derivatives.test_motion import T_END

BOTH = ("fwd", "rev")


@pytest.fixture
def jax() -> Iterator[Any]:
    jax = pytest.importorskip("jax", reason="needs the package jax")
    jax.config.update("jax_enable_x64", True)
    yield jax
    jax.config.update("jax_enable_x64", False)


@pytest.fixture(params=["C", "Python"])
def called(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """XLA calls the library, or Python where there is no compiler."""
    if request.param == "Python":
        monkeypatch.setattr(module, "register_call", lambda: None)
    return str(request.param)


@pytest.fixture
def states(quantities: CompiledModel) -> tuple[Any, Any]:
    draw = np.random.default_rng(0)
    return tuple(
        quantities.nominal(name) + 1e-2 * draw.normal(size=(300, 6)) for name in ("coordinate", "velocity")
    )


@pytest.mark.peers
def test_values_are_those_of_the_library(
    jax: Any, called: str, quantities: CompiledModel, states: tuple[Any, Any]
) -> None:
    acceleration, (q, v) = to_jax(quantities, "acceleration"), states
    expected = quantities.compute_batch("acceleration", coordinate=q, velocity=v, rest_length=[0.56])
    length = np.array([0.56])
    each = jax.vmap(lambda q, v: acceleration(q, v, rest_length=length))
    for found in (each(q, v), jax.jit(each)(q, v), jax.jit(acceleration)(q, v, rest_length=length)):
        np.testing.assert_array_equal(found, expected)
    nested = jax.vmap(jax.vmap(acceleration, (0, None)), (None, 0))(q[:3], v[:2])
    pairs = [[quantities.compute("acceleration", coordinate=a, velocity=b) for a in q[:3]] for b in v[:2]]
    np.testing.assert_array_equal(nested, pairs)
    np.testing.assert_array_equal(acceleration(), quantities.compute("acceleration"))
    energy = jax.jit(to_jax(quantities, "total_energy"))(q[0])
    assert float(energy) == quantities.compute("total_energy", coordinate=q[0])


@pytest.mark.peers
def test_steps_in_a_loop_of_jax_are_those_of_the_library(
    jax: Any, called: str, quantities: CompiledModel, states: tuple[Any, Any]
) -> None:
    acceleration = to_jax(quantities, "acceleration")

    def advance(state: tuple[Any, Any], _: Any) -> tuple[tuple[Any, Any], Any]:
        q, v = state
        v = v + 2.0**-10 * acceleration(q, v)
        return (q + 2.0**-10 * v, v), q

    q, v = (array[0] for array in states)
    found, _ = jax.jit(lambda q, v: jax.lax.scan(advance, (q, v), None, length=20))(q, v)[0]
    gradient = jax.jit(jax.grad(lambda q: jax.lax.scan(advance, (q, v), None, length=20)[0][0].sum()))(q)
    assert np.isfinite(gradient).all()
    for _ in range(20):
        v = v + 2.0**-10 * quantities.compute("acceleration", coordinate=q, velocity=v)
        q = q + 2.0**-10 * v
    np.testing.assert_allclose(found, q, rtol=1e-13)


@pytest.mark.peers
@pytest.mark.parametrize("quantity", ["acceleration", "member_tension"])
def test_derivatives_of_quantities_pass_the_checks_of_jax(
    jax: Any, called: str, quantities: CompiledModel, states: tuple[Any, Any], quantity: str
) -> None:
    from jax.test_util import check_grads

    function, (q, v) = to_jax(quantities, quantity), states
    numbers = (np.array([0.55]), np.array([0.01]))

    def compute(q: Any, v: Any, length: Any, winch: Any) -> Any:
        return function(q, v, rest_length=length, input=winch)

    tolerance = {"order": 1, "modes": BOTH, "eps": 1e-6, "rtol": 1e-6, "atol": 1e-5}
    check_grads(compute, (q[0], v[0], *numbers), **tolerance)
    check_grads(jax.jit(jax.vmap(compute, (0, 0, None, None))), (q[:3], v[:3], *numbers), **tolerance)
    # Shared numbers have the sum of the gradients of all; rows and columns of a Jacobian are the same.
    loss = jax.grad(lambda length: (jax.vmap(lambda q: function(q, rest_length=length))(q[:3]) ** 2).sum())
    one = jax.grad(lambda length, q: (function(q, rest_length=length) ** 2).sum())
    np.testing.assert_allclose(loss(numbers[0]), sum(one(numbers[0], row) for row in q[:3]), rtol=1e-12)
    forward, backward = jax.jacfwd(function)(q[0]), jax.jit(jax.jacrev(function))(q[0])
    np.testing.assert_allclose(forward, backward, rtol=1e-12, atol=1e-9)


@pytest.mark.peers
def test_motions_through_contacts_pass_the_checks_of_jax(jax: Any, motions: CompiledModel) -> None:
    """Steps of differences at 1e-6 with a relative tolerance of steps of 1e-10 know 5 digits."""
    from jax.test_util import check_grads

    tolerance = {"order": 1, "modes": BOTH, "eps": 1e-6, "rtol": 1e-4, "atol": 1e-4}
    outputs = ("coordinate", "node_velocity", "member_tension")
    drop = to_jax_motion(motions, T_END, samples=3, rtol=1e-10, outputs=outputs)
    ground = motions.nominal("ground")

    def observe(q: Any, v: Any, length: Any, winch: Any, part: Any) -> Any:
        found = drop(q, v, rest_length=length, input=winch, ground=ground * part)
        return found["coordinate"], found["node_velocity"], found["member_tension"] / 100.0

    start = (motions.nominal("coordinate"), motions.nominal("velocity"))
    check_grads(observe, (*start, np.array([0.55]), np.array([0.01]), np.ones(5)), **tolerance)
    schedule = Profile([0.0, 0.1, T_END], {"winch": [0.0, -0.01, -0.02]})
    drive = to_jax_motion(motions, T_END, rtol=1e-10, schedule=schedule)
    check_grads(lambda knots: drive(winch=knots)["velocity"], (np.array([0.0, -0.01, -0.02]),), **tolerance)


@pytest.mark.peers
def test_many_motions_are_one_call(jax: Any, motions: CompiledModel, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    compute = MotionFunction.call

    def count(self: MotionFunction, way: str, *given: Any) -> Any:
        calls.append(way)
        return compute(self, way, *given)

    monkeypatch.setattr(MotionFunction, "call", count)
    drop = to_jax_motion(motions, 0.05, outputs=("coordinate",), threads=2)
    starts = motions.nominal("coordinate") + np.array([0.0, 0.1] * 3) * np.linspace(0.0, 1.0, 8)[:, None]
    loss = jax.jit(jax.vmap(jax.value_and_grad(lambda q: drop(q)["coordinate"][-1].sum())))
    values, gradients = loss(starts)
    assert calls == ["evaluate", "pull"]
    for k in (0, 7):
        value, gradient = jax.value_and_grad(lambda q: drop(q)["coordinate"][-1].sum())(starts[k])
        assert float(value) == float(values[k])
        np.testing.assert_array_equal(gradient, gradients[k])


@pytest.mark.peers
def test_what_fails_raises_or_is_not_a_number(
    jax: Any, called: str, quantities: CompiledModel, states: tuple[Any, Any]
) -> None:
    q = states[0][:5].copy()
    q[3, 0] = np.nan
    with pytest.raises(Exception, match=r"not finite"):
        jax.jit(jax.vmap(to_jax(quantities, "acceleration")))(q).block_until_ready()
    function = to_jax(quantities, "acceleration", on_error="nan")
    found = jax.vmap(function)(q)
    gradient = jax.vmap(jax.grad(lambda q: function(q).sum()))(q)
    for array in (found, gradient):
        assert np.isnan(array).any(axis=1).tolist() == [False, False, False, True, False]


@pytest.mark.peers
def test_second_derivatives_and_single_precision_are_refused_by_name(
    jax: Any, quantities: CompiledModel, states: tuple[Any, Any]
) -> None:
    function, q = to_jax(quantities, "acceleration"), states[0][0]
    with pytest.raises(FormulationError, match="no second derivatives"):
        jax.hessian(lambda q: function(q).sum())(q)
    rounded = to_jax(quantities, "acceleration", dtype="float32")
    exact = np.asarray(function(q))
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(InvalidValueError, match="jax_enable_x64"):
        function(q)
    found = jax.jit(jax.vmap(rounded))(states[0][:2])
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[0], exact, rtol=1e-4, atol=1e-2)
    assert jax.grad(lambda q: rounded(q).sum())(np.float32(q)).dtype == np.float32


@pytest.mark.peers
def test_a_motion_that_fails_has_no_gradient_and_others_have(jax: Any, motions: CompiledModel) -> None:
    drop, q = to_jax_motion(motions, 0.05, outputs="coordinate", on_error="nan"), np.zeros((2, 6))
    q[:] = motions.nominal("coordinate"), np.full(6, np.nan)
    gradient = jax.grad(lambda q: drop(q)["coordinate"].sum())
    assert np.isnan(jax.vmap(gradient)(q)).tolist() == [[False] * 6, [True] * 6]
    assert np.isnan(gradient(q[1])).all()


@pytest.mark.peers
def test_arguments_that_are_no_real_numbers_of_this_shape_are_refused(
    jax: Any, quantities: CompiledModel, motions: CompiledModel
) -> None:
    for function in (to_jax(quantities, "acceleration"), to_jax_motion(motions, 0.05)):
        for arguments, problem in (*REFUSED, ({"coordinate": jax.numpy.ones(6) * 1j}, "real numbers")):
            with pytest.raises(InvalidValueError, match=problem):
                function(**arguments)
    kept = to_jax(quantities, "acceleration", dtype="float32")(input=jax.numpy.zeros(1, "bfloat16"))
    np.testing.assert_allclose(kept, quantities.compute("acceleration", input=[0.0]), rtol=1e-5, atol=1e-4)
    with pytest.raises(InvalidValueError, match="list of names"):
        to_jax_motion(motions, 0.05, outputs=3)  # type: ignore[arg-type]


def test_the_package_is_named_where_it_is_missing(
    quantities: CompiledModel, motions: CompiledModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingExtraError, match="pip install jax"):
        to_jax(quantities, "acceleration")
    with pytest.raises(MissingExtraError, match="pip install jax"):
        to_jax_motion(motions, 0.1)
    assert QuantityFunction(quantities, "acceleration").evaluate({})
