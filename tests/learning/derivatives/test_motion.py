"""Motions through contacts as functions with derivatives, without JAX and PyTorch."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.learning.derivatives.motion import MotionFunction
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.gradient import OBSERVED, START
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
)
from tests.codegen.quickly import without_optimisation
from tests.learning.derivatives.products import check_products, draw_points
from tests.models import EXAMPLES

T_END = 0.25  # [s], in which two corners strike the ground, slide and stick


def test_derivatives_through_contacts_are_those_of_differences(motions: CompiledModel) -> None:
    outputs = (*START, *OBSERVED)
    function = MotionFunction(motions, T_END, samples=3, rtol=1e-10, outputs=outputs, threads=2)
    assert {*function.inputs} == {*START, "rest_length", "damping", "node_load", "ground", "input"}
    values = draw_points(function, (2,), shared=("ground", "damping", "input"))
    check_products(function, values, rtol=1e-4)
    alone = MotionFunction(motions, T_END, samples=3, rtol=1e-10, outputs=outputs)
    weights = {name: np.ones((2, *shape)) for name, shape in function.outputs.items()}
    for name, gradient in alone.pull(values, weights).items():
        np.testing.assert_array_equal(gradient, function.pull(values, weights)[name], err_msg=name)


def test_knots_of_a_profile_are_arguments(motions: CompiledModel) -> None:
    schedule = Profile([0.0, 0.1, T_END], {"winch": [0.0, -0.01, -0.02]})
    options: dict[str, Any] = {"outputs": ("node_position", "member_tension"), "schedule": schedule}
    function = MotionFunction(motions, T_END, rtol=1e-10, **options)
    assert function.inputs["winch"] == (3,)
    assert "input" not in function.inputs
    values = {"winch": np.array([[0.0, -0.01, -0.03], [0.01, 0.0, 0.0]]), "rest_length": np.array([0.56])}
    check_products(function, values, rtol=1e-4)
    check_products(function, {"winch": values["winch"][0]}, rtol=1e-4)


def test_a_motion_that_fails_raises_or_is_not_a_number(motions: CompiledModel) -> None:
    values = {"rest_length": np.array([[0.55], [-0.1], [0.56]])}
    weights = {"coordinate": np.ones((3, 2, 6)), "velocity": np.ones((3, 2, 6))}
    with pytest.raises(InvalidValueError, match="above 0"):
        MotionFunction(motions, T_END).evaluate(values)
    function = MotionFunction(motions, T_END, on_error="nan")
    for found in (function.evaluate(values)["velocity"], function.pull(values, weights)["rest_length"]):
        assert np.isnan(found).reshape(3, -1).all(axis=1).tolist() == [False, True, False]
        assert np.isfinite(found[[0, 2]]).all()
    start = np.where([[False], [True]], np.nan, motions.nominal("coordinate"))  # an output too
    found = function.pull({"coordinate": start}, {"coordinate": np.ones((2, 2, 6))})["coordinate"]
    assert np.isnan(found).tolist() == [[False] * 6, [True] * 6]
    for bad, error in ((1e100, ConvergenceError), (np.nan, NonFiniteError)):
        start = {"velocity": np.array([0.0, -bad, 0.0, bad, 0.0, 0.0])}
        assert np.isnan(function.evaluate(start)["coordinate"]).all()
        with pytest.raises(error):
            MotionFunction(motions, T_END).evaluate(start)


def test_a_derivative_that_is_another_backward_than_forward_is_refused(
    motions: CompiledModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    forward = MotionFunction._differentiate

    def wrong(self: MotionFunction, *given: Any) -> Any:
        return {name: 2.0 * array for name, array in forward(self, *given).items()}

    monkeypatch.setattr(MotionFunction, "_differentiate", wrong)
    values, weights = {"rest_length": np.array([0.55])}, {"coordinate": np.ones((2, 6))}
    function = MotionFunction(motions, T_END, outputs=("coordinate",))
    with pytest.raises(ConvergenceError, match="means nothing"):
        function.pull(values, weights)
    function.on_error = "nan"
    assert np.isnan(function.pull(values, weights)["rest_length"]).all()


@pytest.mark.parametrize("output", ["coordinate", "velocity", "node_velocity"])
@pytest.mark.parametrize("t_end", [0.05, 0.5])
def test_a_derivative_that_is_zero_but_for_rounding_is_no_error(
    motions: CompiledModel, monkeypatch: pytest.MonkeyPatch, output: str, t_end: float
) -> None:
    """The centre of mass of what flies does not know of forces between its nodes."""
    function = MotionFunction(motions, t_end, outputs=(output,))
    above = {"coordinate": motions.nominal("coordinate") + 5.0 * np.array([0.0, 1.0] * 3)}
    numbers = {name: motions.nominal(name) for name in ("rest_length", "damping", "input")}
    centre, one = np.zeros((2, *function.outputs[output]))
    mass = np.array([0.3, 0.3, 0.4])
    if output == "node_velocity":
        centre[1, :, 2], one[1, 0, 2] = mass, 1.0
    else:
        centre[1, 1::2], one[1, 1] = mass, 1.0
    found = function.pull(above | numbers, {output: centre})
    for name in numbers:
        np.testing.assert_allclose(found[name], 0.0, atol=1e-12, err_msg=name)
    expected = np.array([0.0, 1.0] * 3) * np.repeat(mass, 2) * (output == "coordinate")
    np.testing.assert_allclose(found["coordinate"], expected, atol=1e-12)
    # The height of one node does, and a wrong derivative of it is refused.
    assert np.abs(function.pull(above | numbers, {output: one})["rest_length"]).max() > 1e-3
    forward = MotionFunction._differentiate
    monkeypatch.setattr(
        MotionFunction,
        "_differentiate",
        lambda *given: {name: 10.0 * array for name, array in forward(*given).items()},
    )
    with pytest.raises(ConvergenceError, match="means nothing"):
        function.pull(above | numbers, {output: one})


def test_what_a_library_lacks_is_named_with_what_to_compile(motions: CompiledModel) -> None:
    with without_optimisation():
        other = compile_scene(EXAMPLES / "two_nodes.toml", for_="simulate")
    with pytest.raises(FormulationError, match="motion_derivatives"):
        MotionFunction(other, 0.1)
    with pytest.raises(UnknownNameError, match="node_position"):
        MotionFunction(motions, 0.1, outputs=("node_positions",))
    with pytest.raises(InvalidValueError, match="samples"):
        MotionFunction(motions, 0.1, samples=1)
    for method in ("auto", "rodas", "rk4", "tsit5"):
        with pytest.raises(UnknownNameError, match=r"motion_derivatives(.|\n)*allowed: rk853"):
            MotionFunction(motions, 0.1, method=method)


def test_outputs_are_one_name_or_more_and_may_be_empty() -> None:
    with without_optimisation():
        model = compile_scene(EXAMPLES / "two_nodes.toml", for_="motion_derivatives")
    function = MotionFunction(model, 0.1, outputs="coordinate")
    assert [*function.outputs] == ["coordinate"]
    with pytest.raises(InvalidValueError, match="list of names"):
        MotionFunction(model, 0.1, outputs=3)  # type: ignore[arg-type]
    values, weights = {"coordinate": model.nominal("coordinate")}, {"coordinate": np.ones((2, 3))}
    expected = function.pull(values, weights)["coordinate"]
    function = MotionFunction(model, 0.1, outputs=("coordinate", "internal"))  # a scene without these
    assert function.evaluate(values)["internal"].shape == (2, 0)
    found = function.pull(values, weights | {"internal": np.zeros((2, 0))})["coordinate"]
    np.testing.assert_array_equal(found, expected)
