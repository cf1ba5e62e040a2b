"""What "ok" means: the estimate is at most one tolerance, node by node, for every method and any place."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.accuracy.error_control import tighten_until_converged
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_length
from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance, compare_runs, tolerance_for
from tensegrity_codegen.runtime.integrate.event_log import EventLog
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tests.cases import thorough
from tests.models import simulator
from tests.runtime.build import bar, cable, make_structure, prism

DIRECTION = np.array([0.6, -0.7, 0.4])
METHODS = ("rk54", "rk853")
INTEGRATORS = (*METHODS, "radau")
each = pytest.mark.parametrize("method", METHODS)


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    structure = prism(anchored={0: "xyz"}, bar_stiffness=1e3)
    every = tuple(range(12))
    parameters = {"rest_length": every, "spring_constant": every, "anchor_position": (0,)}
    return simulator(structure, *INTEGRATORS, parameters=parameters)


def moved(
    model: CompiledModel, distance: float, *, stiffness: float = 1e3, size: float = 1.0
) -> dict[str, Any]:
    """A prism at rest that is out of balance, so far from the origin, and so many times as large."""
    offset, rng = distance * DIRECTION, np.random.default_rng(0)
    strain = 0.02 * rng.normal(size=12)
    spring = model.nominal("spring_constant").copy()
    spring[spring > 500.0] = stiffness
    return {
        "coordinate": size * model.nominal("coordinate") + np.tile(offset, 5),
        "arguments": {
            "rest_length": size * model.nominal("rest_length") * (1.0 + strain),
            "spring_constant": spring,
            "anchor_position": size * model.nominal("anchor_position") + offset,
        },
    }


def trajectory(state: np.ndarray) -> RawTrajectory:
    return RawTrajectory(np.linspace(0.0, 1.0, len(state)), state, "ok", "", "rk54", 10, 60)


def of_one_node(rtol: float, atol: float) -> Tolerance:
    return Tolerance(rtol, atol, atol, np.array([0]), ("node top",))


def test_runs_that_stay_a_few_tolerances_apart_are_not_ok_and_the_worst_node_is_named() -> None:
    calls: list[float] = []

    def run(rtol: float, atol: float) -> RawTrajectory:
        calls.append(rtol)
        state = np.ones((5, 6))
        state[3, 3:] += 4e-6 * (-1.0) ** len(calls)
        return trajectory(state)

    found = tighten_until_converged(run, of_one_node(1e-6, 1e-9))
    assert found.status == "not_converged"
    assert found.error_estimate is not None
    assert 1.0 < found.error_estimate < 20.0
    assert "in the velocity of node top at t = 0.75 s" in found.message


@pytest.mark.parametrize(("events", "state"), [(3, 1.0), (0, 2.0)])
def test_runs_with_loose_steps_that_pass_over_the_same_events_are_not_enough(
    events: int, state: float
) -> None:
    """Two runs at steps above 1e-3 agree on 2, and tighter ones find events and 1."""

    def run(rtol: float, atol: float) -> RawTrajectory:
        found = trajectory(np.full((5, 6), 2.0 if rtol > 5e-4 else 1.0))
        return replace(found, log=EventLog(count=events))

    found = tighten_until_converged(run, of_one_node(2e-2, 1e-3))
    assert found.status == "ok"
    np.testing.assert_array_equal(found.state, state)


def test_runs_that_agree_state_no_less_than_their_steps_may_err() -> None:
    """The second run's steps are held to a tenth of the tolerance, of which a tenth is stated at least."""
    found = tighten_until_converged(lambda rtol, atol: trajectory(np.ones((5, 6))), of_one_node(1e-6, 1e-9))
    assert (found.status, found.error_estimate) == ("ok", pytest.approx(0.01))


@pytest.mark.parametrize(("growth", "samples", "part"), [(1.1, 41, 1.0), (1.5, 41, 0.3), (1.5, 5, 0.8)])
def test_a_difference_counts_in_full_where_tightening_took_hardly_more_steps(
    growth: float, samples: int, part: float
) -> None:
    """Positions of length 1 that are 0.9 tolerances apart, by steps held to a tenth.

    At few samples two runs may agree by chance, and more of their difference counts.
    """

    def run(rtol: float, atol: float) -> RawTrajectory:
        finer = rtol < 5e-7
        state = np.tile([1.0, 0, 0, 1.0, 0, 0], (samples, 1))
        state[2, 1] = 0.0 if finer else 0.9e-6
        return replace(trajectory(state), n_steps=int(100 * growth) if finer else 100)

    found = tighten_until_converged(run, of_one_node(1e-6, 1e-12))
    assert (found.status, found.error_estimate) == ("ok", pytest.approx(0.9 * part, rel=1e-4))


def test_much_tighter_steps_are_not_trusted_to_gain_more_than_a_factor_of_ten() -> None:
    """Runs off by 100, 10 and 1.2 tolerances: a tenth of the 8.8 between the last two is stated."""
    errors = iter([100e-6, 10e-6, 1.2e-6])

    def run(rtol: float, atol: float) -> RawTrajectory:
        state = np.tile([1.0, 0, 0, 1.0, 0, 0], (41, 1))
        state[2, 1] = next(errors)
        return replace(trajectory(state), n_steps=round(100 * (1e-6 / rtol) ** 0.125))

    found = tighten_until_converged(run, of_one_node(1e-6, 1e-12))
    assert (found.status, found.error_estimate) == ("ok", pytest.approx(0.88, rel=1e-3))


def test_a_motion_after_one_event_states_the_error_that_both_runs_share() -> None:
    """A mass falls freely until its cable is taut; then both runs take the same long step."""
    start = [[-0.915492978708352, 0.15234281967340824, 0.7636001355920886]]
    start += [[0.09139692941838806, 0.8907345640882731, -0.3440598560466254]]
    fall = make_structure(
        start,
        [cable(0, 1, 1.7905967311587268, 402.7013770617986)],
        anchored={0: "xyz"},
        mass=2.4513167718238864,
        gravity=(0.0, 0.0, -9.81),
    )
    model = simulator(fall, "rk853")
    given: dict[str, Any] = {
        "samples": np.linspace(0.0, 0.3740595698921596, 17),
        "velocity": [-2.153182957769682, -3.7834456895801156, -0.1602602437939191],
        "method": "rk853",
    }
    rtol = 9.692426169575759e-06
    found = simulate(model, 0.3740595698921596, rtol=rtol, stepping=Stepping(atol=2e-9), **given)
    exact = simulate(model, 0.3740595698921596, rtol=1e-12, stepping=Stepping(control="steps"), **given)
    off = np.linalg.norm(found.velocity - exact.velocity, axis=1)
    off /= 2e-9 + rtol * np.linalg.norm(exact.velocity, axis=1)
    assert found.error_estimate is not None
    assert 5e-4 < off.max() < 3.0 * found.error_estimate
    assert found.error_estimate == pytest.approx(0.01)


def test_a_run_that_events_hold_up_says_where_and_does_not_ask_for_looser_tolerances() -> None:
    def run(rtol: float, atol: float) -> RawTrajectory:
        found = trajectory(np.ones((5, 6)))
        if rtol > 5e-7:
            return found
        return replace(found, status="too_many_events", message="events follow", evidence={"stopped_at": 0.6})

    found = tighten_until_converged(run, of_one_node(1e-6, 1e-9))
    assert (found.status, found.evidence["stopped_at"]) == ("too_many_events", 0.6)
    assert "take another method or other tolerances" in found.message
    assert "loosen" not in found.message


@pytest.mark.parametrize(("last", "is_told"), [(3, True), (4, False)])
def test_a_difference_that_the_motion_amplifies_and_forgets_is_told_at_the_end(
    last: int, is_told: bool
) -> None:
    """Bounces in which two runs have nothing in common, whatever their steps are, and rest after them."""
    calls: list[float] = []

    def run(rtol: float, atol: float) -> RawTrajectory:
        calls.append(rtol)
        state = np.ones((5, 6))
        state[2 : last + 1, 3:] += 0.1 * (-1.0) ** len(calls)
        state[4, 0] += 5e-6 * (-1.0) ** len(calls)
        return trajectory(state)

    found = tighten_until_converged(run, of_one_node(1e-6, 1e-9))
    assert found.status == "not_converged"
    end = ", which the motion amplifies and forgets: 5.77 times the tolerance at the end"
    assert (end in found.message) == is_told


def test_errors_do_not_depend_on_how_the_axes_lie() -> None:
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    state, other = rng.normal(size=(2, 7, 6))
    other = state + 1e-6 * other
    turned = [np.hstack([part[:, :3] @ turn.T, part[:, 3:] @ turn.T]) for part in (state, other)]
    tolerance = of_one_node(1e-6, 1e-12)
    here = compare_runs(trajectory(state), trajectory(other), tolerance)
    there = compare_runs(*(trajectory(part) for part in turned), tolerance)
    assert there.error == pytest.approx(here.error, rel=1e-9)


NEAR = [("rk853", 0.0), ("rk853", 1e5), ("rk54", 1e6), ("radau", 1e5)]
OTHERS = [case for case in product(INTEGRATORS, (0.0, 1e5, 1e6)) if case not in NEAR]


@pytest.mark.parametrize(("method", "distance"), [*NEAR, *thorough(*OTHERS)])
def test_velocities_beyond_the_tolerance_by_rounding_are_bounded(
    model: CompiledModel, method: str, distance: float
) -> None:
    rtol, atol = (1e-9, 1e-10) if method == "radau" else (1e-11, 1e-12)
    tight: dict[str, Any] = {
        "method": "rk853",
        "rtol": 1e-13,
        "stepping": Stepping(atol=1e-13, control="steps"),
    }
    truth = simulate(model, 0.3, samples=11, **moved(model, 0.0), **tight)
    found = simulate(
        model,
        0.3,
        samples=11,
        method=method,
        rtol=rtol,
        stepping=Stepping(atol=atol),
        **moved(model, distance),
    )
    assert found.status == "ok"
    bound = found.evidence.get("vibration_speed_error", 0.0)
    speed = np.abs(found.velocity - truth.velocity)
    assert np.all(speed <= bound + 10.0 * (atol + rtol * np.abs(truth.velocity)))
    assert (bound > 0.0) == ("velocities may be wrong by up to" in found.message)
    assert bound <= 1e-3 * np.abs(truth.velocity).max()
    if distance:
        assert bound > 0.0


def test_two_loose_runs_that_lose_the_same_vibration_are_not_ok() -> None:
    """Two masses on a stiff spring fly fast; the vibration is 30 tolerances, each step takes little of it."""
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [bar(0, 1, 1.0, 1e6)], axes="x")
    model = simulator(structure, "rk853")
    for speed, shake, t_end, rtol in ((100.0, 8.0, 0.3, 10**-2.6), (10.0, 2.0, 0.1, 10**-2.2)):
        options: dict[str, Any] = {
            "method": "rk853",
            "rtol": rtol,
            "stepping": Stepping(atol=1e-3 * rtol),
            "samples": 11,
        }
        found = simulate(model, t_end, velocity=[speed - shake, speed + shake], **options)
        swing = shake * np.cos(np.sqrt(2e6) * found.time)
        exact = speed + swing[:, None] * np.array([-1.0, 1.0])
        error = np.abs(found.velocity - exact) / (1e-3 * rtol + rtol * np.abs(exact))
        assert found.status == "ok"
        assert error.max() <= 1.0


@each
def test_a_structure_a_hundred_times_as_large_takes_the_same_steps(model: CompiledModel, method: str) -> None:
    small, large = (
        simulate(model, 0.3, method=method, rtol=1e-9, **moved(model, 0.0, size=s)) for s in (1.0, 100.0)
    )
    assert large.status == small.status == "ok"
    apart = np.abs(large.velocity / 100.0 - small.velocity).max()
    assert apart < 1e-8 * np.abs(small.velocity).max() + 1e-9


def test_an_absolute_tolerance_that_is_given_is_kept(model: CompiledModel) -> None:
    assert set_atol_by_length(model.manifest, RunOptions(atol=1e-5)).atol == 1e-5
    size = np.ptp(model.manifest.stated_position, axis=0).max()
    assert set_atol_by_length(model.manifest, RunOptions(rtol=1e-4)).absolute == pytest.approx(1e-4 * size)
    assert set_atol_by_length(model.manifest, RunOptions(rtol=1e-12)).absolute == pytest.approx(1e-9 * size)
    of_steps = set_atol_by_length(model.manifest, RunOptions(rtol=1e-4, control="steps"))
    assert of_steps.absolute == pytest.approx(1e-9 * size)


def test_the_tolerance_of_velocities_follows_the_largest_speed(model: CompiledModel) -> None:
    found = simulate(model, 0.3, rtol=1e-4)
    size = np.ptp(model.manifest.stated_position, axis=0).max()
    assert found.evidence["atol"] == pytest.approx(1e-4 * size)
    speed = np.linalg.norm(found.node_velocity, axis=2).max()
    assert found.evidence["atol_speed"] == pytest.approx(1e-4 * speed, rel=1e-2)
    stated = simulate(model, 0.3, rtol=1e-4, stepping=Stepping(atol=1e-7))
    assert (stated.evidence["atol"], stated.evidence["atol_speed"]) == (1e-7, 1e-7)


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6, 1e-8])
def test_errors_are_not_far_below_what_was_asked_for(model: CompiledModel, rtol: float) -> None:
    exact = simulate(model, 0.3, rtol=1e-12, method="rk853", stepping=Stepping(atol=1e-12))
    found = simulate(model, 0.3, rtol=rtol)
    tolerance = tolerance_for(model.manifest, rtol, found.evidence["atol"], found.evidence["atol_speed"])
    exactly = np.hstack([exact.coordinate, exact.velocity])
    apart = tolerance.lengths(np.hstack([found.coordinate, found.velocity]) - exactly)
    true = float((apart / tolerance.allowed(exactly)).max())
    assert 1e-5 < true < 2.0 * found.error_estimate <= 2.0
