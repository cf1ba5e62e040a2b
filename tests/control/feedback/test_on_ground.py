"""Feedback of a structure that stands on the ground: its linear model, gusts, feet that slip or lift."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    build_rest,
    check_independent,
    find_following,
    hold_feet,
)
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.study.stated_errors import Draws, StatedErrors
from tensegrity_codegen.control.feedback.study.study import study_control
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tests.control.feedback.standing_prism import CABLES, Q, R, build_standing
from tests.ground_cases import make_block
from tests.models import load, simulator


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> CompiledModel:
    return build_standing(tmp_path_factory.mktemp("standing"))


@pytest.fixture(scope="module")
def stands(model: CompiledModel) -> Equilibrium:
    return find_equilibrium(model)


@pytest.fixture(scope="module")
def gains(model: CompiledModel, stands: Equilibrium) -> Gains:
    return design_lqr(model, stands, Q, R)


def push(force: float) -> Disturbance:
    """Return a gust on a top node, for 0.1 s."""
    return Disturbance(gust=Gust("t1", (force, 0.0, 0.0), 0.1, 0.1))


def test_the_linear_model_is_that_of_small_motions_with_feet_that_stick(
    model: CompiledModel, stands: Equilibrium, gains: Gains
) -> None:
    assert (
        np.abs(np.linalg.eigvals(gains.A)).max() < 1.0
    )  # no motion is free, although bristles are no states
    size = 1e-7
    for k in (0, 4, 11, 17):
        velocity = size * (np.arange(18) == k)
        run = simulate_control(model, stands, t_end=0.005, disturbance=Disturbance(velocity_error=velocity))
        moved = np.concatenate([run.error[-1], run.velocity[-1]]) / size
        np.testing.assert_allclose(moved, gains.A[:, 18 + k], atol=2e-4)


def test_held_feet_have_the_accelerations_of_bristles_that_follow(
    model: CompiledModel, stands: Equilibrium
) -> None:
    """Accelerations and their derivatives near the equilibrium, where feet stick, slip and lift."""
    rest = build_rest(model, stands)
    assert model.structure is not None
    held = load(hold_feet(model.structure, model, rest), "acceleration", "state_jacobian")
    assert held.manifest.internal_name == ()
    rng, start = np.random.default_rng(0), rest.at(0.0)
    following = find_following(model, start.coordinate)
    for size in (1e-6, 1e-4, 1e-2):
        q, v = start.coordinate + size * rng.normal(size=18), 10 * size * rng.normal(size=18)
        at = {"coordinate": q, "velocity": v, "input": np.zeros(9)}
        bristle = start.internal + following @ (q - start.coordinate)
        np.testing.assert_allclose(
            held.compute("acceleration", **at),
            model.compute("acceleration", **at, internal=bristle),
            rtol=1e-9, atol=1e-7,
        )  # fmt: skip
        whole = model.compute("state_jacobian", **at, internal=bristle).toarray()[:36]
        whole[:, :18] += whole[:, 36:] @ following
        np.testing.assert_allclose(
            held.compute("state_jacobian", **at).toarray(), whole[:, :36], rtol=1e-9, atol=1e-4
        )


def test_a_structure_that_sticks_returns_to_where_it_stood(
    model: CompiledModel, stands: Equilibrium, gains: Gains
) -> None:
    without, run = (
        simulate_control(model, stands, item, t_end=2.0, disturbance=push(0.2)) for item in (None, gains)
    )
    assert without.worst_error(0.2) > 1e-4  # it turns to and fro
    assert run.worst_error(0.2) < 1e-6
    assert (run.status, run.warnings) == ("ok", ())
    assert run.slip is not None
    assert run.slip.shape == (401, 6)
    assert run.slip.max() < 1e-12


def test_feet_that_slip_are_named_with_their_ways(
    model: CompiledModel, stands: Equilibrium, gains: Gains
) -> None:
    """Where the feet are at rest again says the same as bristles do."""
    run = simulate_control(model, stands, gains, t_end=2.0, disturbance=push(1.0))
    assert run.slip is not None
    assert "b2 slips, " in run.warnings[0]
    assert run.slip[-1, :3].max() > 5e-4
    moved = np.linalg.norm(run.error[-1].reshape(6, 3)[:3, :2], axis=1)
    np.testing.assert_allclose(run.slip[-1, :3], moved, atol=5e-5)
    assert (run.slip[:, 3:] == 0.0).all()  # of nodes at the top


def test_feet_that_lift_are_named(model: CompiledModel, stands: Equilibrium) -> None:
    run = simulate_control(model, stands, t_end=1.0, disturbance=push(3.0))
    assert "b1 lifts, " in run.warnings[0]


def test_estimates_come_from_feet_that_stick(model: CompiledModel, stands: Equilibrium, gains: Gains) -> None:
    """With forces far below those of friction; lengths with noise of 0.1 mm."""
    estimator = design_kalman(
        model, stands, [Sensor("member_length", CABLES, 1e-4)], disturbance=0.02, only_observable=True
    )
    soft = design_lqr(model, stands, Q, 100.0 * R)
    run = simulate_control(model, stands, soft, estimator=estimator, t_end=2.0, disturbance=push(0.2))
    assert run.status == "ok"
    assert run.worst_error(0.2) < 5e-4
    assert run.warnings == ()


def test_a_study_reports_slip(model: CompiledModel, stands: Equilibrium) -> None:
    errors = StatedErrors(start_error=1e-4, stiffness_error=0.05)
    study = study_control(model, stands, errors=errors, draws=Draws(1), t_end=2.0)
    assert study.loops["true_state"].end_error.max() < 0.6 * study.loops["open"].end_error.max()
    assert any(text.startswith("true state, worst draw: feet") for text in study.warnings)


# What nothing holds, and what is not known.


def test_a_ground_without_friction_leaves_motions_that_are_named(tmp_path: Path) -> None:
    slick = build_standing(tmp_path, ("friction = 0.5", "friction = 0.0"))
    with pytest.raises(FormulationError, match="slide along x, slide along y, turn about z") as error:
        design_lqr(slick, find_equilibrium(slick), Q, R)
    assert "turn about x" not in str(error.value)


def test_feet_at_the_limit_of_friction_are_refused(model: CompiledModel, stands: Equilibrium) -> None:
    assert stands.feet is not None
    slips = replace(stands, feet=replace(stands.feet, state=("slip", *stands.feet.state[1:])))
    with pytest.raises(InvalidValueError, match="needs feet that stick") as error:
        design_lqr(model, slips, Q, R)
    assert "b1 slip, b2 stick" in str(error.value)


@pytest.mark.parametrize(
    "ground", [{"velocity": np.array([1.0, 0.0, 0.0])}, {"static_friction": 0.7}, {"balances_energy": True}]
)
def test_other_grounds_are_refused(ground: dict[str, object]) -> None:
    with pytest.raises(FormulationError, match="feedback does not know belts"):
        check_independent(simulator(make_block([0.0, 0.0, 0.1], **ground), "rk54"))
    check_independent(simulator(make_block([0.0, 0.0, 0.1]), "rk54"))
