"""The paper's tower with a motor for each tendon: the motions of `reconfigure`, from equilibria in time."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.equilibrium_path import EquilibriumPath
from tensegrity_codegen.control.feedback.inverse_dynamics import InverseDynamics
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.time_motion import time_motion
from tensegrity_codegen.control.planning.plan_point import PlanModel, find_actuation
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.actuators import Actuator, Sensor
from tensegrity_codegen.structure.bodies import BodyInput, BodySystem
from tensegrity_codegen.studies.papers.scs.reconfiguration import blend
from tensegrity_codegen.system.errors import InvalidValueError
from tests.cases import thorough
from tests.control.feedback.structures import compile_motion
from tests.control.feedback.tower_motion import (
    build_tower,
    design_tower_gains,
    draw_tower_errors,
    find_angles,
    move_tower,
)
from tests.studies.papers.scs.subjects import paper_motion, tower

NAMES = ("with_torque", "zero_torque")
pytestmark = pytest.mark.thorough

SAMPLE = 0.01


@cache
def build(rate: float) -> BodySystem:
    """Return the tower with a motor for each tendon."""
    system = tower().system
    names = [f"pull_{name}" for name in system.member_name]
    inputs = tuple(BodyInput(name, "rest_length", (e,)) for e, name in enumerate(names))
    return system.with_changes(
        inputs=(*system.inputs, *inputs),
        actuators=tuple(Actuator(name, (e,), rate) for e, name in enumerate(names)),
    )


def trace(name: str) -> EquilibriumPath:
    """Return 11 equilibria of a motion of the paper, at equal steps of the azimuth."""
    motion, progress = paper_motion(name), np.linspace(0.0, 1.0, 11)
    times = [
        0.0,
        *(
            brentq(lambda t, p=p: blend(t, motion.duration)[0] - p, 0, motion.duration)
            for p in progress[1:-1]
        ),
        motion.duration,
    ]
    coordinate, change = [], []
    for time in times:
        s = motion.path.at(time).s
        still = tower().compute_control(s, np.zeros(3), np.zeros(3), motion.force, "equilibrium")
        rest = tower().rest_lengths(tower().restricted.group_length(s), still.tension)
        coordinate.append(tower().restricted.coordinate(s))
        change.append(tower().spread(rest) - tower().system.rest_length)
    return EquilibriumPath(change, coordinate, progress)


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_inverse_dynamics_of_its_motion_are_the_rest_lengths_of_reconfigure(name: str) -> None:
    model, motion = compile_motion(build(0.05), "bodies"), paper_motion(name)
    for time in (0.0, 1.3, 2.5, 4.1):
        at, control = motion.path.at(time), motion.control(time)
        given = {"F3": motion.force, "M3": control.input[2]}
        plan_model = PlanModel(model, find_actuation(model), given)
        q, v = tower().restricted.coordinate(at.s), tower().restricted.velocity(at.s, at.rate)
        h = 1e-4
        ahead, behind = (motion.path.at(time + shift) for shift in (h, -h))
        a = tower().restricted.velocity(ahead.s, ahead.rate) - tower().restricted.velocity(
            behind.s, behind.rate
        )
        a = a / (2 * h) if time > 0 else np.zeros(len(q))
        rest = tower().spread(motion.rest_lengths(time))
        tension = tower().spread(control.tension)
        change = rest - tower().system.rest_length
        drive = InverseDynamics(plan_model, q).solve(q, v, a, change - 1e-3, tension)
        assert np.abs(drive.residual).max() < 1e-9
        np.testing.assert_allclose(drive.change, change, atol=1e-8)
        np.testing.assert_allclose(drive.tension, tension, atol=1e-5)


@pytest.mark.parametrize("name", ["zero_torque", *thorough("with_torque")])
def test_the_tower_ends_at_the_plan_without_torque(name: str) -> None:
    model, path, force = compile_motion(build(0.05), "bodies"), trace(name), paper_motion(name).force
    shortest = time_motion(model, path, arguments={"F3": force}, samples=51).duration
    motion = time_motion(model, path, 2 * shortest, arguments={"F3": force}, samples=101)
    assert motion.warnings == ()
    run = simulate(
        model,
        motion.duration,
        schedule=motion.profile(),
        coordinate=motion.coordinate[0],
        samples=101,
        rtol=1e-9,
    )
    assert run.status == "ok", run.message
    assert np.degrees(np.abs(run.coordinate - motion.coordinate).max()) < 1e-4
    assert np.degrees(np.abs(run.coordinate[-1] - np.asarray(path.coordinate)[-1]).max()) < 1e-4


@pytest.mark.thorough
def test_slow_motors_are_refused_with_the_rate_that_the_motion_needs() -> None:
    model = compile_motion(build(0.02), "bodies")
    with pytest.raises(InvalidValueError) as caught:
        time_motion(model, trace("with_torque"), 5.0, arguments={"F3": -50.0}, samples=51)
    text = str(caught.value)
    assert "for the actuator pull_" in text
    assert "moves at 0.047" in text
    assert "for its rate of 0.02 m/s" in text


def test_the_equilibria_of_other_loads_are_refused() -> None:
    model = compile_motion(build(0.05), "bodies")
    with pytest.raises(InvalidValueError, match="point 0 of the path is no equilibrium"):
        time_motion(model, trace("zero_torque"), 5.0, arguments={"F3": -40.0})


# Feedback of the paper's two-stage tower: 18 motors, no torques, errors of the acceptance table.


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return build_tower()


@pytest.fixture(scope="module")
def motion(model: CompiledModel) -> Motion:
    return move_tower(model)


@pytest.fixture(scope="module")
def gains(model: CompiledModel, motion: Motion) -> Gains:
    return design_tower_gains(model, motion)


def run_draw(
    model: CompiledModel, motion: Motion, seed: int, gains: Gains | None, noise: float = 0.0
) -> ControlRun:
    estimator: Estimator | None = None
    if noise:
        lengths = (Sensor("member_length", tuple(range(18)), noise),)
        estimator = design_kalman(model, motion, lengths, sample=SAMPLE)
    return simulate_control(
        model,
        motion,
        gains,
        estimator=estimator,
        sample=SAMPLE,
        t_end=12.0,
        disturbance=draw_tower_errors(model, seed, seed),
    )


def test_the_motion_has_the_tensions_of_the_paper(model: CompiledModel, motion: Motion) -> None:
    for row, printed in ((0, (26.11, 1.85, 18.38)), (-1, (46.97, 12.27, 43.00))):
        groups = motion.member_tension[row].reshape(3, 6)
        assert np.abs(groups - np.array(printed)[:, None]).max() < 0.02
    assert 0.0475 < motion.peak_rate.max() < 0.048


def test_a_motor_of_two_centimetres_a_second_is_too_slow(
    model: CompiledModel, motion: Motion, gains: Gains
) -> None:
    with pytest.raises(InvalidValueError, match="too fast for an actuator") as caught:
        simulate_control(model, motion, gains, limits=ActuatorLimits(rate=0.02))
    assert "needs 0.0475" in str(caught.value)


@pytest.mark.parametrize("seed", range(20))
def test_feedback_holds_the_tower(model: CompiledModel, motion: Motion, gains: Gains, seed: int) -> None:
    angles = find_angles(model)
    open_loop = run_draw(model, motion, seed, None)
    assert np.degrees(open_loop.worst_error(1.0, angles)) > 0.2
    for noise, bound in ((0.0, 0.06), (1e-4, 0.1), (5e-4, 0.25)):
        run = run_draw(model, motion, seed, gains, noise)
        assert run.status == "ok"
        assert np.degrees(run.worst_error(1.0, angles)) < bound
        assert run.least_tension(7.0).min() > 8.0
