"""How stiff bars vibrate about their smooth motion, against closed forms and steps that resolve it."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.accuracy.rates import find_rates
from tensegrity_codegen.runtime.accuracy.vibration import find_vibration
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tests.models import simulator, start_of
from tests.runtime.build import bar, cable, make_structure

MASS, STIFF, SLOW, DAMPING, PULL, LOAD = 2.0, 1e7, 400.0, 30.0, 20.0, 50.0


def swinging_bar(*, settled: bool = True) -> Structure:
    """A bar from (0, 0) to a mass at (1, 0), pulled down by the load, up by a damped cable to (0, 1)."""
    far = np.sqrt(2.0)
    pulled = PULL / far  # the smooth tension of the bar, compression
    rest = 1.0 + (pulled / STIFF if settled else 0.0)
    members = [
        bar(0, 1, rest, STIFF),
        cable(2, 1, far - PULL / SLOW, SLOW, damping=DAMPING),
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
    vibration = find_vibration(model, start_of(model), (0,), rates, {})
    upward = (PULL / np.sqrt(2.0) - LOAD) / MASS
    smooth_rate = 0.5 * DAMPING * upward / STIFF
    stretch = 0.0 if settled else PULL / np.sqrt(2.0) / STIFF
    np.testing.assert_allclose(vibration.stretch, [stretch], rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(vibration.rate, [-smooth_rate], rtol=1e-3)


def test_implicit_steps_state_vibrations_that_start_with_the_damping_of_cables() -> None:
    """They are too small for positions, and larger than velocities may be wrong by."""
    model = simulator(swinging_bar(), "rk853", "radau")
    tight = Stepping(atol=1e-10)
    found = simulate(model, 0.2, samples=21, method="radau", rtol=1e-6, stepping=tight)
    exact = simulate(model, 0.2, samples=21, method="rk853", rtol=1e-10, stepping=Stepping(atol=1e-13))
    assert (found.status, exact.status) == ("ok", "ok")
    off = np.abs(found.velocity - exact.velocity).max()
    stated = found.evidence["vibration_speed_error"]
    assert 0.1 * stated < off <= stated
    assert np.abs(found.coordinate - exact.coordinate).max() < 1e-6
