"""Feedback of a structure from elsewhere: the imported NTRT spine, bent by 20 deg and straightened."""

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import FormulationError
from tests.control.feedback.spine import (
    CABLES,
    FILE,
    NOISE,
    SAMPLE,
    bend,
    build_spine,
    design_estimator,
    design_gains,
    draw_errors,
    find_turns,
)

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.timeout(1800),  # a library of 75 coordinates is compiled
    pytest.mark.skipif(not FILE.is_file(), reason="the shared structures are not beside the checkout"),
]


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
            model, motion, gains, estimator=estimator, sample=SAMPLE, t_end=5.0, seed=seed,
            **draw_errors(model, seed),
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
