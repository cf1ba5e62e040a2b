"""Studies: what disturbs, what is measured, statuses, the worst draw."""

from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest

from tensegrity_codegen import (
    ControlStudy,
    Gust,
    RandomGust,
    StatedErrors,
    compile_scene,
    find_equilibrium,
    simulate_control,
    study_control,
)
from tensegrity_codegen.control.feedback.design.linear_samples import find_reference
from tensegrity_codegen.control.feedback.loop.control_run import find_displacement
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.study.control_study import (
    count_worse,
    find_margin_warnings,
    find_warnings,
    judge_study,
)
from tensegrity_codegen.control.feedback.study.stated_errors import (
    Draws,
    draw_all_errors,
    draw_errors,
    find_default_times,
)
from tensegrity_codegen.control.feedback.study.tuning import choose_weights, find_scales
from tensegrity_codegen.control.pages.control_studies import errors_table
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.models import EXAMPLES

ERRORS = StatedErrors(start_angle=np.radians(1.2), gusts=(RandomGust("bar*_B", 5.0, 0.5, 0.2),))


@pytest.fixture(scope="module")
def study(model: CompiledModel, motion: Motion) -> ControlStudy:
    return study_control(model, motion, errors=ERRORS, draws=Draws(2, last=0.5), t_end=3.0)


@pytest.mark.thorough
def test_default_weights_meet_the_acceptance_of_the_pinned_prism(study: ControlStudy) -> None:
    worst = {name: np.degrees(loop.end_angle) for name, loop in study.loops.items()}
    assert study.status == "holds"
    assert worst["open"].min() > 1.0
    assert worst["true_state"].max() < 0.05
    assert worst["estimator"].max() < 0.1


@pytest.mark.thorough
def test_default_weights_meet_it_in_twenty_draws(model: CompiledModel, motion: Motion) -> None:
    found = study_control(model, motion, errors=ERRORS, draws=Draws(20, last=0.5), t_end=3.0)
    worst = {name: np.degrees(loop.end_angle) for name, loop in found.loops.items()}
    assert worst["open"].min() > 1.0
    assert worst["true_state"].max() < 0.05
    assert worst["estimator"].max() < 0.1


def test_the_worst_draw_is_kept_and_can_be_repeated(
    study: ControlStudy, model: CompiledModel, motion: Motion
) -> None:
    loop = study.loops["estimator"]
    assert study.worst_draw == int(loop.end_error.argmax())
    drawn = study.drawn[study.worst_draw]
    run = simulate_control(
        model, motion, None, sample=0.005, t_end=3.0,
        disturbance=Disturbance(drawn.coordinate, arguments=drawn.arguments, gust=drawn.gusts),
    )  # fmt: skip
    np.testing.assert_array_equal(run.coordinate, study.loops["open"].run.coordinate)


@pytest.mark.thorough
def test_loops_in_c_give_the_same_study(model: CompiledModel, motion: Motion) -> None:
    from tensegrity_codegen import simulate_control_batch

    gains = study_control(model, motion, draws=1, t_end=0.1, estimator=None).gains.at_knots(25)
    options: dict[str, Any] = {"gains": gains, "errors": ERRORS, "t_end": 0.8, "estimator": None}
    one, many = (
        study_control(model, motion, draws=Draws(3, batch=batch), **options)
        for batch in (None, simulate_control_batch)
    )
    assert one.worst_draw == many.worst_draw
    for name in one.loops:
        np.testing.assert_allclose(
            many.loops[name].end_error, one.loops[name].end_error, rtol=1e-5, atol=1e-9
        )
        np.testing.assert_allclose(many.loops[name].run.command, one.loops[name].run.command, atol=1e-8)


def test_measures_are_those_of_the_run(study: ControlStudy, model: CompiledModel, motion: Motion) -> None:
    loop = study.loops["open"]
    row, run = loop.measures[study.worst_draw], loop.run
    assert row.end_angle == run.worst_error(0.5)
    away = find_displacement(model, run)
    k = 77
    planned = place_nodes(model, motion.at(float(run.time[k])).coordinate)
    direct = np.linalg.norm(place_nodes(model, run.coordinate[k]) - planned, axis=1)
    np.testing.assert_allclose(away[k], direct, atol=1e-12)
    assert row.peak_error == away.max()
    assert row.end_error == away[run.time >= 2.5 - 1e-12].max()
    assert row.least_tension == run.least_tension()[row.least_member == np.array(run.member_name)][0]


def test_the_table_tells_limits_at_the_end_from_tensions_on_the_way(study: ControlStudy) -> None:
    first, *columns = (
        [str(cell) for cell in column.cells] for column in errors_table(study, "prism").columns
    )
    assert first[3] == "limits at the end"
    ways = [f"{loop.least_tension.min():.4g}" for loop in study.loops.values()]
    assert [column[first.index("least tension [N]", 4)] for column in columns] == ways


def test_draws_differ_and_are_the_same_for_the_same_seed(model: CompiledModel, motion: Motion) -> None:
    scales = find_scales(model, motion, {})
    first, again, other = (draw_errors(model, ERRORS, scales, seed, 3) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.coordinate, again.coordinate)
    assert first.gusts == again.gusts
    assert first.gusts != other.gusts
    np.testing.assert_allclose(np.abs(first.coordinate), np.radians(1.2))
    assert np.linalg.norm(first.gusts[0].force) == pytest.approx(5.0)


def test_stiffness_alternates_in_the_first_draw(model: CompiledModel, motion: Motion) -> None:
    scales = find_scales(model, motion, {})
    drawn = draw_errors(model, StatedErrors(stiffness_error=0.1), scales, 0, 0)
    assert list(drawn.stiffness.values())[:4] == pytest.approx([0.9, 1.1, 0.9, 1.1])
    np.testing.assert_allclose(drawn.arguments["axial_stiffness"] / 500.0, list(drawn.stiffness.values()))
    assert draw_errors(model, StatedErrors(stiffness_error=0.0), scales, 0, 0).arguments == {}


def test_start_errors_are_displacements_of_nodes(model: CompiledModel, motion: Motion) -> None:
    scales = find_scales(model, motion, {})
    drawn = draw_errors(model, StatedErrors(start_error=2e-3), scales, 0, 1)
    q = motion.coordinate[0]
    for k, error in enumerate(drawn.coordinate):
        moved = q.copy()
        moved[k] += error
        way = np.linalg.norm(place_nodes(model, moved) - place_nodes(model, q), axis=1).max()
        assert way == pytest.approx(2e-3, rel=1e-2)


def test_default_start_errors_hardly_strain_stiff_bars() -> None:
    """Bars a thousand times as stiff as cables are loaded by at most the largest force at rest."""
    model = compile_scene(EXAMPLES / "prism12.toml", for_=("equilibrium", "control"))
    structure, held = model.structure, find_reference(model, find_equilibrium(model), 2.0, None)
    assert structure is not None
    scales, stiff = find_scales(model, held, {}), np.array(structure.is_bar)

    rest = np.abs(held.member_tension[0]).max()
    for stated in (StatedErrors(), StatedErrors(start_error=0.01 * scales.size)):
        drawn = draw_all_errors(model, held, stated, scales, Draws(3))
        for k, errors in enumerate(drawn):
            q = held.coordinate[0] + errors.coordinate
            more = model.compute("member_tension", coordinate=q)[stiff] - held.member_tension[0][stiff]
            if stated.start_error is None:
                assert np.abs(more).max() <= 1.001 * rest
                assert np.abs(errors.coordinate).max() > 0.005 * scales.size
            else:
                raw = draw_errors(model, stated, scales, 0, k)
                np.testing.assert_array_equal(errors.coordinate, raw.coordinate)
                assert np.abs(more).max() > 100 * rest


def test_default_start_errors_keep_to_the_largest_tensions() -> None:
    """Cables whose limit is a tenth above their tension at rest begin below it."""
    model = compile_scene(EXAMPLES / "prism12.toml", for_=("equilibrium", "control"))
    structure, held = model.structure, find_reference(model, find_equilibrium(model), 2.0, None)
    assert structure is not None
    rest, scales = held.member_tension[0], find_scales(model, held, {})
    most = np.where(structure.is_bar, np.inf, 1.1 * rest)
    largest = []
    for limits in (structure.limits, replace(structure.limits, most_tension=most)):
        with mock.patch.object(model, "structure", structure.with_changes(limits=limits)):
            drawn = draw_all_errors(model, held, StatedErrors(), scales, Draws(3))
        q = [held.coordinate[0] + errors.coordinate for errors in drawn]
        largest.append(np.max([model.compute("member_tension", coordinate=row) / most for row in q]))
    assert largest[0] > 1.2
    assert largest[1] <= 1.001


def test_default_start_errors_of_soft_members_are_a_hundredth_of_the_size(
    model: CompiledModel, motion: Motion
) -> None:
    scales = find_scales(model, motion, {})
    for errors in draw_all_errors(model, motion, StatedErrors(), scales, Draws(3)):
        np.testing.assert_allclose(np.abs(errors.coordinate) * scales.lever, 0.01 * scales.size)


def test_a_loop_that_is_worse_than_none_does_not_hold(
    study: ControlStudy, model: CompiledModel, motion: Motion
) -> None:
    """Gains of the wrong sign: the structure is pushed away, as the linear loop says before."""
    wrong, told = replace(study.gains, K=-0.3 * study.gains.K), list[str | float]()
    found = study_control(
        model, motion, gains=wrong, errors=ERRORS, draws=Draws(1, seed=study.seed, warn=told.append),
        t_end=1.5, estimator=None, progress=told.append,
    )  # fmt: skip
    assert found.status in ("does_not_hold", "unstable")
    assert not found.holds
    assert told[0] == "true state: the linear loop at the end of the motion is unstable" + (
        ": weaker feedback (a smaller effort) tolerates more"
    )
    assert told[0] in found.warnings
    assert [isinstance(item, str) for item in told] == [True, False, False]


@pytest.mark.parametrize("word", ["unstable", "not_solved"])
def test_a_loop_that_stops_or_is_not_solved_is_named(study: ControlStudy, word: str) -> None:
    loops = dict(study.loops)
    row = replace(loops["true_state"].measures[0], status=word)
    loops["true_state"] = replace(loops["true_state"], measures=(row, *loops["true_state"].measures[1:]))
    status, message = judge_study(loops, study.tuning.tolerance)
    assert status == word
    assert "true state" in message
    assert f"(1 {word.replace('_', ' ')})" in message


def test_an_open_loop_that_is_unstable_does_not_forbid_feedback(study: ControlStudy) -> None:
    loops = dict(study.loops)
    row = replace(loops["open"].measures[0], status="unstable", end_error=0.0)
    loops["open"] = replace(loops["open"], measures=(row, row))
    assert judge_study(loops, study.tuning.tolerance)[0] == "holds"


def test_loops_that_are_cut_often_or_gain_little_are_warned_of(study: ControlStudy) -> None:
    assert [text.partition(":")[0] for text in study.warnings] == ["true state", "estimator"]
    assert all("goes slack on the way, below the least tension of 5 N" in text for text in study.warnings)
    loops, tolerance = dict(study.loops), study.tuning.tolerance
    before = float(loops["open"].end_error.max())
    loops["true_state"] = replace(
        loops["true_state"],
        measures=(
            replace(
                loops["true_state"].measures[0], end_error=0.9 * before, steps={"ok": 60, "rate_limited": 40}
            ),
        ),
    )
    cut, little = find_warnings(loops, tolerance)
    assert cut.startswith("true state: 40 % of the commands were cut")
    assert f"feedback gains little, {900 * before:.3g} mm at the end" in little
    worse = replace(loops["true_state"].measures[0], end_error=1.5 * before, steps={"ok": 1})
    harmed = loops | {"true_state": replace(loops["true_state"], measures=(worse,))}
    assert "feedback makes the error larger" in find_warnings(harmed, tolerance)[0]
    loops["open"] = replace(loops["open"], measures=(replace(loops["open"].measures[0], status="unstable"),))
    assert find_warnings(loops, tolerance) == (cut,)


def test_gains_for_other_delays_are_warned_of(study: ControlStudy) -> None:
    bounds = replace(study.bounds, delay=np.full(len(study.bounds.names), 0.013))
    (text, *others) = replace(study, bounds=bounds).warnings
    assert "designed for delays of up to 0 ms, and the actuators answer up to 13 ms late" in text
    assert others == list(study.warnings)


def test_margins_below_a_sample_and_loops_without_are_warned_of(study: ControlStudy) -> None:
    assert list(study.margins) == ["true_state", "estimator"]
    assert all(0.005 < item.delay < 0.02 for item in study.margins.values())
    margins = {
        "true_state": replace(study.margins["true_state"], delay=0.004),
        "estimator": replace(study.margins["estimator"], is_stable=False),
    }
    close, lost = find_margin_warnings(margins, study.bounds, 0.005)
    assert close.startswith("true state: 4 ms more delay make the loop unstable, less than one sample (5 ms)")
    assert lost.startswith("estimator: the linear loop at the end of the motion is unstable")


def test_draws_that_end_worse_than_the_open_loop_are_counted(study: ControlStudy) -> None:
    loops = dict(study.loops)
    assert count_worse(loops, "estimator") == 0
    far = replace(loops["estimator"].measures[1], end_error=1.0)
    loops["estimator"] = replace(loops["estimator"], measures=(loops["estimator"].measures[0], far))
    assert count_worse(loops, "estimator") == 1
    assert "estimator worse than open loop in 1 of 2 draws" in judge_study(loops, 100.0)[1]


def test_errors_that_decay_slowly_are_waited_for(study: ControlStudy, motion: Motion) -> None:
    assert find_default_times(motion) == pytest.approx((3.0, 2.5))
    assert find_default_times(motion, 0.4) == pytest.approx((3.0, 2.5))
    end, compared = find_default_times(motion, 2.0)
    assert compared == pytest.approx(1.0 + 3 * 2.0)
    assert end == pytest.approx(compared * 6 / 5)
    assert find_default_times(motion, 0.4, 10.0) == pytest.approx((3.0, 2.5))  # more than ten times as long
    assert find_default_times(motion, np.inf)[0] == 3.0
    short = replace(study, t_end=1.5)
    assert "a simulated time of 2.47 s (`t_end`) covers it" in short.warnings[-1]


def test_arrays_have_every_loop_and_can_be_read_without_pickle(study: ControlStudy, tmp_path: Any) -> None:
    from tensegrity_codegen.runtime.model.arrays import read_arrays, write_arrays

    write_arrays(tmp_path / "study.npz", study.arrays(), overwrite=False)
    data = read_arrays(tmp_path / "study.npz")
    assert data["estimator_draws_end_error"].shape == (2,)
    assert data["true_state_command"].shape == (600, 9)
    assert data["gains_K"].shape[1:] == (9, 18)
    np.testing.assert_array_equal(data["Q"], study.tuning.Q)
    assert str(data["status"]) == "holds"


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"draws": 0}, "draws"),
        ({"draws": True}, "draws"),
        ({"t_end": -1.0}, "t_end"),
        ({"draws": Draws(last=0.0)}, "last"),
        ({"draws": Draws(last=9.0)}, "last"),
        ({"t_end": 0.0}, "t_end"),
        ({"t_end": 0.001}, "t_end"),
        ({"t_end": 0.01}, "t_end"),
        ({"errors": StatedErrors(gusts=(RandomGust("*", 1.0, 50.0),))}, "gust.start"),
        ({"t_end": float("nan")}, "t_end"),
        ({"estimator": "none"}, "estimator"),
        ({"errors": StatedErrors(start_error=-1.0)}, "start_error"),
        ({"errors": StatedErrors(stiffness_error=1.0)}, "stiffness_error"),
        ({"errors": StatedErrors(gusts=(RandomGust("t9", 1.0),))}, "gust.node"),
        ({"errors": StatedErrors(gusts=(RandomGust("base_*", 1.0),))}, "gust.node"),
        ({"errors": StatedErrors(gusts=(RandomGust("*", float("nan")),))}, "gust.force"),
        ({"errors": StatedErrors(gusts=(Gust("nowhere", (1.0, 0.0, 0.0)),))}, "gust.node"),
    ],
)
def test_wrong_values_are_named(
    model: CompiledModel, motion: Motion, options: dict[str, Any], where: str
) -> None:
    tuning = choose_weights(model, motion)
    with pytest.raises((InvalidValueError, UnknownNameError)) as caught:
        study_control(model, motion, **{"tuning": tuning, "draws": 1, **options})
    assert caught.value.where == where
