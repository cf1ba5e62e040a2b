"""Dormand and Prince's 5(4) in C: order, error control, kinks, and when it gives up."""

from __future__ import annotations

import numpy as np
import pytest

from tensegrity_codegen.errors import FormulationError, NonFiniteError
from tensegrity_codegen.pipeline import SIMULATION_QUANTITIES, build_library
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.rk54 import integrate_rk54
from tensegrity_codegen.runtime.simulate import simulate
from tests.runtime.build import bar, cable, make_structure

STIFFNESS, MASS = 40.0, 0.1
FREQUENCY = np.sqrt(STIFFNESS / MASS)


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
    structure = structure.with_changes(damping=np.full(1, damping))
    request = ModelRequest(SIMULATION_QUANTITIES, integrators=("rk4", "rk54"))
    return build_library(structure, request).load()


def state_of(model: CompiledModel) -> np.ndarray:
    return np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])


def exact(time: np.ndarray) -> np.ndarray:
    return 1.0 + 0.2 * np.cos(FREQUENCY * time)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_a_harmonic_motion_is_met_within_a_few_tolerances(rtol: float) -> None:
    model, time = oscillator(), np.linspace(0.0, 1.0, 57)
    run = integrate_rk54(model, state_of(model), time, rtol, rtol * 1e-2)
    assert run.status == "ok"
    np.testing.assert_allclose(run.state[:, 0], exact(time), atol=30 * rtol)


def test_the_number_of_steps_grows_as_order_five_says() -> None:
    """At order 5 the step goes with the fifth root of the tolerance: 10^5 in tolerance, 10 in steps."""
    model, time = oscillator(), np.linspace(0.0, 20.0, 3)
    counts = [integrate_rk54(model, state_of(model), time, tol, tol).n_steps for tol in (1e-5, 1e-10)]
    assert 8.0 < counts[1] / counts[0] < 12.5


def test_samples_between_steps_are_as_good_as_those_at_steps() -> None:
    model = oscillator()
    time = np.linspace(0.0, 2.0, 2001)
    run = integrate_rk54(model, state_of(model), time, 1e-9, 1e-11)
    assert run.n_steps < 1000
    assert np.abs(run.state[:, 0] - exact(time)).max() < 1e-8
    speed = -0.2 * FREQUENCY * np.sin(FREQUENCY * time)
    assert np.abs(run.state[:, 1] - speed).max() < 1e-6


def test_a_cable_that_goes_slack_with_a_jump_of_its_damping_force_is_met() -> None:
    """A damped cable lets go with a finite force: the step shrinks at the jump, it does not pass it."""
    model = oscillator(slack=True, damping=0.4)
    found = simulate(model, 1.0, samples=21, rtol=1e-8, atol=1e-10)
    check = simulate(model, 1.0, samples=21, rtol=1e-11, atol=1e-13, method="scipy_dop853")
    assert found.status == "ok"
    assert np.abs(found.coordinate - check.coordinate).max() < 1e-7
    assert found.member_tension[0, 0] > 0.0
    assert found.member_tension[-1, 0] == 0.0


def test_the_estimate_of_auto_is_an_upper_bound_of_its_error() -> None:
    model = oscillator()
    found = simulate(model, 5.0, samples=51, rtol=1e-7, atol=1e-9)
    error = np.abs(found.coordinate[:, 0] - exact(found.time)) / (
        1e-9 + 1e-7 * np.abs(found.coordinate[:, 0])
    )
    assert found.error_estimate is not None
    assert error.max() <= found.error_estimate <= 1.0


def test_the_same_bits_come_out_in_one_call_and_in_many() -> None:
    model, time = oscillator(), np.linspace(0.0, 30.0, 11)
    calls: list[float] = []
    one = integrate_rk54(model, state_of(model), time, 1e-10, 1e-12)
    many = integrate_rk54(model, state_of(model), time, 1e-10, 1e-12, progress=calls.append)
    assert len(calls) > 3
    assert calls[-1] == 1.0
    np.testing.assert_array_equal(one.state, many.state)


def test_energy_of_an_undamped_motion_is_kept_to_the_tolerance() -> None:
    found = simulate(oscillator(), 10.0, rtol=1e-9, atol=1e-12)
    assert found.energy_drift is not None
    assert found.energy_drift < 1e-7


def test_a_tolerance_that_no_step_meets_is_not_converged() -> None:
    model = oscillator()
    run = integrate_rk54(model, state_of(model), np.linspace(0.0, 1.0, 3), 1e-300, 1e-300)
    assert run.status == "not_converged"
    assert len(run.time) < 3


def test_a_time_out_of_reach_is_given_up_early() -> None:
    model = oscillator()
    run = integrate_rk54(model, state_of(model), np.array([0.0, 1e12]), 1e-8, 1e-8)
    assert run.status == "not_converged"
    assert "too many steps" in run.message


def test_a_state_that_is_not_finite_is_named() -> None:
    model = oscillator()
    with pytest.raises(NonFiniteError, match="state"):
        integrate_rk54(model, np.array([np.nan, 0.0]), np.linspace(0.0, 1.0, 3), 1e-6, 1e-9)


def test_a_library_without_it_says_how_to_get_it() -> None:
    structure = make_structure(
        [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0]], [bar(0, 1, rest=1.0, mu=40.0)], anchored={0: "xyz"}, mass=0.1
    )
    model = build_library(structure, ModelRequest(("acceleration",))).load()
    with pytest.raises(FormulationError, match="no integrator 'rk54'"):
        integrate_rk54(model, state_of(model), np.linspace(0.0, 1.0, 3), 1e-6, 1e-9)
