"""Azimuth and declination over time (SCS 38 to 41, 48 to 51)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.studies.papers.scs.paths import QuinticPath, TorqueFreePath, blend
from tensegrity_codegen.studies.papers.scs.printed import PrintedTower
from tensegrity_codegen.system.errors import InfeasibleError
from tests.studies.papers.scs.subjects import pose, tower

START, DURATION = pose(70.0, 30.0, 1.60504), 5.0


def free_path(alpha_end: float = 65.0) -> TorqueFreePath:
    return TorqueFreePath.of(tower(), START, math.radians(alpha_end), DURATION)


@given(st.floats(0.0, 1.0), st.floats(0.1, 100.0))
def test_blend_is_the_bracket_of_39(x: float, tau: float) -> None:
    t = x * tau
    printed = 30 / tau**5 * (t**5 / 30 - t**4 / 6 * (t - tau) + t**3 / 3 * (t - tau) ** 2)
    assert blend(t, tau)[0] == pytest.approx(printed, abs=1e-12)


@pytest.mark.parametrize(("time", "value"), [(-1.0, 0.0), (0.0, 0.0), (5.0, 1.0), (7.0, 1.0)])
def test_blend_rests_at_both_ends_and_beyond(time: float, value: float) -> None:
    # SCS (36), (37)
    assert blend(time, 5.0) == (value, 0.0, 0.0)


@pytest.mark.parametrize("path", [QuinticPath(START, pose(60.0, 45.0, 1.60504), DURATION), free_path()])
@pytest.mark.parametrize("time", [0.7, 2.5, 4.4])
def test_rates_are_the_derivatives_of_the_angles(path: QuinticPath | TorqueFreePath, time: float) -> None:
    h = 1e-4
    before, now, after = (path.at(time + shift) for shift in (-h, 0.0, h))
    assert now.rate == pytest.approx((after.s - before.s) / (2 * h), abs=1e-7)
    assert now.change == pytest.approx((after.rate - before.rate) / (2 * h), abs=1e-7)


def test_path_without_torque_holds_48_to_51() -> None:
    printed, path = PrintedTower.of(tower()), free_path()
    for time in np.linspace(0.0, DURATION, 11):
        motion = path.at(float(time))
        alpha, delta, _ = motion.s
        assert abs(printed.torque_free(alpha, delta, START.alpha, START.delta)) < 1e-15
        # f' = 0, its derivatives by differences
        h = 1e-6
        by_alpha, by_delta = (
            (
                printed.torque_free(alpha + a, delta + d, START.alpha, START.delta)
                - printed.torque_free(alpha - a, delta - d, START.alpha, START.delta)
            )
            / (2 * h)
            for a, d in ((h, 0.0), (0.0, h))
        )
        assert by_delta * motion.rate[1] + by_alpha * motion.rate[0] == pytest.approx(0.0, abs=1e-10)


def test_path_without_torque_ends_at_the_declination_of_53() -> None:
    # Printed 22.03 deg; the digits are cut, not rounded.
    assert free_path().end.in_degrees[1] == pytest.approx(22.036, abs=5e-4)


@pytest.mark.parametrize("alpha_end", [71.9, 100.0, 250.0])
def test_an_azimuth_that_no_torque_free_motion_reaches_is_refused(alpha_end: float) -> None:
    start = pose(70.0, 80.0, 1.60504)
    with pytest.raises(InfeasibleError, match=r"SCS \(48\) has no declination") as caught:
        TorqueFreePath.of(tower(), start, math.radians(alpha_end), DURATION)
    assert caught.value.evidence["alpha_end_deg"] == pytest.approx(alpha_end)
