"""The record of a motion in time: knots, values in between, inputs for simulate."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import InvalidValueError


@pytest.fixture
def motion() -> Motion:
    time = np.linspace(0.0, 2.0, 5)
    share = time / 2.0
    q = share**3 * (10 - 15 * share + 6 * share**2)
    v = (30 * share**2 - 60 * share**3 + 30 * share**4) / 2.0
    a = (60 * share - 180 * share**2 + 120 * share**3) / 4.0
    return Motion(
        time=time,
        coordinate=q[:, None],
        velocity=v[:, None],
        acceleration=a[:, None],
        rest_length=1.0 + q[:, None],
        input=np.stack([np.zeros(5), time**3], axis=1),
        member_tension=np.ones((5, 1)),
        peak_rate=np.array([1.0]),
        actuators=("motor",),
        input_name=("push", "motor"),
    )


def test_a_quintic_is_itself_between_its_knots(motion: Motion) -> None:
    for time in (0.1, 0.77, 1.5, 1.93):
        s = time / 2.0
        point = motion.at(time)
        assert point.coordinate[0] == pytest.approx(s**3 * (10 - 15 * s + 6 * s**2), abs=1e-14)
        assert point.velocity[0] == pytest.approx((30 * s**2 - 60 * s**3 + 30 * s**4) / 2, abs=1e-13)
        assert point.acceleration[0] == pytest.approx((60 * s - 180 * s**2 + 120 * s**3) / 4, abs=1e-12)


def test_inputs_follow_the_cubic_of_the_profile(motion: Motion) -> None:
    profile = motion.profile()
    assert set(profile.values) == {"push", "motor"}
    assert motion.at(0.9).input == pytest.approx([0.0, 0.9**3], abs=1e-14)
    assert profile(0.9)["motor"] == pytest.approx(0.9**3, abs=1e-14)


def test_the_motion_is_at_rest_before_and_after(motion: Motion) -> None:
    for time, q in ((-1.0, 0.0), (2.5, 1.0)):
        point = motion.at(time)
        assert point.coordinate[0] == pytest.approx(q, abs=1e-14)
        assert point.velocity[0] == point.acceleration[0] == 0.0
    assert motion.at(7.0).input[1] == pytest.approx(8.0)


def test_arrays_of_a_motion_cannot_be_written(motion: Motion) -> None:
    with pytest.raises(ValueError, match="read-only"):
        motion.coordinate[0, 0] = 3.0


def test_fewer_knots_keep_the_ends_and_the_kinks(motion: Motion) -> None:
    """A quintic and a cubic are the same between fewer knots."""
    bent = replace(motion, kinks=(0.5,), residual=np.arange(5.0))
    fewer = bent.at_knots(3)
    assert fewer.time.tolist() == [0.0, 0.5, 1.0, 2.0]
    assert fewer.residual.tolist() == [0.0, 1.0, 2.0, 4.0]
    assert len(motion.at_knots(3).residual) == 0
    for time in np.linspace(-0.1, 2.1, 23).tolist():
        here, there = motion.at(time), fewer.at(time)
        assert there.input == pytest.approx(here.input, abs=1e-13)
        assert there.coordinate == pytest.approx(here.coordinate, abs=1e-13)
        assert there.velocity == pytest.approx(here.velocity, abs=1e-12)
    assert motion.at_knots(5) is motion
    with pytest.raises(InvalidValueError, match="from 2 on"):
        motion.at_knots(1)
