"""Inputs by their own names, wherever run-time arguments are taken."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import (
    analyse,
    compile_scene,
    equilibrium_sensitivity,
    find_equilibria,
    stand,
)
from tensegrity_codegen.runtime.linear.linearize import LINEARIZE_QUANTITIES, linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.models import load
from tests.runtime.build import make_structure, spring

INPUTS = (ActuatedInput("motor", "rest_length", (0,)), ActuatedInput("push", "force", (1,), (1.0, 0.0, 0.0)))
QUANTITIES = (
    *SIMULATION_QUANTITIES, *EQUILIBRIUM_QUANTITIES, *LINEARIZE_QUANTITIES, "input_jacobian",
)  # fmt: skip


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz", 1: "yz"})
    structure = structure.with_changes(inputs=INPUTS)
    quantities = tuple(dict.fromkeys(QUANTITIES))
    return load(structure, *quantities, integrators=("rk853",), batch_width=8)


def array(**values: float) -> dict[str, Any]:
    return {"input": np.array([values.get("motor", 0.0), values.get("push", 0.0)])}


@pytest.mark.parametrize("named", [{"motor": 0.01}, {"push": 2.0}, {"motor": 0.01, "push": -1.0}])
def test_names_say_what_the_array_says(model: CompiledModel, named: dict[str, float]) -> None:
    whole = array(**named)
    assert model.compute("member_tension", **named) == model.compute("member_tension", **whole)
    by_name, by_array = (simulate(model, 0.5, samples=6, arguments=given) for given in (named, whole))
    np.testing.assert_array_equal(by_name.coordinate, by_array.coordinate)
    assert by_name.coordinate[-1, 0] != 1.0
    settled = [find_equilibrium(model, arguments=given).coordinate for given in (named, whole)]
    np.testing.assert_array_equal(*settled)
    expected = 1.0 + named.get("motor", 0.0) + named.get("push", 0.0) / 100.0
    assert settled[0][0] == pytest.approx(expected)
    linear = [linearize(model, arguments=given) for given in (named, whole)]
    np.testing.assert_array_equal(linear[0].input, whole["input"])
    np.testing.assert_array_equal(linear[0].c, linear[1].c)


def test_batches_take_a_number_or_a_row_for_each_motion(model: CompiledModel) -> None:
    motor = np.array([0.0, 0.01, 0.02])
    rows = np.stack([motor, np.full(3, 2.0)], axis=1)
    named = {"motor": motor, "push": 2.0}
    found = model.compute_batch("acceleration", **named)
    np.testing.assert_array_equal(found, model.compute_batch("acceleration", input=rows))
    by_name = simulate_batch(model, 0.2, samples=3, arguments=named)
    by_array = simulate_batch(model, 0.2, samples=3, arguments={"input": rows})
    np.testing.assert_array_equal(by_name.coordinate, by_array.coordinate)


def test_a_schedule_names_inputs_and_leaves_the_others(model: CompiledModel) -> None:
    by_name = simulate(
        model, 0.5, samples=6, arguments={"push": 2.0}, schedule=lambda t: {"motor": 0.01 * np.sin(t)}
    )
    by_array = simulate(model, 0.5, samples=6, schedule=lambda t: array(motor=0.01 * np.sin(t), push=2.0))
    np.testing.assert_array_equal(by_name.coordinate, by_array.coordinate)


def test_an_input_given_twice_or_as_no_number_is_refused(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="twice"):
        simulate(model, 0.5, arguments={"motor": 0.01, "input": [0.0, 0.0]})
    with pytest.raises(InvalidValueError, match="twice"):
        linearize(model, input=[0.0, 0.0], arguments={"motor": 0.01})
    for value in ("fast", [0.0, 1.0], None):
        with pytest.raises(InvalidValueError) as caught:
            model.compute("member_tension", motor=value)
        assert "motor" in caught.value.where


def hint(model: CompiledModel, name: str) -> str:
    with pytest.raises(UnknownNameError) as caught:
        simulate(model, 0.5, arguments={name: 0.0})
    assert "motor" in str(caught.value.allowed)
    return caught.value.hint


def test_hints_fit_what_is_wrong(model: CompiledModel) -> None:
    assert "motor" in hint(model, "moter")
    assert "[parameters]" not in hint(model, "moter")
    assert "[parameters]" in hint(model, "rest_length")
    assert "coordinate=" in hint(model, "velocity")
    with pytest.raises(UnknownNameError, match="motor"):
        model.compute("member_tension", moter=0.0)


PLACES = {"left": [0, 0], "right": [1, 0], "top": [0.5, 1]}
ENDS = {"base": ["left", "right"], "west": ["left", "top"], "east": ["right", "top"]}
FRAME: dict[str, Any] = {
    "name": "frame",
    "axes": "xz",
    "gravity": [0, -9.81],
    "nodes": {name: {"position": place, "mass": 1.0} for name, place in PLACES.items()},
    "members": {name: {"kind": "bar", "spring_constant": 1e4, "nodes": ends} for name, ends in ENDS.items()},
    "ground": {"stiffness": 1e5, "friction": 0.5},
}
DOORS: dict[str, Callable[[CompiledModel, dict[str, Any]], Any]] = {
    "simulate": lambda model, given: simulate(model, 0.1, arguments=given),
    "simulate_batch": lambda model, given: simulate_batch(model, 0.1, arguments=given),
    "find_equilibrium": lambda model, given: find_equilibrium(model, arguments=given),
    "find_equilibria": lambda model, given: find_equilibria(model, arguments=given),
    "sensitivity": lambda model, given: equilibrium_sensitivity(model, arguments=given),
    "linearize": lambda model, given: linearize(model, arguments=given),
    "analyse": lambda model, given: analyse(model, arguments=given),
    "stand": lambda model, given: stand(model, arguments=given),
    "compute": lambda model, given: model.compute("member_tension", **given),
    "compute_batch": lambda model, given: model.compute_batch("member_tension", **given),
}


@pytest.fixture(scope="module")
def frame() -> CompiledModel:
    """A library of constants."""
    return compile_scene(FRAME, for_=("simulate", "sensitivity", "linearize", "analyse"))


@pytest.mark.parametrize("door", DOORS)
def test_no_function_ignores_an_argument(frame: CompiledModel, door: str) -> None:
    lengths, mass = np.full(3, 2.0), np.full(3, 9.0)
    for given in ({"rest_length": lengths}, {"node_mass": mass}, {"rest_length": {"any": "thing"}}):
        with pytest.raises(UnknownNameError, match=r"no such argument.*\n.*(\n.*)*\[parameters\]") as caught:
            DOORS[door](frame, given)
        assert caught.value.given in given
    with pytest.raises(UnknownNameError, match="no such argument"):
        DOORS[door](frame, {"nonsense": 1.0})
