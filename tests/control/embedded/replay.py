"""The measurements of a simulated closed loop again, for a controller in C."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.embedded.loaded import LoadedController
from tensegrity_codegen.control.feedback.design.gains import Estimator
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.runtime.records.timed_motion import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Replay:
    """What a controller in C did: statuses, inputs and rest lengths of the actuators, estimates."""

    statuses: tuple[str, ...]
    command: Array
    rest_length: Array
    estimate: Array
    disturbance: Array


def replay(
    controller: LoadedController, run: ControlRun, motion: Motion, estimator: Estimator, seed: int
) -> Replay:
    """Return what a controller does with the measurements that the loop had, noise of the seed included."""
    noise, rows = np.random.default_rng(seed), []
    sensing = estimator.sensing
    for k in range(len(run.command)):
        value = run.input[k - 1] if k else motion.at(0.0).input
        at = {"coordinate": run.coordinate[k], "velocity": run.velocity[k], "input": value}
        rows.append(sensing.measure(at) + sensing.noise * noise.normal(size=len(sensing.noise)))
    return _run(controller, np.array(rows), estimator.sample, has_sensors=True)


def replay_states(controller: LoadedController, run: ControlRun) -> Replay:
    """Return what a controller does with the true states of the loop."""
    states = np.hstack([run.coordinate, run.velocity])[:-1]
    return _run(controller, states, controller.description.sample, has_sensors=False)


def _run(controller: LoadedController, rows: Array, sample: float, *, has_sensors: bool) -> Replay:
    assert controller.init() == "ok"
    step = controller.step if has_sensors else controller.step_state
    statuses, fields = [], []
    for k, row in enumerate(rows):
        status, rest = step(k * sample, row)
        statuses.append(status)
        fields.append(
            [controller.read("command"), rest, controller.read("estimate"), controller.read("disturbance")]
        )
    command, rest_length, estimate, disturbance = (np.array(column) for column in zip(*fields, strict=True))
    return Replay(tuple(statuses), command, rest_length, estimate, disturbance)


def check_same(done: Replay, run: ControlRun, motion: Motion, tolerance: float = 1e-12) -> None:
    """Check that a controller in C gave the commands, statuses and estimates of a loop in Python."""
    scale = np.abs(motion.rest_length).max()
    assert done.statuses == run.step_status
    np.testing.assert_allclose(done.command, run.command, rtol=0, atol=tolerance * scale)
    if run.estimate is not None and run.disturbance is not None:
        n = run.estimate.shape[1]
        size = np.abs(run.estimate).max(axis=0)
        gap = np.abs(done.estimate[:, :n] - run.estimate)
        assert (gap <= tolerance * np.maximum(size, 1.0)).all()
        force = np.abs(run.disturbance).max()
        np.testing.assert_allclose(done.disturbance, run.disturbance, rtol=0, atol=100 * tolerance * force)
