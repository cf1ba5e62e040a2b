"""Wrong calls of simulations, statics and linear models: a named error, whatever an argument is."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import (
    CompiledModel,
    Profile,
    compile_scene,
    equilibrium_sensitivity,
    find_equilibria,
    find_equilibrium,
    linearize,
    read_profile,
    simulate,
    simulate_batch,
)
from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import Until
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError
from tests.wrong_calls import list_bare_errors

Call = tuple[Callable[..., Any], dict[str, Any]]
ANALYSES = ("simulate", "simulate_batch", "equilibrium", "equilibria", "sensitivity", "linearize")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calls") / "lift.toml"
    more = '[parameters]\nrest_length = "all"\n'
    more += '[[inputs]]\nname = "motor"\nkind = "rest_length"\nmembers = ["cord"]\n'
    path.write_text('axes = "z"\n' + list_examples()["two_nodes"] + more, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def model(scene: Path) -> CompiledModel:
    return compile_scene(scene, for_=ANALYSES, integrators=("rk4", "rk853"))


@pytest.fixture(scope="module")
def calls(model: CompiledModel, scene: Path) -> dict[str, Call]:
    """Functions with arguments that are right."""
    table = scene.parent / "pull.csv"
    table.write_text("time,motor\n0,0\n0.1,0.01\n", encoding="utf-8")
    place = model.nominal("coordinate")
    many = np.tile(place, (3, 1))
    run = {"t_end": 0.1, "samples": 5, "rtol": 1e-4, "progress": None, "method": "rk853",
           "stepping": Stepping(atol=1e-6, max_steps=1000, control="steps")}  # fmt: skip
    search = {"tolerance": 1e-9, "max_iterations": 100, "method": "auto", "progress": None}

    def compute(quantity: Any, **more: Any) -> None:
        model.compute(quantity, **more)

    def compute_batch(quantity: Any, **more: Any) -> None:
        model.compute_batch(quantity, **more)

    return {
        "simulate": (simulate, {**run, "model": model, "coordinate": place, "velocity": 0 * place,
                                "arguments": {"motor": 0.0}, "schedule": None,
                                "until": Until("motor > 1", stops=False)}),
        "simulate_batch": (simulate_batch, {**run, "model": model, "coordinate": many, "velocity": 0 * many,
                                            "arguments": {"motor": np.zeros(3)}, "schedule": None,
                                            "threads": 1}),
        "linearize": (linearize, {"model": model, "equilibrium": place, "coordinate": None,
                                  "velocity": 0 * place, "input": [0.0], "arguments": {},
                                  "frequency_count": 20}),
        "find_equilibrium": (find_equilibrium, {**search, "model": model, "coordinate": place,
                                                "arguments": {}, "raise_on_failure": True}),
        "find_equilibria": (find_equilibria, {**search, "model": model, "coordinate": many,
                                              "arguments": {}, "threads": 1}),
        "equilibrium_sensitivity": (equilibrium_sensitivity, {"model": model, "columns": ["motor"],
                                                              "equilibrium": find_equilibrium(model),
                                                              "arguments": {}, "tolerance": 1e-6}),
        "compile_scene": (compile_scene, {"path": scene, "for_": "simulate", "method": "", "rtol": 1e-6,
                                          "quantities": (), "integrators": (), "solvers": (),
                                          "parameters": None, "actuate": ()}),
        "Profile": (Profile, {"time": [0.0, 1.0], "values": {"motor": [0.0, 1.0]}, "kind": "linear"}),
        "Profile at a time": (Profile([0.0, 1.0], {"motor": [0.0, 1.0]}), {"time": 0.5}),
        "read_profile": (read_profile, {"path": table, "input_name": ["motor"], "kind": "linear"}),
        "compute": (compute, {"quantity": "state_derivative", "coordinate": place, "velocity": 0 * place,
                              "rest_length": [1.0], "motor": 0.0, "out": None}),
        "compute_batch": (compute_batch, {"quantity": "state_derivative", "coordinate": many,
                                          "velocity": 0 * many, "rest_length": [1.0], "motor": np.zeros(3),
                                          "threads": 1, "on_error": "raise"}),
    }  # fmt: skip


def test_an_object_of_no_kind_is_refused(calls: dict[str, Call]) -> None:
    for function, right in calls.values():
        for key in right:
            with pytest.raises(TensegrityError):
                function(**{**right, key: object()})


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")
def test_wrong_values_work_or_end_with_named_errors(calls: dict[str, Call]) -> None:
    for name, (function, right) in calls.items():
        assert list_bare_errors(function, right, right) == [], name


def test_complex_numbers_do_not_lose_their_imaginary_part(model: CompiledModel) -> None:
    for value in ([1 + 1j], np.array([1 + 1j])):
        with pytest.raises(InvalidValueError, match="not an array of numbers"):
            simulate(model, 0.1, coordinate=value)
        with pytest.raises(InvalidValueError, match="not an array of numbers"):
            model.compute("acceleration", coordinate=value)


def test_models_and_profiles_can_be_pickled(model: CompiledModel) -> None:
    again = pickle.loads(pickle.dumps(model))
    assert again.compute("potential_energy") == model.compute("potential_energy")
    assert again.structure.member_name == model.structure.member_name  # type: ignore[union-attr]
    profile = Profile([0.0, 0.5, 1.0], {"motor": [0.0, 0.2, 0.1]}, "cubic")
    assert pickle.loads(pickle.dumps(profile))(0.3) == profile(0.3)


def test_a_model_is_linearized_about_an_equilibrium(model: CompiledModel) -> None:
    found = find_equilibrium(model)
    linear = linearize(model, found)
    assert abs(linear.residual_rate).max() < 1e-6
    np.testing.assert_array_equal(linear.state, [*found.coordinate, 0.0])
    np.testing.assert_array_equal(linear.A.toarray(), linearize(model, found.coordinate).A.toarray())
    with pytest.raises(InvalidValueError, match="given twice"):
        linearize(model, found, coordinate=found.coordinate)
