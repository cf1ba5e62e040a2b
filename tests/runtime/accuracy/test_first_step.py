"""The first step of explicit methods: from how fast the structure moves, not from where the origin lies."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tests.cases import thorough
from tests.models import simulator
from tests.runtime.build import prism

METHODS = ("rk54", "rk853")
each = pytest.mark.parametrize("method", METHODS)
DIRECTION = np.array([0.6, -0.7, 0.4])
RTOL, ATOL = 5e-10, 5e-7


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    structure = prism(anchored={0: "xyz"}, bar_stiffness=1e3)
    parameters: dict[str, tuple[int, ...]] = {"rest_length": tuple(range(12)), "anchor_position": (0,)}
    return simulator(structure, *METHODS, parameters=parameters, batch_width=8)


def moved(model: CompiledModel, distance: float, seed: int = 0) -> dict[str, Any]:
    """A prism at rest that is out of balance, so far from the origin."""
    offset = distance * DIRECTION
    strain = 0.02 * np.random.default_rng(seed).normal(size=12)
    return {
        "coordinate": model.nominal("coordinate") + np.tile(offset, 5),
        "arguments": {
            "rest_length": model.nominal("rest_length") * (1.0 + strain),
            "anchor_position": model.nominal("anchor_position") + offset,
        },
    }


def first_step(model: CompiledModel, method: str, distance: float, rtol: float, atol: float) -> float:
    start = moved(model, distance)
    state = np.concatenate([start["coordinate"], np.zeros(15)])
    bound = BoundIntegrator(method, Motion(model, state, np.array([0.0, 1.0]), start["arguments"]))
    time, step = bound.ffi.new("double *"), bound.ffi.new("double *")
    tail = (bound.ffi.NULL, bound.ffi.NULL, bound.n_sampled, bound.ffi.new("integrator_run *"))
    head = (1.0, rtol, atol, 0, time, step, bound.pointer(bound.state), *bound.arguments(), 0)
    assert bound.call(*head, *tail, bound.pointer(bound.work)) == 0
    return float(step[0])


@each
def test_the_first_step_is_the_same_wherever_the_origin_lies(model: CompiledModel, method: str) -> None:
    near = first_step(model, method, 0.0, RTOL, ATOL)
    for distance in (1e2, 1e4, 1e6):
        assert first_step(model, method, distance, RTOL, ATOL) == pytest.approx(near, rel=0.05)


@each
def test_a_tighter_run_begins_with_another_step(model: CompiledModel, method: str) -> None:
    for distance in (0.0, 1e5):
        steps = [first_step(model, method, distance, f * RTOL, f * ATOL) for f in (1.0, 0.1, 0.01)]
        assert steps[0] > 1.2 * steps[1] > 1.44 * steps[2]


@each
@pytest.mark.parametrize("distance", [1.4e4, *thorough(2e2, 1e6)])
def test_velocities_far_from_the_origin_are_within_the_tolerance(
    model: CompiledModel, method: str, distance: float
) -> None:
    for seed in (0, 3, 7, 11):
        tight: dict[str, Any] = {"method": "rk853", "rtol": 1e-13, "stepping": Stepping(atol=1e-13)}
        truth = simulate(model, 0.3, **moved(model, 0.0, seed), **tight)
        options: dict[str, Any] = {"method": method, "rtol": RTOL, "stepping": Stepping(atol=ATOL)}
        found = simulate(model, 0.3, **moved(model, distance, seed), **options)
        error = np.abs(found.velocity - truth.velocity) / (ATOL + RTOL * np.abs(truth.velocity))
        assert found.status == "ok"
        assert error.max() < 5.0, (seed, error.max())


@each
def test_lanes_begin_as_single_runs_do(model: CompiledModel, method: str) -> None:
    starts = [moved(model, distance, 3) for distance in (0.0, 1e2, 1e4, 1e6)]
    arguments = {
        "rest_length": starts[0]["arguments"]["rest_length"],
        "anchor_position": np.array([start["arguments"]["anchor_position"] for start in starts]),
    }
    coordinate = np.array([start["coordinate"] for start in starts])
    stepping = Stepping(atol=ATOL, control="steps")
    options: dict[str, Any] = {"method": method, "rtol": RTOL, "stepping": stepping, "samples": 3}
    batch = simulate_batch(model, 0.02, coordinate=coordinate, arguments=arguments, **options)
    for k, start in enumerate(starts):
        alone = simulate(model, 0.02, **start, **options)
        assert (batch[k].n_steps, batch[k].n_evaluations) == (alone.n_steps, alone.n_evaluations)
        np.testing.assert_array_equal(batch[k].velocity, alone.velocity)
