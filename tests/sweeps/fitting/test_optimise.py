"""Gradients of losses of motions, and designs found by them."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.sweeps.fitting.optimise import LossGradient, optimise
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError
from tests.cases import thorough
from tests.sweeps.fitting.scenes import FALL, PRISM, RING, ROPE, change

WOUND: dict[str, Any] = {**FALL, "inputs": [{"name": "winch", "kind": "rest_length", "members": ["rope"]}]}


def end_height(motion: Trajectory) -> tuple[float, dict[str, Any]]:
    at = np.zeros_like(motion.node_position)
    at[-1, motion.node_name.index("weight"), 2] = 1.0
    return float(motion.node_position[-1, motion.node_name.index("weight"), 2]), {"node_position": at}


def all_parts(motion: Trajectory) -> tuple[float, dict[str, Any]]:
    """A loss of positions, velocities, lengths and tensions at all samples."""
    position, velocity, tension = motion.node_position, motion.node_velocity, motion.member_tension
    ends = motion.structure.connectivity  # type: ignore[union-attr]
    length = np.linalg.norm(position[:, ends[:, 1]] - position[:, ends[:, 0]], axis=-1)
    parts = {
        "node_position": 2.0 * position,
        "node_velocity": 0.02 * velocity,
        "member_length": 4.0 * length,
        "member_tension": 2e-4 * tension,
    }
    value = (
        (position**2).sum() + 0.01 * (velocity**2).sum() + 2.0 * (length**2).sum() + 1e-4 * (tension**2).sum()
    )
    return float(value), parts


def compare_with_differences(gradient: LossGradient, values: Any, tolerance: float) -> None:
    _, slopes = gradient(values)
    for k, size in enumerate(gradient.problem.size):
        step = np.zeros(len(values))
        step[k] = 1e-5 * size
        (ahead, _), (behind, _) = gradient(values + step), gradient(values - step)
        assert slopes[k] == pytest.approx((ahead - behind) / (2.0 * step[k]), rel=tolerance, abs=tolerance)


def test_the_gradient_of_a_damped_cable_is_published() -> None:
    """d l/d(k, c, rest length) after 3 s, l downwards."""
    gradient = LossGradient(FALL, ROPE, end_height, 3.0, samples=[0.0, 3.0], rtol=1e-11)
    value, slopes = gradient([100.0, 2.0, 1.0])
    assert value == pytest.approx(-1.080111479106, rel=1e-10)
    np.testing.assert_allclose(-slopes, [0.00135538, 0.06985699, 0.72649611], atol=1e-8)


def test_the_gradient_of_everything_is_that_of_differences() -> None:
    keys = ["classes.cable.spring_constant", "shape.prestress", "loads[0].force[0]", "shape.height"]
    gradient = LossGradient(PRISM, keys, all_parts, 0.3, samples=7, rtol=1e-11)
    compare_with_differences(gradient, np.array([300.0, 5.0, 2.0, 0.3]), 2e-6)


@pytest.mark.parametrize("backwards", [True, *thorough(False)])
def test_numbers_of_a_cable_with_friction_at_a_ring_have_derivatives(backwards: bool) -> None:
    """Its strands share them; it is pulled taut, slips and sticks."""

    def loss(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        at = np.zeros_like(motion.node_position)
        at[-1] = np.arange(9.0).reshape(3, 3) * 0.1 + 1.0
        return float((motion.node_position * at).sum()), {"node_position": at}

    keys = ["classes.cord.axial_stiffness", "classes.cord.damping", "members.rope.rest_length"]
    gradient = LossGradient(RING, keys, loss, 0.4, samples=[0.0, 0.4], rtol=1e-10, backwards=backwards)
    compare_with_differences(gradient, np.array([2000.0, 5.0, 1.9]), 5e-6)
    assert gradient.motion is not None
    assert {"ring", "cable"} <= set(gradient.motion.log.kind)


def test_gradients_backwards_are_those_of_columns_without_cables_too() -> None:
    """A structure of springs, whose forces have no margin; backwards on request."""
    document = {**PRISM, "classes": {**PRISM["classes"]}}
    document["classes"]["cable"] = {**PRISM["classes"]["cable"], "tension_only": False}
    keys = ["classes.cable.spring_constant", "shape.prestress", "shape.height"]
    found = []
    for backwards in (False, True):
        gradient = LossGradient(document, keys, all_parts, 0.3, samples=7, rtol=1e-11, backwards=backwards)
        found.append(gradient(gradient.problem.start)[1])
        assert gradient.disagreement < 1e-9
        assert gradient.error is not None
        assert gradient.error < 1e-5
    np.testing.assert_allclose(found[1], found[0], rtol=1e-7)


@pytest.mark.parametrize("backwards", [False, True])
def test_the_error_of_a_gradient_is_found_without_it(backwards: bool) -> None:
    """By differences: a loss that states derivatives too large by a tenth is seen; both ways share them."""

    def wrong(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        value, parts = end_height(motion)
        return value, {name: 1.1 * part for name, part in parts.items()}

    errors = []
    for loss in (end_height, wrong):
        gradient = LossGradient(FALL, ROPE, loss, 1.5, samples=[0.0, 1.5], backwards=backwards)
        gradient(gradient.problem.start)
        errors.append(gradient.error)
        assert gradient.disagreement < 1e-9
    assert errors == pytest.approx([0.0, 1.0 - 1.0 / 1.1], abs=1e-5)
    silent = LossGradient(FALL, ROPE, end_height, 1.5, backwards=backwards)
    silent.check = False
    silent(silent.problem.start)
    assert silent.error is None


DROPPED: dict[str, Any] = {
    "name": "dropped",
    "gravity": [0.5, 0.2, -9.81],
    "model": {"quantities": ["acceleration"]},
    "classes": {
        "bar": {"kind": "bar", "spring_constant": 3e4, "mass": 0.05, "damping": 2.0},
        "cable": {"kind": "cable", "spring_constant": 300.0, "damping": 0.6},
    },
    "shape": {
        "kind": "prism",
        "bars": 3,
        "bottom_radius": 0.15,
        "height": 0.3,
        "node_mass": 0.05,
        "prestress": 0.6,
    },
    "ground": {
        "stiffness": 2e4,
        "dissipation": 0.3,
        "friction": 0.4,
        "stick_stiffness": 2e4,
        "stick_damping": 15.0,
        "offset": -0.15,
    },
}


@pytest.mark.parametrize(("t_end", "slack", "touches"), [(0.35, 30, 12), *thorough((0.6, 50, 60))])
def test_remainders_of_taylor_are_of_second_order_through_jumps(
    t_end: float, slack: int, touches: int
) -> None:
    """Damped cables go slack and are pulled taut, feet touch, slip and stick; ten numbers at once."""
    keys = [
        *("classes.bar.spring_constant", "classes.cable.spring_constant", "classes.cable.damping"),
        *("shape.node_mass", "shape.prestress", "shape.height", "gravity[0]"),
        *("ground.stiffness", "ground.friction", "ground.dissipation"),
    ]

    def loss(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        weight = np.zeros_like(motion.node_position)
        weight[-1] = np.arange(18.0).reshape(6, 3) - 8.5
        return float((motion.node_position * weight).sum()), {"node_position": weight}

    gradient = LossGradient(DROPPED, keys, loss, t_end, samples=[0.0, t_end], rtol=1e-12)
    start = gradient.problem.start
    value, slopes = gradient(start)
    assert gradient.motion is not None
    kinds = gradient.motion.log.kind
    assert kinds.count("cable") >= slack
    assert kinds.count("ground") >= touches
    for seed in range(3):
        way = np.random.default_rng(seed).normal(size=len(keys)) * start
        left = [abs(gradient(start + h * way)[0] - value - h * slopes @ way) for h in (2e-5, 1e-5)]
        assert left[1] > 1e-10, "larger than the error of the motion"
        assert np.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize(("kind", "backwards"), [("linear", False), ("cubic", False), ("linear", True)])
def test_knots_of_a_profile_have_derivatives(kind: Any, backwards: bool) -> None:
    """Of a winch that turns while the damped cable is pulled taut, beside a number of the scene."""
    schedule = Profile([0.0, 0.4, 0.8, 1.5], {"winch": [0.0, -0.1, 0.05, 0.0]}, kind)
    keys = [ROPE[0], "profile.winch[1]", "profile.winch[2]"]
    gradient = LossGradient(
        WOUND, keys, all_parts, 1.5, samples=5, rtol=1e-11, schedule=schedule, backwards=backwards
    )
    compare_with_differences(gradient, np.array([100.0, -0.1, 0.05]), 1e-5)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_motion_starts_where_its_arguments_say(backwards: bool) -> None:
    """The weight is thrown upwards from elsewhere; derivatives are those of that motion."""
    start = {"coordinate": [-0.7], "velocity": [0.4]}
    gradient = LossGradient(
        FALL, ROPE[:2], all_parts, 1.5, samples=5, rtol=1e-11, arguments=start, backwards=backwards
    )
    compare_with_differences(gradient, np.array([100.0, 2.0]), 1e-5)
    assert gradient.motion is not None
    assert gradient.motion.coordinate[0] == pytest.approx(-0.7)
    assert gradient.motion.velocity[0] == pytest.approx(0.4)


def test_a_winch_holds_a_weight_where_it_shall_be() -> None:
    """Knots so that the weight is at -1.2 m from 1 s on, with little motion."""

    def loss(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        late = motion.time > 1.0
        away = np.zeros_like(motion.node_position)
        away[late, 1, 2] = motion.node_position[late, 1, 2] + 1.2
        speed = np.zeros_like(away)
        speed[late] = 0.05 * motion.node_velocity[late]
        value = 0.5 * float((away**2).sum() + (speed * motion.node_velocity).sum())
        return value, {"node_position": away, "node_velocity": speed}

    schedule = Profile(np.linspace(0.0, 2.0, 6), {"winch": np.zeros(6)})
    keys = [f"profile.winch[{k}]" for k in range(6)]
    gradient = LossGradient(WOUND, keys, loss, 2.0, samples=41, schedule=schedule)
    found = optimise(gradient, bounds=dict.fromkeys(keys, (-0.3, 0.3)), max_iterations=60)
    assert found.loss < 0.05 * found.start_loss
    assert found.schedule is not None
    np.testing.assert_array_equal(found.schedule.values["winch"], found.value)
    assert np.abs(found.value).max() <= 0.3
    assert found.document == WOUND or found.document["members"] == WOUND["members"]


def test_a_minimum_has_no_gradient_and_bounds_hold() -> None:
    def loss(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        away = np.zeros_like(motion.node_position)
        away[-1, 1, 2] = motion.node_position[-1, 1, 2] + 1.1
        return 0.5 * float(away[-1, 1, 2] ** 2), {"node_position": away}

    gradient = LossGradient(FALL, ROPE[:1], loss, 1.5)
    free = optimise(gradient)
    assert free.status == "ok"
    assert free.loss < 1e-9
    assert free.motion.node_position[-1, 1, 2] == pytest.approx(-1.1, abs=1e-4)
    bound = optimise(gradient, bounds={ROPE[0]: (99.0, 101.0)})
    assert 99.0 <= bound.value[0] <= 101.0
    assert bound.document["members"]["rope"]["spring_constant"] == bound.value[0]


@pytest.mark.parametrize(
    ("loss", "error", "word"),
    [
        (lambda motion: 1.0, InvalidValueError, "mapping of its derivatives"),
        (lambda motion: (1.0, {"energy": 0.0}), InvalidValueError, "node_position"),
        (lambda motion: (1.0, {"member_length": np.zeros(3)}), InvalidValueError, "another shape"),
        (lambda motion: (np.nan, {}), NonFiniteError, "not finite"),
    ],
)
def test_wrong_losses_are_refused(loss: Any, error: type[Exception], word: str) -> None:
    with pytest.raises(error, match=word):
        LossGradient(FALL, ROPE[:1], loss, 0.5)([100.0])


@pytest.mark.parametrize(
    ("keys", "schedule", "error", "word"),
    [
        (["profile.winch[1]"], None, InvalidValueError, "no profile"),
        (["profile.motor[1]"], Profile([0, 1], {"winch": [0, 0]}), UnknownNameError, "winch"),
        (["profile.winch[2]"], Profile([0, 1], {"winch": [0, 0]}), InvalidValueError, "fewer knots"),
    ],
)
def test_wrong_knots_are_refused(keys: list[str], schedule: Any, error: type[Exception], word: str) -> None:
    with pytest.raises(error, match=word):
        LossGradient(WOUND, keys, end_height, 1.0, schedule=schedule)


def test_wrong_values_and_bounds_are_refused() -> None:
    gradient = LossGradient(change(FALL), ROPE[:1], end_height, 0.5)
    with pytest.raises(InvalidValueError, match="one value a key"):
        gradient([1.0, 2.0])
    with pytest.raises(InvalidValueError, match="exclude"):
        optimise(gradient, bounds={ROPE[0]: (1.0, 2.0)})
