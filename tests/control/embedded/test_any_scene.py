"""Controllers of all kinds of scenes compute what Python computes: bodies, nodes, planes, sensors."""

import copy
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.feedback.closed_loop import Controller, Filter
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains, find_sensing
from tensegrity_codegen.control.feedback.design.linear_samples import split_delays
from tensegrity_codegen.control.feedback.loop.actuator_bounds import (
    ActuatorLimits,
    DelayedInputs,
    find_bounds,
)
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.interface import name_states
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import Subject, assemble_scene
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING
from tests.codegen.quickly import without_optimisation

Array = NDArray[np.float64]

QUANTITIES = ("acceleration", "mass_matrix", "equilibrium_matrix", "member_length", "member_tension")
SAMPLE, STEPS, OUTLIER = 0.002, 40, 25  # [s], samples, the sample whose measurements are far off
EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen" / "scene" / "examples"


@dataclass(frozen=True)
class MadeUp:
    """A scene with a made-up motion, gains and estimator."""

    model: CompiledModel
    motion: Motion
    gains: Gains
    estimator: Estimator


def make_up(
    subject: Subject,
    request: ModelRequest,
    sensors: list[Sensor],
    seed: int = 0,
    delay: Array | float = 0.0,
    substeps: int = 2,
) -> MadeUp:
    """Return parts whose numbers are random, around the coordinates of the scene.

    substeps: Runge-Kutta steps of a prediction, enough for the fastest vibration: bars of 5e5 N need 8.
    """
    rng = np.random.default_rng(seed)
    in_bodies = request.formulation == "bodies"
    nodes = ("node_position", "node_velocity") if in_bodies else ()
    wanted = ModelRequest((*QUANTITIES, *nodes), formulation=request.formulation, emitter=request.emitter)
    with without_optimisation():
        model = build_library(subject, wanted).load()
    motion = _make_motion(model, subject, rng)
    n, m = motion.coordinate.shape[1], len(motion.actuators)
    sensing = find_sensing(model, sensors)
    disturbed = np.flatnonzero(rng.random(n) < 0.7)
    size = 2 * n + len(disturbed)
    times, names = np.array([0.0, 0.02, 0.05]), name_states(model.manifest)
    late = np.broadcast_to(delay, m).astype(float)
    past = int(split_delays(late, SAMPLE)[2].sum())
    gains = Gains(
        time=times, K=1e-3 * rng.normal(size=(3, m, 2 * n + 2 + past)), S=np.zeros((3, 2 * n + 2, 2 * n + 2)),
        E=np.zeros(2 * n + 2, complex), A=np.eye(2 * n), B=np.zeros((2 * n, m)),
        integral_action=rng.normal(size=(2, 2 * n)), delay=late, sample=SAMPLE, residual=0.0,
        actuators=motion.actuators, state_name=names, integral_name=("a", "b"),
    )  # fmt: skip
    slopes = sensing.slopes(_at(motion, 0.0))
    pull = (
        0.2 / len(slopes) * slopes.T / np.maximum((slopes**2).sum(axis=1), 1e-3)
    )  # towards the measurements
    force = 1e-3 * rng.normal(size=(len(disturbed), len(slopes)))
    table = np.vstack([pull, force]) * (1.0 + 0.2 * rng.normal(size=(3, 1, len(slopes))))
    estimator = Estimator(
        time=times, L=table, P=np.zeros((3, size, size)), innovation=np.ones((3, len(slopes))),
        E=np.zeros(size, complex), sample=SAMPLE, residual=0.0, substeps=substeps, disturbed=disturbed,
        sensing=sensing, state_name=(*names, *(f"force {k}" for k in disturbed)),
    )  # fmt: skip
    return MadeUp(model, motion, gains, estimator)


def _make_motion(model: CompiledModel, subject: Subject, rng: np.random.Generator) -> Motion:
    """Return a small motion with uneven knots; all inputs change."""
    time = np.array([0.0, 0.02, 0.03, 0.06])
    q = model.nominal("coordinate")
    names = model.manifest.input_name
    actuators = tuple(item.name for item in subject.actuators)
    return Motion(
        time=time,
        coordinate=q + 1e-3 * rng.normal(size=(4, len(q))),
        velocity=0.01 * rng.normal(size=(4, len(q))),
        acceleration=0.1 * rng.normal(size=(4, len(q))),
        rest_length=np.zeros((4, len(actuators))),
        input=model.nominal("input") + 1e-3 * rng.normal(size=(4, len(names))),
        member_tension=np.zeros((4, len(model.manifest.member_name))),
        peak_rate=np.zeros(len(actuators)),
        actuators=actuators,
        input_name=names,
    )


def _at(motion: Motion, time: float) -> dict[str, Array]:
    point = motion.at(time)
    return {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}


def check_made_up(parts: MadeUp, folder: Path, tolerance: float = 1e-12) -> None:
    """Check that C and Python compute the same from noisy measurements along the motion."""
    sensing, rng = parts.estimator.sensing, np.random.default_rng(1)
    rows = [sensing.measure(_at(parts.motion, k * SAMPLE)) for k in range(STEPS)]
    delay = parts.gains.delay
    measured = np.array(rows) + 1e-4 * rng.normal(size=(STEPS, len(rows[0])))
    measured[OUTLIER] += 1e3
    with without_optimisation():
        bundle = build_controller(
            parts.model,
            parts.motion,
            parts.gains,
            estimator=parts.estimator,
            out=folder / "ctl",
            limits=ActuatorLimits(delay=delay),
        )
    controller = bundle.load()
    controller.init()
    expected = _run_python(parts, measured, delay)
    assert [k for k, step in enumerate(expected) if step[1] == "outlier"] == [OUTLIER]
    for k, (command, status, estimate, rest) in enumerate(expected):
        found, lengths = controller.step(k * SAMPLE, measured[k])
        assert found == status, (k, found, status)
        scale = max(float(np.abs(lengths).max()), 0.1)
        np.testing.assert_allclose(controller.read("command"), command, rtol=0, atol=tolerance * scale)
        np.testing.assert_allclose(lengths, rest, rtol=0, atol=tolerance * scale)
        gap = np.abs(controller.read("estimate") - estimate).max()
        assert gap <= 10 * tolerance * np.abs(estimate).max()


def _run_python(parts: MadeUp, measured: Array, delay: Array) -> list[tuple[Array, str, Array, Array]]:
    """Return command, status, estimate and rest lengths of each step."""
    bounds = find_bounds(parts.model, parts.motion, limits=ActuatorLimits(delay=delay))
    controller = Controller(parts.motion, parts.gains, bounds, SAMPLE)
    senses = Filter(parts.model, parts.estimator, parts.motion, {})
    delayed, value = DelayedInputs(bounds, controller.command, SAMPLE), parts.motion.at(0.0).input.copy()
    structure, found = parts.model.structure, []
    assert structure is not None
    for k, row in enumerate(measured):
        known = senses.correct(k * SAMPLE, row, value)
        estimate = senses.state.copy()
        command, status = controller.hold(k) if senses.is_outlier else controller.step(k, known)
        value = parts.motion.at((k + 0.5) * SAMPLE).input.copy()
        stretches = delayed.push(command)
        ends = [*(since for since, _ in stretches[1:]), SAMPLE]
        value[bounds.place] = command
        rest = structure.rest_length.copy()
        for column, item in enumerate(structure.inputs):
            if item.kind == "rest_length":
                rest[list(item.targets)] += value[column]
        found.append((command, status, estimate, rest[[members[0] for members in bounds.members]]))
        for (since, arrived), end in zip(stretches, ends, strict=True):
            value[bounds.place] = arrived
            senses.predict(end - since, value)
    return found


def read_example(name: str) -> dict[str, Any]:
    document = tomllib.loads((EXAMPLES / name).read_text(encoding="utf-8"))
    document.pop("parameters", None)
    return document


def check(
    document: dict[str, Any], sensors: list[Sensor], folder: Path, *, tolerance: float = 1e-12, **options: Any
) -> None:
    subject, request = assemble_scene(parse_scene(document), "scene")
    check_made_up(make_up(subject, request, sensors, **options), folder, tolerance)


def test_bodies_of_all_kinds(tmp_path: Path) -> None:
    """Free and joined bodies, torques, a member with three inputs, all kinds of sensors."""
    document = copy.deepcopy(EVERYTHING)
    document["actuators"] = [
        {"name": "first", "members": ["t1"], "rate": 0.3, "range": [0.2, 0.6]},
        {"name": "second", "members": ["t1", "t3"]},
        {"name": "third", "members": ["t2"], "rate": 1.0},
    ]
    sensors = [
        Sensor("member_tension", (1, 0), 1.0),
        Sensor("node_position", (3, 7), 1e-3),
        Sensor("member_length", (4, 2), 1e-3),
        Sensor("node_velocity", (5,), 1e-2),
        Sensor("member_length", (0,), 1e-3),
    ]
    check(document, sensors, tmp_path, delay=np.array([0.0, 0.003, 0.0005]))


@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_a_plane_with_springs_as_bars(away: float, tmp_path: Path) -> None:
    """Positions of free, held and half-held nodes, near the origin and far from it."""
    document = read_example("planar.toml")
    for node in document["nodes"].values():
        node["position"] = [x + away for x in node["position"]]
    document["actuators"] = [{"name": "m", "members": ["top", "left"], "rate": 0.1}]
    sensors = [
        Sensor("node_position", (0, 1, 2, 3), 1e-3),
        Sensor("member_length", (2, 3), 1e-3),
        Sensor("node_velocity", (1, 0), 1e-3),
    ]
    check(document, sensors, tmp_path, tolerance=1e-12 * max(away, 1.0))


@pytest.mark.thorough
def test_a_free_tower_of_nodes(tmp_path: Path) -> None:
    """Coupled masses of bars, forces as inputs, actuators of several members."""
    document = read_example("tower.toml")
    document["actuators"] = [
        {"name": "m", "members": ["vertical2_1", "vertical1_1"], "rate": 0.2},
        {"name": "k", "members": ["saddle1_1"], "rate": 0.2, "delay": 0.001},
    ]
    sensors = [Sensor("member_length", (20, 3, 11), 1e-3), Sensor("node_position", (4, 16), 1e-3)]
    check(document, sensors, tmp_path, substeps=8)
