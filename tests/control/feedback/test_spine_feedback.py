"""Feedback of a structure from elsewhere: the imported NTRT spine, bent by 20 deg and straightened."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.time_motion import time_motion
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.scene.formats.import_ntrt import import_ntrt
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.control.planning.structures import actuate, assemble, limit, prestress

Array = NDArray[np.float64]

FILE = Path(__file__).parents[4] / "shared" / "data" / "ntrt" / "Spines" / "TetrahedralSpine.yaml"
SAMPLE, RATE, DURATION = 0.01, 0.3, 4.0
CABLES = tuple(range(60, 100))  # after 24 rods and 36 bracing bars
FREE = tuple(f"t{k}" for k in range(2, 7))  # vertebrae that move
STIFFNESS, NOISE = 1000.0, 5e-4  # [N/m], [m]
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.timeout(1800),  # a library of 75 coordinates is compiled
    pytest.mark.skipif(not FILE.is_file(), reason="the shared structures are not beside the checkout"),
]


def build_spine() -> CompiledModel:
    """Return the compiled spine: decimetres of the file in metres, cables with up to 100 N."""
    structure = assemble(import_ntrt(FILE, length_scale=0.1).document)
    held = np.array([name.startswith("t1_") for name in structure.node_name])
    structure = structure.with_changes(node_anchored=np.repeat(held[:, None], 3, axis=1))
    structure = limit(actuate(prestress(structure, 100.0), rate=RATE))
    wanted = want_analyses(structure, ModelRequest(()), ("plan", "time_motion", "control"))
    return build_library(structure, wanted).load()


def bend(model: CompiledModel) -> Motion:
    """Return the motion: the last vertebra turns by 20 deg about x, and back."""
    found = plan(model, {'rotation("t6_*")': (20.0, 0.0, 0.0)})
    assert found.is_found
    return time_motion(model, found, DURATION, there_and_back=True)


def find_vertebrae(model: CompiledModel) -> list[list[int]]:
    """Return the coordinates of each free vertebra, node by node."""
    names = model.manifest.coordinate_name
    return [[k for k, name in enumerate(names) if name.startswith(f"{v}_")] for v in FREE]


def build_pose(model: CompiledModel) -> Array:
    """Return the displacements by small translations [m] and turns [rad] of the vertebrae, (75, 30)."""
    start, columns = model.nominal("coordinate").ravel(), []
    for places in find_vertebrae(model):
        arm = start[places].reshape(-1, 3)
        arm = arm - arm.mean(axis=0)
        for way in (*np.eye(3), *(np.cross(axis, arm) for axis in np.eye(3))):
            column = np.zeros(len(start))
            column[places] = np.broadcast_to(way, arm.shape).ravel()
            columns.append(column)
    return np.array(columns).T


def design_gains(model: CompiledModel, motion: Motion, **options: Any) -> Gains:
    """Return gains that sum the errors of position and turn of each vertebra."""
    pose, n = np.linalg.pinv(build_pose(model)), 75
    weight = np.concatenate([np.full(n, 1e3), np.ones(n), np.full(len(pose), 1e2)])
    sums = np.hstack([pose, np.zeros((len(pose), n))])
    return design_lqr(model, motion, weight, np.full(40, 1e5), sample=SAMPLE, integral_action=sums, **options)


def design_estimator(model: CompiledModel, motion: Motion, *, disturbance: float = 2.0) -> Estimator:
    """Return the estimator from the lengths of all cables."""
    sensors = [Sensor("member_length", CABLES, NOISE)]
    return design_kalman(
        model, motion, sensors, sample=SAMPLE, disturbance=disturbance, only_observable=True, knots=9
    )


def draw_errors(model: CompiledModel, seed: int, noise: int = 0) -> Disturbance:
    """Return the errors of one draw: 1 deg and 1 cm off, stiffness by 5 %, 5 N on a node for 0.2 s.

    noise: seed of the noise of measurements.
    """
    rng = np.random.default_rng(seed)
    size = np.tile([0.01] * 3 + [np.radians(1.0)] * 3, len(FREE))
    force = rng.normal(size=3)
    ends = ("front", "right", "back", "left")
    return Disturbance(
        coordinate_error=build_pose(model) @ (size * rng.choice([-1.0, 1.0], len(size))),
        arguments={"spring_constant": STIFFNESS * np.array([1.05 if e % 2 else 0.95 for e in range(40)])},
        gust=Gust(f"t6_{ends[rng.integers(4)]}", tuple(5.0 * force / np.linalg.norm(force)), 0.5, 0.2),
        seed=noise,
    )


def find_turns(model: CompiledModel, first: Array, second: Array) -> Array:
    """Return the largest turn [deg] of a vertebra between two coordinate tables (n_t, 75), at each time."""
    turns = []
    for places in find_vertebrae(model):
        pairs = zip(first[:, places], second[:, places], strict=True)
        shapes = ((a.reshape(-1, 3), b.reshape(-1, 3)) for a, b in pairs)
        turns.append([Rotation.align_vectors(a - a.mean(0), b - b.mean(0))[0].magnitude() for a, b in shapes])
    return np.degrees(np.max(turns, axis=0))


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return build_spine()


@pytest.fixture(scope="module")
def motion(model: CompiledModel) -> Motion:
    return bend(model)


@pytest.fixture(scope="module")
def gains(model: CompiledModel, motion: Motion) -> Gains:
    return design_gains(model, motion)


@pytest.fixture(scope="module")
def estimators(model: CompiledModel, motion: Motion) -> dict[str, Estimator]:
    """Estimators with disturbance forces and without."""
    return {"forces": design_estimator(model, motion), "none": design_estimator(model, motion, disturbance=0)}


def test_the_motion_bends_the_spine_by_20_degrees_and_returns(model: CompiledModel, motion: Motion) -> None:
    still = np.repeat(motion.coordinate[:1], 2, axis=0)
    half = len(motion.time) // 2
    turned = find_turns(model, motion.coordinate[[half, -1]], still)
    assert turned == pytest.approx([20.0, 0.0], abs=1e-5)
    np.testing.assert_allclose(motion.coordinate[::-1], motion.coordinate, atol=1e-12)
    assert motion.warnings == ()
    assert 0.05 < motion.peak_rate.max() < 0.08  # [m/s]
    assert motion.member_tension[:, list(CABLES)].min() > 30.0


def test_40_lengths_show_30_of_75_disturbance_forces(
    model: CompiledModel, motion: Motion, estimators: dict[str, Estimator]
) -> None:
    with pytest.raises(FormulationError, match="cannot be observed") as caught:
        design_kalman(model, motion, [Sensor("member_length", CABLES, NOISE)], sample=SAMPLE, knots=2)
    assert "only_observable" in str(caught.value)
    names = [model.manifest.coordinate_name[k] for k in estimators["forces"].disturbed]
    assert len(names) == 30
    assert {start: sum(name.startswith(start) for name in names) for start in ("t2_", "t4_", "t6_")} == {
        "t2_": 6, "t4_": 6, "t6_": 6,  # a rigid body has six
    }  # fmt: skip
    assert len(estimators["none"].disturbed) == 0


@pytest.mark.parametrize("seed", range(20))
def test_feedback_holds_the_spine(
    model: CompiledModel, motion: Motion, gains: Gains, estimators: dict[str, Estimator], seed: int
) -> None:
    def find_worst(gains: Gains | None, estimator: Estimator | None) -> tuple[float, ControlRun]:
        run = simulate_control(
            model, motion, gains, estimator=estimator, sample=SAMPLE, t_end=5.0,
            disturbance=draw_errors(model, seed, seed),
        )  # fmt: skip
        assert run.status == "ok"
        late = run.time >= run.time[-1] - 0.5
        goal = run.coordinate - run.error
        assert find_turns(model, run.coordinate[:1], goal[:1]) == pytest.approx(1.73, abs=0.01)  # sqrt(3) deg
        return float(find_turns(model, run.coordinate[late], goal[late]).max()), run

    open_loop, _ = find_worst(None, None)
    true_state, run = find_worst(gains, None)
    assert run.least_tension(1.0)[list(CABLES)].min() > 30.0
    lengths, run = find_worst(gains, estimators["forces"])
    assert run.least_tension(1.0)[list(CABLES)].min() > 20.0
    assert open_loop > 0.4
    assert true_state < 0.01
    assert lengths < 0.08
    if seed % 5 == 0:
        biased, _ = find_worst(gains, estimators["none"])
        assert biased > max(0.08, 1.5 * lengths)
