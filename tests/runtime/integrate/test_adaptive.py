"""Runge-Kutta with error control in C, 5(4) and 8(5,3): order, error control, kinks, and when it gives up."""

import functools
import re
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.accuracy import error_control, tolerance
from tensegrity_codegen.runtime.accuracy.error_control import tighten_until_converged
from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance, compare_runs
from tensegrity_codegen.runtime.integrate import c_run
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.tables.manifest import STATUS
from tests.models import load, simulator, start_of
from tests.runtime.build import bar, cable, make_structure, prism
from tests.runtime.integrate import nets

METHODS = ("rk54", "rk853")
each = pytest.mark.parametrize("method", METHODS)

STIFFNESS, MASS = 40.0, 0.1
FREQUENCY = np.sqrt(STIFFNESS / MASS)


@functools.cache
def oscillator(*, slack: bool = False, damping: float = 0.0) -> CompiledModel:
    """A mass on a line: x'' = -(k/m) (x - 1), or only while x > 1 if the spring is a cable."""
    member = cable if slack else bar
    structure = make_structure(
        [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0]],
        [member(0, 1, rest=1.0, mu=STIFFNESS)],
        anchored={0: "xyz"},
        mass=MASS,
        axes="x",
    )
    return simulator(structure.with_changes(damping=np.full(1, damping)), *METHODS)


def integrate(
    method: str, model: CompiledModel, time: np.ndarray, rtol: float, atol: float, **given: Any
) -> RawTrajectory:
    return integrate_adaptive(Motion(model, start_of(model), time, **given), RunOptions(method, rtol, atol))


def single(rtol: float, atol: float, n: int) -> Tolerance:
    """The tolerance of n coordinates, each by itself."""
    return Tolerance(rtol, atol, atol, np.arange(n), tuple(f"x{k}" for k in range(n)))


def exact(time: np.ndarray) -> np.ndarray:
    return 1.0 + 0.2 * np.cos(FREQUENCY * time)


def exact_speed(time: np.ndarray) -> np.ndarray:
    return -0.2 * FREQUENCY * np.sin(FREQUENCY * time)


@each
@pytest.mark.parametrize("rtol", [1e-4, 1e-9])
def test_a_harmonic_motion_is_met_within_a_few_tolerances(method: str, rtol: float) -> None:
    model, time = oscillator(), np.linspace(0.0, 1.0, 57)
    run = integrate(method, model, time, rtol, rtol * 1e-2)
    assert run.status == "ok"
    np.testing.assert_allclose(run.state[:, 0], exact(time), atol=30 * rtol)


@pytest.mark.parametrize(("method", "least", "most"), [("rk54", 8.0, 12.5), ("rk853", 3.5, 5.0)])
def test_the_number_of_steps_grows_as_the_order_says(method: str, least: float, most: float) -> None:
    """At order p the step goes with the p-th root of the tolerance: 10^5 in tolerance, 10^(5/p) in steps."""
    model, time = oscillator(), np.linspace(0.0, 20.0, 3)
    counts = [integrate(method, model, time, tol, tol).n_steps for tol in (1e-5, 1e-10)]
    assert least < counts[1] / counts[0] < most


@functools.cache
def pendulum() -> CompiledModel:
    """A mass on a spring that swings in a plane: smooth, not linear."""
    structure = make_structure(
        [[0.0, 0.0, 0.0], [1.0, 0.0, -0.3]],
        [bar(0, 1, rest=1.0, mu=STIFFNESS)],
        anchored={0: "xyz"},
        axes="xz",
        gravity=(0.0, 0.0, -9.81),
    )
    return load(structure, "acceleration", integrators=METHODS)


def end_of_equal_steps(method: str, model: CompiledModel, t_end: float, count: int) -> np.ndarray:
    """The state after `count` equal steps: each call is given the time of one, and a tolerance for any."""
    time = np.linspace(0.0, t_end, count + 1)
    bound = BoundIntegrator(method, Motion(model, start_of(model), time[[0, -1]]))
    now, run = bound.ffi.new("double *"), bound.ffi.new("integrator_run *")
    for end in time[1:].tolist():
        step = bound.ffi.new("double *", 1.0)
        given = (end, 1e9, 1e9, 1, now, step, bound.pointer(bound.state), *bound.arguments(), 0)
        null = bound.ffi.NULL
        assert bound.call(*given, null, null, bound.n_sampled, run, bound.pointer(bound.work)) == 0
    assert (run.n_accepted, run.n_rejected, now[0]) == (count, 0, t_end)
    return bound.state


@pytest.mark.parametrize(
    ("method", "order", "counts"), [("rk54", 5, (40, 80, 160)), ("rk853", 8, (24, 40, 72))]
)
def test_the_error_of_equal_steps_falls_as_the_order_says(
    method: str, order: int, counts: tuple[int, ...]
) -> None:
    model = pendulum()
    best = end_of_equal_steps("rk853", model, 2.0, 640)
    assert np.abs(end_of_equal_steps("rk853", model, 2.0, 480) - best).max() < 2e-14
    errors = [np.abs(end_of_equal_steps(method, model, 2.0, count) - best).max() for count in counts]
    assert errors[-1] > 2e-13
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(order, abs=0.6)


@each
def test_samples_between_steps_are_as_good_as_those_at_steps(method: str) -> None:
    model = oscillator()
    time = np.linspace(0.0, 2.0, 2001)
    run = integrate(method, model, time, 1e-9, 1e-11)
    assert run.n_steps < 1000
    assert np.abs(run.state[:, 0] - exact(time)).max() < 1e-8
    assert np.abs(run.state[:, 1] - exact_speed(time)).max() < 1e-6


def test_dense_output_of_rk853_costs_evaluations_only_where_samples_fall() -> None:
    model, ends, many = oscillator(), np.array([0.0, 2.0]), np.linspace(0.0, 2.0, 2001)
    plain, sampled, few = (
        integrate("rk853", model, time, 1e-9, 1e-11)
        for time in (ends, many, np.array([0.0, 0.5, 0.500001, 2.0]))
    )
    tried = int(plain.message.split(", ")[1].split()[0])
    started = plain.n_evaluations - 12 * plain.n_steps - 11 * tried
    assert 1 < started <= 4  # the start, and what the first step is chosen by
    assert 0.8 < (sampled.n_evaluations - plain.n_evaluations) / (3 * plain.n_steps) <= 1.0
    assert few.n_evaluations == plain.n_evaluations + 3


def test_a_cable_that_goes_slack_with_a_jump_of_its_damping_force_is_met() -> None:
    """A damped cable lets go with a finite force: the step shrinks at the jump, it does not pass it."""
    model = oscillator(slack=True, damping=0.4)
    found = simulate(model, 1.0, samples=21, rtol=1e-8, stepping=Stepping(atol=1e-10))
    check = simulate(model, 1.0, samples=21, rtol=1e-11, stepping=Stepping(atol=1e-13), method="scipy_dop853")
    assert found.status == "ok"
    assert np.abs(found.coordinate - check.coordinate).max() < 1e-7
    assert found.member_tension[0, 0] > 0.0
    assert found.member_tension[-1, 0] == 0.0


@each
def test_the_same_bits_come_out_in_one_call_and_in_many(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, time = oscillator(), np.linspace(0.0, 30.0, 11)
    calls: list[float] = []
    one = integrate(method, model, time, 1e-10, 1e-12)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 7)
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", 0.0)
    many = integrate(method, model, time, 1e-10, 1e-12, progress=calls.append)
    assert len(calls) > 50
    assert calls[-1] == 1.0
    assert (one.n_steps, one.n_evaluations) == (many.n_steps, many.n_evaluations)
    np.testing.assert_array_equal(one.state, many.state)


@each
def test_a_tolerance_that_no_step_meets_is_not_converged(method: str) -> None:
    model = oscillator()
    run = integrate(method, model, np.linspace(0.0, 1.0, 3), 1e-300, 1e-300)
    assert run.status == "not_converged"
    assert len(run.time) < 3


@each
def test_a_time_out_of_reach_is_given_up_early(method: str) -> None:
    model = oscillator()
    run = integrate(method, model, np.array([0.0, 1e12]), 1e-8, 1e-8)
    assert run.status == "not_converged"
    assert "too many steps" in run.message


def test_the_tolerance_is_tightened_over_rk853_too() -> None:
    model, time = oscillator(), np.linspace(0.0, 5.0, 51)

    def run(rtol: float, atol: float) -> RawTrajectory:
        return integrate("rk853", model, time, rtol, atol)

    found = tighten_until_converged(run, single(1e-9, 1e-11, 1))
    error = np.abs(found.state[:, 0] - exact(time)) / (1e-11 + 1e-9 * np.abs(found.state[:, 0]))
    assert (found.status, found.method) == ("ok", "rk853, tolerance tightened")
    assert found.error_estimate is not None
    assert error.max() <= found.error_estimate <= 1.0


def test_rounds_that_would_take_too_long_are_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def run(rtol: float, atol: float) -> RawTrajectory:
        asked.append(rtol)
        count = round(1000 * rtol**-0.2)
        state = np.full((3, 2), 1.0 + 1e5 * rtol)
        return RawTrajectory(np.linspace(0, 1, 3), state, "ok", "", "rk54", count, 6 * count)

    monkeypatch.setattr(error_control, "MAX_WORK", 2 * 6 * 1000 * (1e-6**-0.2 + 1.1 * 1e-7**-0.2))
    found = tighten_until_converged(run, single(1e-6, 1e-9, 1))
    assert asked == pytest.approx([1e-6, 1e-7])
    assert (found.status, found.n_steps) == ("not_converged", round(1000 * 1e-7**-0.2))
    assert found.error_estimate is not None
    assert found.error_estimate > 1.0
    assert "too long" in found.message
    assert "`rtol`" in found.message
    monkeypatch.setattr(error_control, "MAX_WORK", 1.0)
    assert tighten_until_converged(run, single(1e-6, 1e-9, 1)).error_estimate is None


def test_differences_of_runs_are_found_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    states = rng.normal(size=(2, 7, 6))
    loose, tight = (RawTrajectory(np.linspace(0, 1, 7), state, "ok", "", "rk54", 1, 1) for state in states)
    whole = compare_runs(loose, tight, single(1e-3, 1e-6, 3))
    monkeypatch.setattr(tolerance, "BLOCK_SIZE", 10)
    assert compare_runs(loose, tight, single(1e-3, 1e-6, 3)) == whole
    ratio = np.abs(states[1] - states[0]) / (1e-6 + 1e-3 * np.abs(states[1]))
    assert whole.error == pytest.approx(ratio.max(), rel=1e-12)
    row, column = np.unravel_index(ratio.argmax(), ratio.shape)
    kind = "position" if column < 3 else "velocity"
    assert whole.where == f"in the {kind} of x{column % 3} at t = {tight.time[row]:.4g} s"


@pytest.mark.parametrize("method", ["rk853", "radau"])
def test_c_refuses_to_go_back_in_time(method: str) -> None:
    """An end before the time, and a run that is used again from an earlier time without being set to zero."""
    model = simulator(nets.net(rod=80.0), "rk853", "radau")
    bound = BoundIntegrator(method, Motion(model, start_of(model), np.array([0.0, 1.0])))
    time, step = bound.ffi.new("double *", 0.5), bound.ffi.new("double *")
    run = bound.ffi.new("integrator_run *")
    count, vibration = bound.ffi.new("long long[16]"), bound.ffi.new("double[3]")
    null, bound.n_sampled[0] = bound.ffi.NULL, 0
    watched = (run,) if method == "radau" and bound.spec.events else ()

    def call(time_end: float) -> str:
        told = (null, bound.n_sampled, 0.0, count, vibration) if method == "radau" else (bound.n_sampled, run)
        tail = (0, null, null, *told, *watched, bound.pointer(bound.work))
        head = (time_end, 1e-6, 1e-9, 10_000, time, step, bound.pointer(bound.state))
        return STATUS[bound.call(*head, *bound.arguments(), *tail)]

    assert call(0.4) == "invalid_argument"
    assert call(0.5) == "ok"
    assert call(0.6) == "ok"
    assert call(0.7) == "ok"  # goes on
    time[0] = 0.5
    state = bound.state.copy()
    assert call(0.7) == "invalid_argument"
    np.testing.assert_array_equal(bound.state, state)
    bound.ffi.memmove(run, bound.ffi.new("integrator_run *"), bound.ffi.sizeof("integrator_run"))
    step[0] = 0.0
    bound.ffi.memmove(count, bound.ffi.new("long long[16]"), 128)
    assert (call(0.7), time[0]) == ("ok", 0.7)


@each
def test_steps_by_two_errors_are_rejected_less_often(method: str) -> None:
    """Where stability limits steps, each grows until one fails, if it follows the last error alone."""
    model = simulator(prism(140.0, bar_stiffness=1e5), method)
    motion = Motion(model, start_of(model), np.array([0.0, 0.5]))
    rejected = []
    for is_open in (False, True):
        found = integrate_adaptive(motion, RunOptions(method, 1e-4, 1e-5, is_open=is_open))
        accepted, failed = (int(word) for word in re.findall(r"(\d+) (?:steps|rejected)", found.message))
        assert found.n_steps == accepted
        rejected.append(failed / accepted)
    assert rejected[0] > max(0.1, 3.0 * rejected[1])
