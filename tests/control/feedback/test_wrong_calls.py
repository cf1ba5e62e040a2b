"""Wrong calls of the functions for motions and feedback: a named error, whatever an argument is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import (
    ActuatorLimits,
    ControllerCode,
    Disturbance,
    Draws,
    EquilibriumPath,
    Gust,
    RandomGust,
    StatedErrors,
    build_controller,
    choose_weights,
    compile_scene,
    design_distribution,
    design_kalman,
    design_lqr,
    find_equilibrium,
    load_controller,
    simulate_control,
    simulate_control_batch,
    study_control,
    time_motion,
)
from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.checks import MovedArgumentError
from tensegrity_codegen.system.errors import TensegrityError
from tests.codegen.quickly import without_optimisation

WRONG: list[Any] = [
    None, "abc", b"x", -1, 0, 1e300, 10**400, float("nan"), 1 + 2j, [], {}, {1: 2}, object(), len,
    [None], [[1, 2], [3]], np.zeros((2, 3, 4)), np.array([1 + 1j]), np.array(["a"]), "\0", True,
]  # fmt: skip
Call = tuple[Callable[..., Any], dict[str, Any]]


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Call]:
    """Functions with arguments that are right."""
    folder = tmp_path_factory.mktemp("calls")
    path = folder / "lift.toml"
    winch = '[[actuators]]\nname = "winch"\nmembers = "cord"\nrate = 1.0\n'
    sensor = '[[sensors]]\nkind = "member_length"\nmembers = "cord"\nnoise = 1e-4\n'
    path.write_text('axes = "z"\n' + list_examples()["two_nodes"] + winch + sensor, encoding="utf-8")
    with without_optimisation():
        model = compile_scene(path, for_=("plan", "equilibrium", "time_motion", "control"))
    rest, way = find_equilibrium(model), EquilibriumPath([[0.0], [-0.1]])
    motion = time_motion(model, way, duration=0.4)
    gains = design_lqr(model, motion, [100.0, 1.0], [1.0], sample=0.02)
    estimator = design_kalman(model, motion, sample=0.02, knots=2)
    tensions = design_distribution(model, motion, least_tension=1.0)
    tuning = choose_weights(model, motion, sample=0.02)
    both: dict[str, Any] = {"model": model, "motion": motion}
    parts = {"gains": gains, "estimator": estimator}

    def disturb(**disturbance: Any) -> None:
        simulate_control(model, motion, gains, t_end=0.1, disturbance=Disturbance(**disturbance))

    def simulate_gust(**gust: Any) -> None:
        disturb(gust=Gust(**gust))

    def limit(**limits: Any) -> None:
        simulate_control(model, motion, gains, t_end=0.1, limits=ActuatorLimits(**limits))

    def write_code(**code: Any) -> None:
        build_controller(model, motion, gains, out=folder / "c", code=ControllerCode(**code), overwrite=True)

    def study_errors(**errors: Any) -> None:
        study_control(model, motion, tuning=tuning, gains=gains, estimator=None, draws=1, t_end=0.4,
                      errors=StatedErrors(**errors))  # fmt: skip

    def draw(**draws: Any) -> None:
        study_control(model, motion, tuning=tuning, gains=gains, estimator=None, draws=Draws(**draws),
                      t_end=0.4)  # fmt: skip

    def run_batch(**errors: Any) -> None:
        simulate_control_batch(model, motion, gains, draws=[Disturbance(**errors)], t_end=0.1)

    def move(**points: Any) -> None:
        time_motion(model, EquilibriumPath(**points), duration=0.4)

    def measure(**sensor: Any) -> None:
        design_kalman(model, motion, [Sensor(**sensor)], sample=0.02, knots=2)

    with without_optimisation():
        build_controller(model, motion, gains, out=folder / "ctl")
    return {
        "design_lqr": (design_lqr, {**both, "Q": [100.0, 1.0, 1.0], "R": [1.0], "sample": 0.02,
                                    "integral_action": ["n2.z"], "delay": 0.01, "arguments": {}}),
        "design_lqr at rest": (design_lqr, {"model": model, "motion": rest, "Q": [100.0, 1.0], "R": [1.0],
                                            "sample": 0.02, "delay": 0.05, "arguments": {}}),
        "design_kalman": (design_kalman, {**both, "sensors": [model.structure.sensors[0]], "sample": 0.02,
                                          "disturbance": 1.0, "acceleration_noise": 0.1,
                                          "only_observable": False, "knots": 2, "arguments": {}}),
        "design_distribution": (design_distribution, {**both, "least_tension": 1.0, "preferred": 2.0,
                                                      "weight": 1e-6, "arguments": {}}),
        "choose_weights": (choose_weights, {**both, "sample": 0.02, "tolerance": 0.01, "effort": 1e-3,
                                            "response_time": 0.1, "integral_action": ["n2.z"]}),
        "simulate_control": (simulate_control, {**both, **parts, "t_end": 0.1, "sample": 0.02,
                                                "distribution": tensions, "disturbance": None,
                                                "limits": None, "compare": True}),
        "ActuatorLimits": (limit, {"rate": 1.0, "range": (0.1, 3.0), "delay": 0.0}),
        "Disturbance": (disturb, {"coordinate_error": [0.01], "velocity_error": [0.0], "gust": None,
                                  "axial_stiffness": None, "arguments": {}, "seed": 0}),
        "simulate_control_batch": (run_batch, {"coordinate_error": [0.0], "arguments": {}, "gust": None,
                                               "seed": 1}),
        "Draws": (draw, {"number": 1, "seed": 0, "last": 0.1}),
        "ControllerCode": (write_code, {"name": "lift", "precision": "double", "knots": 25,
                                        "qp_iterations": 9, "library": False, "inputs": ()}),
        "study_control": (study_control, {**both, **parts, "tuning": tuning, "distribution": None,
                                          "errors": None, "sample": 0.02, "t_end": 0.4,
                                          "draws": 1, "arguments": {}}),
        "build_controller": (build_controller, {**parts, "scene": model, "motion": motion,
                                                "distribution": None, "out": folder / "b",
                                                "sample": 0.02, "limits": None, "arguments": {},
                                                "code": ControllerCode(library=False),
                                                "overwrite": True, "policy": None}),
        "time_motion": (time_motion, {"model": model, "path": way, "duration": 0.4, "law": "quintic",
                                      "feedforward": "dynamic", "there_and_back": False, "arguments": {},
                                      "samples": 51}),
        "load_controller": (load_controller, {"folder": folder / "ctl"}),
        "EquilibriumPath": (move, {"change": [[0.0], [-0.1]], "coordinate": None, "progress": [0.0, 1.0],
                                   "actuators": ("winch",)}),
        "Gust": (simulate_gust, {"node": "n2", "force": (0, 0, 1), "start": 0.0, "duration": 0.1}),
        "StatedErrors": (study_errors, {"start_error": 0.01, "start_angle": None, "stiffness_error": 0.05,
                                        "gusts": (RandomGust("n2", 1.0),)}),
        "Sensor": (measure, {"kind": "member_length", "targets": (0,), "noise": 1e-4}),
    }  # fmt: skip


def test_an_object_of_no_kind_is_refused(calls: dict[str, Call]) -> None:
    for function, right in calls.values():
        for key in right:
            with pytest.raises(TensegrityError) as caught:
                function(**{**right, key: object()})
            assert not isinstance(caught.value, MovedArgumentError)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")
def test_wrong_values_work_or_end_with_named_errors(
    calls: dict[str, Call], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # a name may be that of a folder to be written
    for name, (function, right) in calls.items():
        function(**right)
        for key, value in ((key, value) for key in right for value in WRONG):
            try:
                function(**{**right, key: value})
            except TensegrityError:
                continue
            except Exception as error:
                pytest.fail(f"{name}({key}={value!r:.40}): {error!r}")


def test_no_motion_is_named(calls: dict[str, Call]) -> None:
    model = calls["design_kalman"][1]["model"]
    with pytest.raises(TensegrityError) as caught:
        design_kalman(model, None)  # type: ignore[arg-type]
    assert caught.value.where == "motion"
    assert "Equilibrium" in caught.value.allowed
