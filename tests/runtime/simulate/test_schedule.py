"""Parameters and inputs that change with time, against closed forms."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.methods import METHODS
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import Until, simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.cases import thorough
from tests.models import load
from tests.runtime.build import make_structure, spring

RATE = float(np.sqrt(200.0))  # of two masses of 1 kg on 100 N/m
DRIVE = 3.0  # [rad/s]
SCIPY = [name for name in METHODS if name.startswith("scipy_")]


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)])
    return load(structure, *SIMULATION_QUANTITIES, parameters={"rest_length": (0,)}, integrators=("rk4",))


def drive(time: float) -> dict[str, Any]:
    return {"rest_length": np.array([1.0 + 0.05 * np.sin(DRIVE * time)])}


def length(time: np.ndarray) -> np.ndarray:
    """l'' = -w^2 (l - rho), at rest at first: a forced oscillator."""
    gain = 0.05 * RATE**2 / (RATE**2 - DRIVE**2)
    return 1.0 + gain * (np.sin(DRIVE * time) - DRIVE / RATE * np.sin(RATE * time))


@pytest.mark.parametrize(
    "method", ["scipy_dop853", *thorough(*(name for name in SCIPY if name != "scipy_dop853"))]
)
def test_a_driven_rest_length_forces_an_oscillator(model: CompiledModel, method: str) -> None:
    run = simulate(
        model, 2.0, method=method, rtol=1e-9, stepping=Stepping(atol=1e-12, control="steps"), schedule=drive
    )
    expected = length(run.time)
    found = np.linalg.norm(run.node_position[:, 0] - run.node_position[:, 1], axis=1)
    np.testing.assert_allclose(found, expected, atol=3e-7)
    rest = 1.0 + 0.05 * np.sin(DRIVE * run.time)
    np.testing.assert_allclose(run.member_tension[:, 0], 100.0 * (expected - rest), atol=3e-5)


def test_energy_that_the_drive_brings_is_no_fault(model: CompiledModel) -> None:
    run = simulate(model, 2.0, method="scipy_dop853", schedule=drive)
    assert run.total_energy.max() > 0.01 > run.total_energy[0]
    assert run.status == "ok"
    assert run.energy_drift is None


def test_a_schedule_overrides_constant_arguments(model: CompiledModel) -> None:
    both = simulate(model, 1.0, method="scipy_rk45", schedule=drive, arguments={"rest_length": [3.0]})
    alone = simulate(model, 1.0, method="scipy_rk45", schedule=drive)
    assert (both.coordinate == alone.coordinate).all()


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_auto_follows_a_schedule_and_says_how(model: CompiledModel, rtol: float) -> None:
    run = simulate(model, 2.0, rtol=rtol, stepping=Stepping(atol=0.1 * rtol), schedule=drive)
    found = np.linalg.norm(run.node_position[:, 0] - run.node_position[:, 1], axis=1)
    np.testing.assert_allclose(found, length(run.time), atol=2 * rtol)
    assert run.status == "ok"
    assert run.error_estimate is not None
    assert run.method.startswith("auto (scipy")
    assert "schedule runs through SciPy" in run.why_method


def test_auto_takes_an_implicit_method_for_fast_damping() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz"})
    structure = structure.with_changes(damping=np.array([1e5]))
    model = load(structure, *SIMULATION_QUANTITIES, parameters={"rest_length": (0,)})
    run = simulate(model, 2.0, samples=5, rtol=1e-9, stepping=Stepping(atol=1e-11), schedule=drive)
    assert run.status == "ok"
    assert "scipy_radau" in run.why_method
    # Without mass the damper creeps: y' = a (0.05 sin(w t) - y).
    a, w, t = 100.0 / 1e5, DRIVE, 2.0
    creep = 0.05 * a * (a * np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-a * t)) / (a**2 + w**2)
    assert run.node_position[-1, 1, 0] - 1.0 == pytest.approx(creep, rel=2e-3)


def test_a_short_change_in_a_quiet_motion_is_not_passed_over(model: CompiledModel) -> None:
    """At rest steps would grow to seconds; the rest length changes for a tenth of a second."""

    def change(time: float) -> dict[str, list[float]]:
        return {"rest_length": [1.1 if 6.9 < time < 7.0 else 1.0]}

    run = simulate(model, 10.0, samples=11, schedule=change, stepping=Stepping(control="steps"))
    assert np.abs(run.velocity[:7]).max() == 0.0
    assert np.abs(run.velocity[7:]).max() > 0.1


def test_one_run_by_auto_is_not_checked(model: CompiledModel) -> None:
    run = simulate(model, 2.0, schedule=drive, stepping=Stepping(control="steps"))
    assert run.status == "ok"
    assert run.error_estimate is None


def test_a_method_with_constant_arguments_refuses_a_schedule(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="holds parameters and inputs constant") as caught:
        simulate(model, 1.0, method="rk4", stepping=Stepping(step=0.01), schedule=drive)
    assert "auto" in str(caught.value)
    assert "scipy_dop853" in str(caught.value)


def test_what_a_schedule_cannot_go_with_is_named(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="not monitor conditions"):
        simulate(model, 1.0, schedule=drive, until=Until(condition="time - 0.5", stops=False))
    with pytest.raises(InvalidValueError, match="energy cannot be kept"):
        simulate(model, 1.0, schedule=drive, stepping=Stepping(keep="energy"))


def test_unknown_words_of_a_schedule_are_refused(model: CompiledModel) -> None:
    with pytest.raises(UnknownNameError, match="no such argument"):
        simulate(model, 1.0, method="scipy_rk45", schedule=lambda _: {"rest_lenght": [1.0]})


def test_anchors_do_not_move() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz"})
    model = load(structure, *SIMULATION_QUANTITIES, parameters={"anchor_position": (0,)})
    with pytest.raises(InvalidValueError, match="anchor positions cannot change"):
        simulate(model, 1.0, method="scipy_rk45", schedule=lambda t: {"anchor_position": [[t, 0, 0]]})


def test_a_short_pulse_of_a_function_is_located_as_in_a_table(model: CompiledModel) -> None:
    """A rest length that is 0.1 m longer for 5 ms of 10 s: l'' = -w^2 (l - rho) after two steps of rho."""
    begin, width = 4.0117, 0.005

    def pulse(time: float) -> dict[str, Any]:
        return {"rest_length": np.array([1.1 if begin <= time < begin + width else 1.0])}

    run = simulate(model, 10.0, rtol=1e-9, stepping=Stepping(atol=1e-11), schedule=pulse)
    exact = 1.0 + 0.1 * (np.cos(RATE * (10.0 - begin - width)) - np.cos(RATE * (10.0 - begin)))
    assert run.status == "ok"
    assert float(np.diff(run.node_position[-1, :, 0])[0]) == pytest.approx(exact, abs=1e-9)
    assert "pulses of the schedule shorter than 0.0025 s are not seen" in run.message
