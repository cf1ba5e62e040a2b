"""Symmetrical reconfiguration (SCS 5, 6): rest lengths, tensions, torque, and what is refused."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.studies.papers.scs.printed import PrintedTower
from tensegrity_codegen.studies.papers.scs.reconfiguration import (
    QuinticPath,
    TorqueFreePath,
    blend,
    plan_reconfiguration,
)
from tensegrity_codegen.studies.papers.scs.symmetry import GROUPS
from tensegrity_codegen.system.errors import InfeasibleError, InvalidValueError, NonFiniteError
from tests.studies.papers.scs.subjects import paper_motion, pose, torque_free, tower

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
        assert abs(torque_free(printed, alpha, delta, START)) < 1e-15
        # f' = 0, its derivatives by differences
        h = 1e-6
        by_alpha, by_delta = (
            (
                torque_free(printed, alpha + a, delta + d, START)
                - torque_free(printed, alpha - a, delta - d, START)
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


FIRST, LAST = pose(55.0, 40.0, 1.11066), pose(65.0, 35.0, 1.11066)


def test_tensions_and_torque_at_half_time() -> None:
    # 2.5 s into Figs 6 and 7; the height is the one of (44) to the digits that its tensions need.
    control = paper_motion("with_torque").control(2.5)
    assert np.abs(control.tension - (31.213, 4.354, 25.004)).max() < 5e-4
    assert control.input[2] == pytest.approx(-0.00512, abs=5e-6)


def test_record_starts_and_ends_at_the_printed_tensions() -> None:
    # SCS (44), (45)
    record = paper_motion("with_torque").sample(51)
    assert np.abs(record.tension[0] - (26.11, 1.85, 18.38)).max() < 0.006
    assert np.abs(record.tension[-1] - (46.97, 12.27, 43.0)).max() < 0.006
    assert (record.tension > 0).all()
    assert record.torque[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-13)
    assert record.residual.max() < 1e-12


def test_rest_lengths_are_those_of_35() -> None:
    record = paper_motion("with_torque").sample(11)
    assert 1000.0 * record.length / (record.tension + 1000.0) == pytest.approx(record.rest_length, rel=1e-14)


@pytest.mark.parametrize("name", ["with_torque", "zero_torque", "prescribed"])
def test_controls_are_32_and_33_with_the_corrected_34(name: str) -> None:
    plan = paper_motion(name)
    printed = PrintedTower.of(plan.tower)
    for time in (0.4, 1.9, 3.3):
        motion, control = plan.path.at(time), plan.control(time)
        expected = printed.tension(motion.s, motion.rate, motion.change, plan.force)
        assert control.tension == pytest.approx(expected, rel=1e-11)
        assert control.input[2] == pytest.approx(
            printed.torque(motion.s, motion.rate, motion.change), abs=1e-12
        )


def test_motion_without_torque_needs_none() -> None:
    # SCS (46): M_3 as the full model needs it, over the whole motion.
    assert np.abs(paper_motion("zero_torque").sample(51).torque).max() < 1e-12
    assert np.abs(paper_motion("prescribed").sample(51).torque).max() > 4e-3  # Fig. 11


def test_slow_motion_is_a_sequence_of_equilibria() -> None:
    plan = plan_reconfiguration(tower(), FIRST, LAST, duration=1e5)
    middle = plan.path.at(5e4).s
    still = tower().compute_control(middle, np.zeros(3), np.zeros(3), -50.0).tension
    assert plan.control(5e4).tension == pytest.approx(still, rel=1e-5)


def test_the_scenes_own_force_is_the_default() -> None:
    assert plan_reconfiguration(tower(), FIRST, LAST, duration=5.0).force == -50.0


def test_before_and_after_the_motion_rests() -> None:
    plan = paper_motion("with_torque")
    for early, late in ((-3.0, 0.0), (5.0, 8.0)):
        assert (plan.control(early).tension == plan.control(late).tension).all()


def test_summary_is_json() -> None:
    summary = json.loads(json.dumps(paper_motion("zero_torque").summary()))
    assert summary["end_deg"][1] == pytest.approx(22.036, abs=5e-4)
    assert summary["least_tension"]["saddle"]["time"] == 0.0


def test_too_fast_a_motion_says_when_and_which_tendon_pushes_first() -> None:
    with pytest.raises(InfeasibleError, match="the vertical tendons would have to push") as caught:
        plan_reconfiguration(tower(), FIRST, LAST, duration=0.3)
    when = float(str(caught.value.evidence["time"]).removesuffix(" s"))
    printed, slow = PrintedTower.of(tower()), plan_reconfiguration(tower(), FIRST, LAST, duration=5.0)
    # The tension is zero there: rates of the slow motion scale with time.
    motion = slow.path.at(when * 5.0 / 0.3)
    factor = 5.0 / 0.3
    tension = printed.tension(motion.s, motion.rate * factor, motion.change * factor**2, -50.0)
    assert dict(zip(GROUPS, tension, strict=True))["vertical"] == pytest.approx(0.0, abs=2e-3)


def test_an_end_that_cannot_stand_is_refused_with_its_tendons() -> None:
    with pytest.raises(InfeasibleError, match="saddle, vertical, diagonal would have to push") as caught:
        plan_reconfiguration(tower(), FIRST, pose(65.0, 50.0, 1.11066), duration=5.0)
    assert caught.value.where == "end"


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (pose(30.0, 40.0, 1.11066), "bars intersect"),
        (pose(60.0, 90.0, 1.11066), "declination"),
        (pose(60.0, 40.0, 1.2), "keeps the height"),
        (1.0, "needs the declination"),
    ],
)
def test_ends_out_of_bounds_are_refused(end: object, words: str) -> None:
    with pytest.raises(InvalidValueError, match=words):
        plan_reconfiguration(tower(), FIRST, end, duration=5.0)  # type: ignore[arg-type]


def test_an_azimuth_that_is_no_number_is_refused() -> None:
    with pytest.raises(NonFiniteError):
        plan_reconfiguration(tower(), FIRST, math.nan, duration=5.0, zero_torque=True)


def test_a_start_out_of_bounds_is_refused_by_name() -> None:
    with pytest.raises(InvalidValueError) as caught:
        plan_reconfiguration(tower(), pose(55.0, 40.0, 0.7), LAST, duration=5.0)
    assert caught.value.where == "start"


@pytest.mark.parametrize(("duration", "force"), [(0.0, -50.0), (math.nan, -50.0), (5.0, math.inf)])
def test_wrong_numbers_are_refused(duration: float, force: float) -> None:
    with pytest.raises(InvalidValueError, match="out of range"):
        plan_reconfiguration(tower(), FIRST, LAST, duration=duration, force=force)


def test_a_way_through_crossing_bars_is_refused_with_the_time() -> None:
    # Both ends stand; between them alpha makes a full turn, past 30 deg.
    turned = pose(65.0 - 360.0, 35.0, 1.11066)
    with pytest.raises(InfeasibleError) as caught:
        plan_reconfiguration(tower(), FIRST, turned, duration=500.0)
    assert "crossing at" in caught.value.evidence
    assert "singular at" in caught.value.evidence
