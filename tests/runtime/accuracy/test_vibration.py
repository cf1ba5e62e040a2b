"""How stiff bars vibrate about their smooth motion, against closed forms and steps that resolve it."""

import functools

import numpy as np
import pytest

from tensegrity_codegen import Profile
from tensegrity_codegen.runtime.accuracy.rates import find_rates
from tensegrity_codegen.runtime.accuracy.vibration import find_vibration
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tests.models import simulator, start_of
from tests.runtime.build import bar, cable, make_structure

MASS, STIFF, SLOW, DAMPING, PULL, LOAD, SPAN = 2.0, 1e7, 400.0, 30.0, 20.0, 50.0, 0.2


def swinging_bar(*, settled: bool = True, damping: float = DAMPING) -> Structure:
    """A bar from (0, 0) to a mass at (1, 0), pulled down by the load, up by a damped cable to (0, 1)."""
    far = np.sqrt(2.0)
    pulled = PULL / far  # the smooth tension of the bar, compression
    rest = 1.0 + (pulled / STIFF if settled else 0.0)
    members = [
        bar(0, 1, rest, STIFF),
        cable(2, 1, far - PULL / SLOW, SLOW, damping=damping),
    ]
    return make_structure(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
        members,
        anchored={0: "xyz", 2: "xyz"},
        axes="xy",
        load={1: (0.0, -LOAD, 0.0)},
        mass=MASS,
    )


@pytest.mark.parametrize("settled", [True, False])
def test_vibrations_start_from_the_stretch_of_the_smooth_motion_and_its_rate(settled: bool) -> None:
    """The cable's damping makes the tension grow at once: T' = -c l'' / sqrt 2, l'' = -y'' / sqrt 2."""
    model = simulator(swinging_bar(settled=settled), "rk853", "radau")
    rates = find_rates(model, (0,), {})
    assert rates is not None
    vibration = find_vibration(Motion(model, start_of(model), np.array([0.0, 1.0])), (0,), rates)
    upward = (PULL / np.sqrt(2.0) - LOAD) / MASS
    smooth_rate = 0.5 * DAMPING * upward / STIFF
    stretch = 0.0 if settled else PULL / np.sqrt(2.0) / STIFF
    np.testing.assert_allclose(vibration.stretch, [stretch], rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(vibration.rate, [-smooth_rate], rtol=1e-3)


@pytest.mark.parametrize("what", ["damping", "motor"])
def test_implicit_steps_state_vibrations_that_the_first_rate_of_tension_starts(what: str) -> None:
    """They are too small for positions, and larger than velocities may be wrong by."""
    motor = ActuatedInput("motor", "rest_length", (1,))
    structure = swinging_bar(damping=DAMPING if what == "damping" else 0.0).with_changes(inputs=(motor,))
    model = simulator(structure, "rk853", "radau")
    ramp = Profile([0.0, SPAN], {"motor": [0.0, 0.1 if what == "motor" else 0.0]})
    run = functools.partial(simulate, model, SPAN, samples=21, schedule=ramp)
    found = run(method="radau", rtol=1e-6, stepping=Stepping(atol=1e-7))
    exact = run(method="rk853", rtol=1e-10, stepping=Stepping(atol=1e-13))
    assert (found.status, exact.status) == ("ok", "ok")
    off = np.abs(found.velocity - exact.velocity).max()
    stated = found.evidence["vibration_speed_error"]
    assert 1e-6 < off <= stated < 4.0 * off
    assert np.abs(found.coordinate - exact.coordinate).max() < 1e-6


def test_bars_without_stiffness_do_not_vibrate() -> None:
    rigid = swinging_bar().with_changes(
        spring_constant=np.array([0.0, SLOW]), rest_length=np.array([1.0, 1.2])
    )
    model = simulator(rigid, "rk853", "radau", formulation="rigid_bar")
    found, exact = (simulate(model, SPAN, samples=21, method=name) for name in ("radau", "rk853"))
    assert (found.status, exact.status) == ("ok", "ok")
    np.testing.assert_allclose(found.coordinate, exact.coordinate, atol=1e-5)
