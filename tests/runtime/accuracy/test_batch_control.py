"""Batches of motions: the error at the samples is estimated and within the tolerance, by default."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.accuracy import batch_control
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch

RTOL, SAMPLES, T_END = 1e-6, 5, 1.0


def read_scene(**changes: Any) -> dict[str, Any]:
    """Return a mass between two cables that go slack and taut, held by a spring at the side."""
    cable = {"kind": "cable", "spring_constant": 900.0, "rest_length": 1.0}
    return {
        "name": "hung",
        "axes": "xz",
        "gravity": [0.0, -9.81],
        "nodes": {
            "left": {"position": [-1.0, 0.0], "anchored": True},
            "right": {"position": [1.0, 0.2], "anchored": True},
            "low": {"position": [0.1, -1.5], "anchored": True},
            "mass": {"position": [0.0, 0.0], "mass": 0.5},
        },
        "members": {
            "one": {**cable, "nodes": ["left", "mass"]},
            "two": {**cable, "nodes": ["mass", "right"]},
            "spring": {"kind": "bar", "nodes": ["low", "mass"], "spring_constant": 60.0, "rest_length": 1.4},
        },
        **changes,
    }


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return compile_scene(read_scene(), for_="simulate_batch", integrators=("rk853",))


def start(model: CompiledModel, count: int) -> dict[str, Any]:
    random = np.random.default_rng(3).normal(size=(2, count, 2))
    return {"coordinate": model.nominal("coordinate") + 0.05 * random[0], "velocity": random[1]}


def measure_errors(model: CompiledModel, batch: Any, starts: dict[str, Any]) -> np.ndarray:
    """Return the errors of positions and velocities over the tolerance, against single runs with events."""
    errors = []
    for k in range(len(batch)):
        tight = simulate(
            model, T_END, samples=SAMPLES, method="rk853", rtol=1e-12,
            stepping=Stepping(control="steps", atol=1e-13), **{name: v[k] for name, v in starts.items()},
        )  # fmt: skip
        for name in ("coordinate", "velocity"):
            exact = getattr(tight, name)
            apart = np.linalg.norm(getattr(batch, name)[k] - exact, axis=1)
            errors.append(np.max(apart / (1e-9 + RTOL * np.linalg.norm(exact, axis=1))))
    return np.array(errors)


def test_the_error_at_the_samples_is_within_the_tolerance_by_default(model: CompiledModel) -> None:
    starts = start(model, 9)
    once = simulate_batch(
        model, T_END, samples=SAMPLES, rtol=RTOL, stepping=Stepping(control="steps"), **starts
    )
    assert measure_errors(model, once, starts).max() > 10.0  # what the steps alone leave
    batch = simulate_batch(model, T_END, samples=SAMPLES, rtol=RTOL, **starts)
    assert batch.is_ok.all()
    assert batch.error_estimate.max() <= 1.0
    assert all("are not monitored; estimated error" in message for message in batch.message)  # side by side
    assert measure_errors(model, batch, starts).max() <= 1.0
    assert batch.headline() == "9 motions, 9 ok"


def test_neither_companions_nor_threads_change_a_bit(model: CompiledModel) -> None:
    starts = start(model, 11)
    batch = simulate_batch(model, T_END, samples=SAMPLES, rtol=RTOL, threads=2, **starts)
    rows = [10, 3]
    few = simulate_batch(model, T_END, samples=SAMPLES, rtol=RTOL, **{n: v[rows] for n, v in starts.items()})
    np.testing.assert_array_equal(batch.coordinate[rows], few.coordinate)
    np.testing.assert_array_equal(batch.error_estimate[rows], few.error_estimate)


def test_motions_that_need_tighter_steps_are_integrated_one_by_one(
    model: CompiledModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_control, "FACTORS", (1.0, 0.03))
    starts = start(model, 2)
    batch = simulate_batch(model, T_END, samples=SAMPLES, rtol=RTOL, **starts)
    for k in range(2):
        own = {name: values[k] for name, values in starts.items()}
        alone = simulate(model, T_END, samples=SAMPLES, method="rk853", rtol=RTOL, **own)
        assert (batch.status[k], batch.message[k]) == (alone.status, alone.message)
        np.testing.assert_array_equal(batch.coordinate[k], alone.coordinate)


def test_motions_on_the_ground_are_those_of_single_simulations() -> None:
    """Two runs that pass over contacts may agree and be wrong."""
    scene = read_scene(ground={"stiffness": 1e5, "friction": 0.2, "offset": -0.1})
    scene["nodes"]["low"]["position"] = [0.1, 1.5]
    scene["nodes"]["left"]["position"] = [-1.0, 0.2]
    model = compile_scene(scene, for_="simulate_batch", integrators=("rk853",))
    starts = start(model, 2)
    batch = simulate_batch(model, T_END, samples=SAMPLES, rtol=RTOL, **starts)
    assert batch.is_ok.all()
    for k in range(2):
        own = {name: values[k] for name, values in starts.items()}
        alone = simulate(model, T_END, samples=SAMPLES, method="rk853", rtol=RTOL, **own)
        np.testing.assert_array_equal(batch.coordinate[k], alone.coordinate)
        assert batch.error_estimate[k] == alone.error_estimate
