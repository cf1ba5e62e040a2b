"""The headline of a study of feedback: errors with and without feedback, smallest tension, limits."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.study.control_study import find_low_tensions
from tensegrity_codegen.control.feedback.study.loop_result import LoopResult, RunMeasures
from tensegrity_codegen.control.pages.control_finding import describe_control_finding, find_least_bound
from tensegrity_codegen.structure.limits import Limits


def measure(error: float, **changes: Any) -> RunMeasures:
    """Measures of one draw whose error at the end is given in mm."""
    made = RunMeasures("ok", error / 1000, error / 500, math.nan, "n1", 12.0, "c1", 12.5, {}, {"ok": 9}, 0.1)
    return replace(made, **changes)


def study_of(status: str, *, moves: bool = True, angles: bool = False, **rows: Any) -> Any:
    """What the headline reads of a study: its status, motion, draws and loops."""
    run: Any = None
    loops = {name: LoopResult.collect(name, measures, run) for name, measures in rows.items()}
    return SimpleNamespace(
        status=status, motion=SimpleNamespace(velocity=np.ones(3) * moves), drawn=(None, None),
        tuning=SimpleNamespace(scales=SimpleNamespace(is_angle=np.full(2, angles))), loops=loops,
    )  # fmt: skip


OPEN = (measure(6.4), measure(5.0))


def limit(least: float) -> Limits:
    return Limits(least_tension=np.array([least, -np.inf]))


def test_a_motion_that_is_kept() -> None:
    study = study_of("holds", open=OPEN, true_state=(measure(0.01),) * 2, estimator=(measure(0.4),) * 2)
    assert describe_control_finding(study, 2.0) == (
        "Feedback with the estimator keeps the motion within 0.4 mm at the end, 6.4 mm without feedback; "
        "smallest cable tension 12.5 N, limit 2 N"
    )
    rest = study_of("holds", moves=False, open=OPEN, true_state=(measure(0.01),) * 2)
    assert describe_control_finding(rest).startswith(
        "Feedback with the true state keeps the equilibrium within 0.01 mm at the end"
    )
    assert "limit" not in describe_control_finding(rest)


def test_draws_that_end_worse_are_counted() -> None:
    study = study_of("holds", open=OPEN, true_state=(measure(1.0), measure(5.5)))
    assert "6.4 mm without feedback, worse than that in 1 of 2 draws;" in describe_control_finding(study)


def test_angles_are_stated_in_degrees() -> None:
    rows = {
        "open": (measure(6.4, end_angle=math.radians(1.25)),),
        "true_state": (measure(0.4, end_angle=math.radians(0.0707)),),
    }
    text = describe_control_finding(study_of("holds", angles=True, **rows))
    assert "within 0.0707 deg at the end, 1.25 deg without feedback" in text


@pytest.mark.parametrize("opened", [0, 1])
def test_an_unstable_loop_is_named_with_its_draws(opened: int) -> None:
    stopped = measure(1e6, status="not_finite")
    rows = {"open": (stopped if opened else OPEN[0], OPEN[1]), "true_state": (measure(0.1),) * 2}
    study = study_of("unstable", **rows, estimator=(stopped, measure(1.0)))
    expected = "unstable without feedback" if opened else "6.4 mm without feedback"
    assert describe_control_finding(study) == (
        f"Feedback is unstable with the estimator in 1 of 2 draws; {expected}"
    )


def test_feedback_that_does_harm_is_stated() -> None:
    study = study_of("does_not_hold", open=OPEN, true_state=(measure(9.0), measure(2.0)))
    assert describe_control_finding(study) == (
        "Feedback does not keep the motion: 9 mm from it at the end with the true state, "
        "6.4 mm without feedback"
    )


def test_limits_that_are_exceeded_are_in_the_headline() -> None:
    broken = {"least_tension": ("c1", "c2"), "clearance": ("bar1_bar2",)}
    slack = (measure(0.4, end_tension=0.0, least_tension=0.0, broken=broken),)
    study = study_of("holds", open=OPEN[:1], true_state=slack)
    assert describe_control_finding(study, 2.0).endswith(
        "; smallest cable tension 0 N, limit 2 N; least tension not kept by c1, c2; clearance not kept by "
        "bar1_bar2"
    )
    assert find_low_tensions(study.loops, limit(2.0)) == ()  # it is among the limits that are not kept


def test_tensions_below_their_limit_on_the_way_are_stated() -> None:
    early = (measure(0.4, least_tension=0.25), measure(0.3))
    study = study_of("holds", open=OPEN, estimator=early)
    assert "12.5 N at the end, 0.25 N on the way, limit 2 N" in describe_control_finding(study, 2.0)
    (text,) = find_low_tensions(study.loops, limit(2.0))
    assert text == "estimator: c1 falls to 0.25 N on the way, below the least tension of 2 N"
    assert find_low_tensions(study.loops, limit(0.2)) == ()
    slack = study_of("holds", open=OPEN, estimator=(measure(0.4, least_tension=0.0),))
    (text,) = find_low_tensions(slack.loops, Limits())
    assert text == "estimator: c1 goes slack on the way"


def test_structures_without_cables_have_no_tension() -> None:
    bare = {"least_tension": math.nan, "end_tension": math.nan, "least_member": ""}
    study = study_of("holds", open=OPEN[:1], true_state=(measure(0.4, **bare),))
    assert describe_control_finding(study).endswith("6.4 mm without feedback")
    assert find_low_tensions(study.loops, limit(2.0)) == ()


def test_the_largest_of_the_least_tensions_is_the_limit() -> None:
    assert find_least_bound(np.array([-np.inf, 1.0, 3.0])) == 3.0
    assert find_least_bound(np.array([-np.inf])) == -math.inf
    assert find_least_bound(np.zeros(0)) == -math.inf
