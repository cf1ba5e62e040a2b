"""Fraction and time left of work of several passes, with a clock that the test moves."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import pytest

from tensegrity_codegen.long_work.estimate import Pass, WorkEstimate, name_duration
from tensegrity_codegen.passes import watched_passes, work_pass


class Clock:
    """A time [s] that passes when the test says so."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def estimate(*passes: Pass) -> tuple[WorkEstimate, Clock]:
    clock = Clock()
    return WorkEstimate(passes, clock=clock), clock


def run_pass(work: WorkEstimate, clock: Clock, title: str, seconds: float, parts: int = 10) -> list[float]:
    """Run a pass that reports evenly; return the fractions of the whole that were shown."""
    shown = []
    move = work.begin(title)
    for k in range(1, parts + 1):
        clock.now += seconds / parts
        move(k / parts)
        shown.append(work.look().fraction)
    work.end()
    return shown


def test_the_bar_covers_all_passes_and_never_goes_back() -> None:
    work, clock = estimate(Pass("generating C", 2.0), Pass("compiling", 4.0), Pass("simulating", 6.0))
    shown = run_pass(work, clock, "generating C", 1.0)
    shown += run_pass(work, clock, "compiling", 40.0)
    shown += run_pass(work, clock, "simulating", 3.0)
    assert shown == sorted(shown)
    assert shown[9] == pytest.approx(2 / 12)
    assert shown[19] == pytest.approx(6 / 12)
    assert shown[-1] == pytest.approx(1.0)


def test_passes_that_are_not_needed_are_left_out() -> None:
    work, clock = estimate(Pass("generating C", 2.0), Pass("compiling", 4.0), Pass("simulating", 6.0))
    shown = run_pass(work, clock, "simulating", 10.0)  # the library was in the cache
    assert shown == pytest.approx([k / 10 for k in range(1, 11)])


def test_a_pass_that_was_not_announced_gets_a_part() -> None:
    work, clock = estimate(Pass("simulating", 6.0))
    shown = run_pass(work, clock, "finding the equilibrium", 1.0)
    shown += run_pass(work, clock, "simulating", 1.0)
    assert shown == sorted(shown)
    assert 0.0 < shown[9] < 1.0 == pytest.approx(shown[-1])


@pytest.mark.parametrize(("is_known", "after_5", "after_60"), [(True, 0.5, 0.998), (False, 1 / 3, 6 / 7)])
def test_a_pass_without_reports_approaches_its_end(is_known: bool, after_5: float, after_60: float) -> None:
    work, clock = estimate(Pass("compiling", 10.0, is_known))
    work.begin("compiling")
    shown = []
    for _ in range(60):
        clock.now += 1.0
        shown.append(work.look().fraction)
    assert all(after > before for before, after in itertools.pairwise(shown))
    assert shown[4] == pytest.approx(after_5)
    assert shown[-1] == pytest.approx(after_60, abs=0.01)
    assert work.look().left is None  # nobody has measured it, or it has taken longer than that


def test_the_time_left_is_that_of_the_speed_since_the_first_report() -> None:
    work, clock = estimate()
    move = work.begin("computing")
    clock.now += 100.0  # a preparation, which does not come again
    move(0.1)
    assert work.look().left is None
    clock.now += 10.0
    move(0.3)
    assert work.look().left == pytest.approx(35.0)  # 20 % took 10 s


def test_later_passes_count_where_their_time_is_known() -> None:
    drawing = Pass("drawing", 7.0, is_known=True)
    work, clock = estimate(Pass("simulating", 1.0), drawing)
    move = work.begin("simulating")
    move(0.0)
    clock.now += 10.0
    move(0.5)
    assert work.look().left == pytest.approx(17.0)
    work, clock = estimate(Pass("compiling", 1.0), Pass("simulating", 7.0))
    move = work.begin("compiling")
    move(0.0)
    clock.now += 10.0
    move(0.5)
    assert work.look().left is None  # how long the motion takes is not known


def test_what_the_same_work_took_before_is_known() -> None:
    work, clock = estimate(Pass("compiling", 1.0), Pass("simulating", 7.0))
    work.begin("compiling")
    work.remember({"compiling": 20.0, "simulating": 60.0, "another": 5.0})
    clock.now += 5.0
    assert work.look().left == pytest.approx(75.0)
    work.end()
    assert work.durations == {"compiling": 5.0}


def left_over_time(fractions: Sequence[float], step: float) -> list[tuple[float | None, bool]]:
    """Return the time left, and whether the work is late, as a pass reports these fractions in turn."""
    work, clock = estimate()
    move = work.begin("computing")
    move(0.0)
    shown = []
    for fraction in fractions:
        clock.now += step
        move(fraction)
        state = work.look()
        shown.append((state.left, state.is_late))
    return shown


@pytest.mark.parametrize("power", [0.3, 0.5, 1.0, 2.0, 4.0])
def test_the_time_left_never_rises_whatever_the_speed(power: float) -> None:
    fractions = [(k / 200) ** power for k in range(1, 201)]
    shown = [left for left, is_late in left_over_time(fractions, 2.0) if left is not None and not is_late]
    assert len(shown) > 10
    assert shown == sorted(shown, reverse=True)
    assert shown[-1] == 0.0


def test_work_that_slows_down_is_late_after_the_time_that_was_left() -> None:
    fast, slow = [0.01 * k for k in range(1, 91)], [0.9 + 1e-5 * k for k in range(1, 200)]
    shown = left_over_time([*fast, *slow], 1.0)
    assert shown[89] == (pytest.approx(10.0), False)
    assert shown[95] == (pytest.approx(10.0), False)  # it stays, since it must not rise
    assert all(is_late and left is not None and left > 10.0 for left, is_late in shown[105:])


def test_the_speed_is_that_of_the_last_part() -> None:
    slow, fast = [0.01 * k for k in range(1, 11)], [0.1 + 0.02 * k for k in range(1, 41)]
    shown = left_over_time([*slow, *fast], 3.0)
    assert shown[-1][0] == pytest.approx(15.0)


def test_what_an_interrupted_run_has_finished_says_nothing_of_the_speed() -> None:
    work, clock = estimate()
    move = work.begin("running cases")
    move(0.5)
    for k in range(1, 6):
        clock.now += 3.0
        move(0.5 + 0.01 * k)
    assert work.look().left == pytest.approx(135.0)


def test_reports_that_are_no_progress_do_no_harm() -> None:
    work, clock = estimate()
    move = work.begin("computing")
    for fraction in (0.5, float("nan"), 0.2, 7.0, -1.0):
        clock.now += 10.0
        move(fraction)
    assert work.look().fraction == 1.0
    assert work.look().left == 0.0


def test_many_reports_are_thinned_out_and_the_time_left_stays_right() -> None:
    work, clock = estimate()
    move = work.begin("computing")
    for k in range(20_001):
        clock.now += 0.05
        move(k / 40_000)
    assert work.look().left == pytest.approx(1000.0, rel=0.01)
    assert work._running is not None
    assert len(work._running.marks) < 2000


def test_passes_within_a_pass_are_parts_of_it() -> None:
    work, _ = estimate(Pass("measuring", 1.0))
    with watched_passes(work), work_pass("measuring") as move:
        move(0.25)
        with work_pass("compiling") as inner:
            inner(1.0)
            move(0.5)
        assert work.look().fraction == pytest.approx(0.5)
        assert work.look().title == "measuring"
    with work_pass("nobody watches") as move:
        move(0.5)
    assert work.look().title == "measuring"


def test_durations_are_named_with_their_unit() -> None:
    texts = [name_duration(seconds) for seconds in (0.0, 59.94, 59.96, 125.4, 3599.6, 86400.0)]
    assert texts == ["0.0 s", "59.9 s", "1 min 0 s", "2 min 5 s", "1 h 0 min", "24 h 0 min"]
