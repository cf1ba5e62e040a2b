"""Motions of `simulate` under feedback: a roll of an icosahedron of elastic rods, and a mass on a winch."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import design_mpc
from tensegrity_codegen.control.feedback.recorded_motion import record_motion
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.profiles.read_profile import read_profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tests.control.embedded.test_mpc import LIFT
from tests.models import ROOT

SAMPLE = 0.02  # [s]


@pytest.fixture(scope="module")
def lift(tmp_path_factory: pytest.TempPathFactory) -> CompiledModel:
    path = tmp_path_factory.mktemp("lift") / "lift.toml"
    path.write_text(LIFT, encoding="utf-8")
    return compile_scene(path, for_=("simulate", "control"))


def test_a_recorded_motion_is_that_of_the_simulation(lift: CompiledModel) -> None:
    pull = Profile([0.0, 1.0, 6.0], {"winch": [0.0, -0.1, -0.1]})
    run = simulate(lift, 6.0, samples=301, schedule=pull)
    motion = record_motion(lift, run)
    for k in (0, 40, 300):
        point = motion.at(float(run.time[k]))
        np.testing.assert_allclose(point.coordinate, run.coordinate[k], atol=1e-12)
        np.testing.assert_allclose(point.velocity, run.velocity[k], atol=1e-10)
        assert point.input[0] == pytest.approx(pull(float(run.time[k]))["winch"])
    assert motion.peak_rate[0] == pytest.approx(0.1)
    # Half of the sample away the quintic through accelerations is the motion too.
    middle = simulate(lift, 6.0, samples=601, schedule=pull).coordinate[81]
    np.testing.assert_allclose(motion.at(0.81).coordinate, middle, atol=1e-6)


def test_wrong_runs_are_refused(lift: CompiledModel) -> None:
    run = simulate(lift, 1.0, samples=11)
    for wrong in ({"status": "unstable"}, {"time": run.time + 1.0}, {"input": None}):
        with pytest.raises(InvalidValueError, match="not a motion from 0 s to its end"):
            record_motion(lift, type(run)(**{**vars(run), **wrong}))


@pytest.mark.thorough
def test_a_roll_through_contacts_is_followed(tmp_path: Path) -> None:
    """Two rolls of the gait, with stiffnesses within 5 % and friction 0.3 to 0.6 where 0.5 is assumed."""
    gallery = ROOT / "docs" / "gallery"
    text = (gallery / "icosahedron_gait.toml").read_text(encoding="utf-8")
    text = text.replace('formulation = "rigid_bar"\n', "")
    text = text.replace('kind = "bar"\n', 'kind = "bar"\nspring_constant = 2e4\ndamping = 5\n')
    path = tmp_path / "icosahedron.toml"
    path.write_text(text, encoding="utf-8")
    model = compile_scene(path, for_=("simulate", "control"))
    inputs = read_profile(gallery / "icosahedron_gait.csv", model.manifest.input_name)
    rolled = simulate(model, 5.0, samples=1001, schedule=inputs)
    motion = record_motion(model, rolled)
    weight = np.concatenate([np.ones(36), np.full(36, 0.0025)])
    gains = design_lqr(model, motion, weight, np.full(24, 10.0), sample=SAMPLE)
    stiffness = model.nominal("spring_constant")
    means = []
    for item in (None, gains):
        ends = []
        for seed in range(4):
            rng = np.random.default_rng(seed)
            wrong = stiffness * rng.uniform(0.95, 1.05, len(stiffness))
            draw = Disturbance(arguments={"spring_constant": wrong, "ground": [rng.uniform(0.3, 0.6)]})
            run = simulate_control(model, motion, item, sample=SAMPLE, disturbance=draw, compare=False)
            assert run.status == "ok"
            assert "lifts" in run.warnings[0]  # the foot behind the edge
            ends.append(float(np.linalg.norm(run.error[-1].reshape(12, 3).mean(axis=0))))
        means.append(np.mean(ends))
    assert means[1] < 0.5 * means[0]  # of the centre of mass
    with pytest.raises(FormulationError, match="needs feet that stick where they stand"):
        design_mpc(model, motion, weight, np.full(24, 10.0), sample=SAMPLE)
    with pytest.raises(FormulationError, match="needs feet that stick where they stand"):
        design_kalman(model, motion, [Sensor("member_length", tuple(range(6, 30)), 1e-4)], sample=SAMPLE)
