"""Analysis `control`: cases under the controller of the unchanged scene, beside single simulated loops."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import (
    ActuatorLimits,
    Disturbance,
    Gust,
    Sampling,
    simulate_control,
    simulate_control_batch,
    sweep,
)
from tensegrity_codegen.analyses.cases.nominal_controller import CaseLoop, NominalController
from tensegrity_codegen.analyses.cases.registry import build_analysis
from tensegrity_codegen.analyses.cases.statuses import STATUSES
from tensegrity_codegen.analyses.control import SweptControl
from tensegrity_codegen.cli.verbs.sweep import build_commands
from tensegrity_codegen.control.feedback.study.control_study import measure_run
from tensegrity_codegen.control.feedback.study.linear_loop import build_linear_loop, find_margins
from tensegrity_codegen.sweeps.apply.assembler import build_assembler, hash_constants
from tensegrity_codegen.sweeps.summary.results import read_results
from tensegrity_codegen.sweeps.summary.summary import summarize
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InfeasibleError,
    InvalidValueError,
    StructureError,
    TensegrityError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.control.feedback.pinned_prism import ROOT

EXAMPLES = ROOT / "tensegrity_codegen" / "scene" / "examples"
CORD, DELAY, NOISE = "spring_constant.cord", "actuators.winch.delay", "sensors[0].noise"
SAMPLE = 0.02
OPTIONS: dict[str, Any] = {"sample_time": SAMPLE, "t_end": 3.0, "start_error": 0.01}
WINCH = """
[[actuators]]
name = "winch"
members = "cord"
[[sensors]]
kind = "member_length"
members = "cord"
noise = 1e-4
"""


@pytest.fixture(scope="module")
def lift(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the scene of a mass on a cord with a winch, and the length of the cord measured."""
    path = Path(tmp_path_factory.mktemp("lift")) / "two_nodes.toml"
    path.write_text('axes = "z"\n' + (EXAMPLES / "two_nodes.toml").read_text() + WINCH)
    return path


def design(lift: Path, **options: Any) -> NominalController:
    operation = build_analysis("control", **(OPTIONS | options)).prepared(lift)
    assert isinstance(operation, SweptControl)
    assert operation.design is not None
    return operation.design


def find_delay_margin(lift: Path) -> float:
    loop = design(lift)
    parts = loop.controller
    assert parts.gains is not None
    linear = build_linear_loop(
        loop.model, parts.motion, parts.gains, parts.bounds.delay, parts.estimator, {}
    )  # fmt: skip
    return find_margins(linear).delay


def run(lift: Path, over: dict[str, Any], **options: Any) -> Any:
    return sweep(lift, do="control", over=over, workers=1, **(OPTIONS | options))


def test_cases_are_loops_of_another_plant_under_the_same_controller(lift: Path) -> None:
    """Stiffness and start of the case; gains, estimator and motion of the unchanged scene."""
    keep = ["end_error", "peak_error", "end_tension", "least_tension", "end_rms", "worst_node"]
    stiffness = [60.0, 80.0, 100.0]
    found = run(lift, {CORD: stiffness}, draws=2, keep=keep)
    loop = design(lift, draws=2)
    parts = loop.controller
    for k, value in enumerate(stiffness):
        rows = []
        for draw, drawn in enumerate(loop.drawn):
            seed = int(np.random.SeedSequence([0, draw]).generate_state(1)[0])
            away = Disturbance(
                coordinate_error=drawn.coordinate, arguments={"spring_constant": [value]}, seed=seed
            )
            alone = simulate_control(
                loop.model, parts.motion, parts.gains, estimator=parts.estimator, t_end=loop.t_end,
                disturbance=away, compare=False,
            )  # fmt: skip
            rows.append(measure_run(loop.model, alone, loop.error_window))
        assert float(found.end_error[k]) == pytest.approx(max(row.end_error for row in rows), rel=1e-6)
        assert float(found.peak_error[k]) == pytest.approx(max(row.peak_error for row in rows), rel=1e-6)
        assert float(found.end_tension[k]) == pytest.approx(min(row.end_tension for row in rows), rel=1e-6)
        assert float(found.least_tension[k]) == pytest.approx(min(row.least_tension for row in rows))
        assert float(found.end_rms[k]) == pytest.approx(
            max(max(row.end_rms.values()) for row in rows), rel=1e-6
        )
        assert int(found.worst_node[k]) == 1
    assert found.message.values[0].endswith("mm at n2 at the end")


def test_the_worst_case_is_the_delay_beyond_the_margin(lift: Path, tmp_path: Path) -> None:
    """Neither gains nor estimator know the delays of the cases: the loop swings beyond the delay margin.

    The summary names the case by its keys, with a command of the unchanged scene.
    """
    margin = find_delay_margin(lift)
    assert 0.5 * SAMPLE < margin < 10 * SAMPLE
    delays = [0.0, 0.7 * margin, 1.4 * margin]
    out = tmp_path / "delays.zarr"
    found = run(lift, {DELAY: delays}, out=out, t_end=8.0, last=0.5)
    ends = found.end_error.values
    assert ends[1] < 0.01 < 3 * ends[1] + ends[2]
    assert ends[2] > 5 * max(ends[:2])
    summary = summarize(read_results(out), build_commands=build_commands)
    worst = next(item for item in summary.worst if "largest end_error" in item.reason)
    assert (worst.case, worst.keys) == (2, {DELAY: delays[2]})
    assert worst.commands[1].startswith("tensegrity-codegen sweep two_nodes.toml --do control --sample-time")
    assert worst.commands[1].endswith(f"--over {DELAY}={delays[2]!r} --out case2.zarr")


def test_a_delay_that_the_scene_states_is_known(lift: Path) -> None:
    """The controller of a scene with the delay is better than that of the scene without it."""
    late, delay = lift.with_name("late.toml"), 1.4 * find_delay_margin(lift)
    late.write_text(lift.read_text().replace('name = "winch"', f'name = "winch"\ndelay = {delay!r}'))
    known = run(late, {DELAY: [0.999 * delay, delay]}, t_end=8.0, last=0.5).end_error.values
    unknown = run(lift, {DELAY: [delay]}, t_end=8.0, last=0.5).end_error.values
    assert known[0] == pytest.approx(known[1], rel=0.1)
    assert 5 * known[1] < unknown[0]


def test_delays_that_the_controller_does_not_know_are_those_of_simulate_control(lift: Path) -> None:
    """At rest, with the true state: gains for no delay, and commands that arrive within any sample."""
    scene = lift.with_name("seen.toml")
    scene.write_text(lift.read_text().partition("[[sensors]]")[0])
    delays = [0.0, 0.3 * SAMPLE, SAMPLE, 2.6 * SAMPLE]
    found, loop = run(scene, {DELAY: delays}), design(scene)
    for delay, end in zip(delays, found.end_error.values.tolist(), strict=True):
        alone = simulate_control(
            loop.model, loop.controller.motion, loop.controller.gains, t_end=loop.t_end, compare=False,
            disturbance=Disturbance(coordinate_error=loop.drawn[0].coordinate),
            limits=ActuatorLimits(delay=delay),
        )  # fmt: skip
        assert end == pytest.approx(measure_run(loop.model, alone, loop.error_window).end_error, rel=1e-6)


def test_slow_motors_lag_behind_their_commands(lift: Path) -> None:
    """The controller believes in motors of any rate; faster ones than it believes change nothing."""
    loop = design(lift, start_error=0.1)
    for back, rate in ((0, 0.05), (2, 0.08)):
        given = {"actuator_rate": np.array([rate]), "actuator_delay": np.array([(back + 0.4) * SAMPLE])}
        slow = CaseLoop(loop.model, loop).run({}, given, 0, 0)
        command = np.concatenate([np.repeat(loop.controller.motion.input[:1], back, axis=0), slow.command])
        where = loop.controller.motion.input[0]
        for k, value in enumerate(slow.input):
            where = where + np.clip(command[k] - where, -rate * SAMPLE, rate * SAMPLE)
            assert value == pytest.approx(where, abs=1e-15)
        assert np.abs(np.diff(command[:, 0])).max() > 2 * rate * SAMPLE
    key = "actuators.winch.rate"
    slow_end, fast_end = run(lift, {key: [0.002, 1e9]}).end_error.values
    assert slow_end > 2 * fast_end
    limited = lift.with_name("limited.toml")
    limited.write_text(lift.read_text().replace('name = "winch"', 'name = "winch"\nrate = 0.3'))
    same = run(limited, {key: [0.3, 5.0]}).end_error.values
    assert same[0] == same[1]


def test_gusts_are_those_of_simulate_control(lift: Path) -> None:
    """A force and the times of all gusts by their keys; the other node is held."""
    forces = [0.0, -0.5, 2.0]
    found = run(lift, {"gust.n2[2]": forces, "gust_time.start": [2.411], "gust_time.duration": [0.05]})
    usual = run(lift, {"gust.n2[2]": [2.0], "gust.n1[2]": [5.0]})
    loop = design(lift)
    seed = int(np.random.SeedSequence([0, 0]).generate_state(1)[0])
    for force, times, swept, k in (
        *((force, (2.411, 0.05), found, k) for k, force in enumerate(forces)),
        (2.0, (0.0, 0.2), usual, 0),
    ):
        away = Disturbance(
            coordinate_error=loop.drawn[0].coordinate, gust=Gust("n2", (0.0, 0.0, force), *times), seed=seed
        )
        alone = simulate_control(
            loop.model, loop.controller.motion, loop.controller.gains, estimator=loop.controller.estimator,
            t_end=loop.t_end, disturbance=away, compare=False,
        )  # fmt: skip
        measured = measure_run(loop.model, alone, loop.error_window)
        for name in ("end_error", "peak_error"):
            assert swept[name].values.ravel()[k] == pytest.approx(getattr(measured, name), rel=1e-6)


def test_gusts_that_are_none_are_named(lift: Path) -> None:
    found = run(lift, {"gust.n2[2]": [1.0], "gust_time.start": [0.0, -1.0, 9.0]})
    assert found.status.values.ravel().tolist()[0] == 0
    messages = found.message.values.ravel().tolist()
    assert "gust_time" in messages[1] or "start" in messages[1]
    assert "the gust begins after the simulated time" in messages[2]
    with pytest.raises(InvalidValueError, match="cannot move or be loaded along this axis"):
        run(lift, {"gust.n2[0]": [1.0]})
    with pytest.raises(UnknownKeyError, match="duration"):
        run(lift, {"gust_time.durations": [1.0]})
    with pytest.raises(UnknownKeyError, match="n2"):
        run(lift, {"gust.n9[2]": [1.0]})


@pytest.mark.parametrize("options", [{"least_tension": "0.5"}, {"mpc": True, "horizon": 10}])
def test_other_controllers_are_those_of_the_verb(lift: Path, options: dict[str, Any]) -> None:
    """A distribution of tensions, and model-predictive control, which another process has too."""
    found = run(lift, {CORD: [70.0, 80.0]}, keep=["end_error", "least_tension"], **options)
    loop = design(lift, **options)
    parts = loop.controller
    assert (parts.distribution is None, parts.mpc is None) == ("mpc" in options, "mpc" not in options)
    seed = int(np.random.SeedSequence([0, 0]).generate_state(1)[0])
    draws = [
        Disturbance(
            coordinate_error=loop.drawn[0].coordinate, arguments={"spring_constant": [value]}, seed=seed
        )
        for value in (70.0, 80.0)
    ]
    alone = simulate_control_batch(
        loop.model, parts.motion, parts.mpc or parts.gains, draws=draws, estimator=parts.estimator,
        distribution=parts.distribution, t_end=loop.t_end, compare=False,
    )  # fmt: skip
    for k, one in enumerate(alone):
        measured = measure_run(loop.model, one, loop.error_window)
        assert float(found.end_error[k]) == pytest.approx(measured.end_error, rel=1e-6)
        assert float(found.least_tension[k]) == pytest.approx(measured.least_tension, rel=1e-6)
    sent = pickle.loads(pickle.dumps(loop))
    again = CaseLoop(sent.model, sent).run({}, {}, 0, 0)
    np.testing.assert_array_equal(again.command, CaseLoop(loop.model, loop).run({}, {}, 0, 0).command)


def test_the_estimator_has_the_options_of_the_verb(lift: Path) -> None:
    estimators = [design(lift, **options).controller.estimator for options in ({}, {"disturbance": 0.0})]
    assert [len(estimator.disturbed) for estimator in estimators if estimator is not None] == [1, 0]
    plain, shown = (design(lift, only_observable=value).controller.estimator for value in (False, True))
    assert plain is not None
    assert shown is not None
    np.testing.assert_array_equal(shown.L, plain.L)  # sensors show the only force


def test_a_loop_whose_programs_are_not_solved_has_this_status(
    lift: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_loop = CaseLoop.run
    monkeypatch.setattr(
        CaseLoop, "run", lambda *given: replace(run_loop(*given), status="not_solved", message="90 of 300")
    )
    found = run(lift, {CORD: [70.0]})
    assert STATUSES[int(found.status[0])] == "not_solved"
    assert str(found.message.values[0]) == "90 of 300"
    assert np.isnan(float(found.end_error[0]))


def test_random_loops_are_the_same_for_any_number_of_workers(lift: Path) -> None:
    sampled = Sampling(
        {
            DELAY: "uniform(0,0.03)",
            "actuators.winch.rate": "lognormal(-2,1)",
            "gust.n2[2]": "normal(0,1)",
            "gust_time.start": "uniform(0,1)",
        },
        n=6,
        seed=3,
    )
    one, two = (
        sweep(lift, do="control", sample=sampled, workers=workers, task_size=2, **OPTIONS)
        for workers in (1, 2)
    )
    assert len(set(one.end_error.values.tolist())) == 6
    np.testing.assert_array_equal(one.end_error.values, two.end_error.values)
    np.testing.assert_array_equal(one.peak_error.values, two.peak_error.values)


def test_more_noise_than_the_estimator_knows(lift: Path) -> None:
    known, more, none = run(lift, {NOISE: [1e-4, 1.5e-4, 0.0]}, keep=["end_rms"], start_error=0.0).end_rms
    assert none < 1e-8
    assert float(more) == pytest.approx(1.5 * float(known), rel=1e-6)  # the lift is linear


def test_delays_rates_noise_and_gusts_need_no_other_library(lift: Path) -> None:
    """But a motor with a lag has its rate in its equation."""
    keys = [DELAY, NOISE, "actuators.winch.rate", "gust.n2[2]", "gust_time.start"]
    one, other = [0.0, 1e-4, 1.0, 0.0, 0.0], [0.1, 1e-2, 2.0, 1.0, 1.0]
    for motor, is_same in (("", True), ("time_constant = 0.1", False)):
        scene = lift.with_name("motor.toml")
        scene.write_text(lift.read_text().replace('name = "winch"', f'name = "winch"\n{motor}'))
        assembler = build_assembler(scene, keys)
        hashes = {hash_constants(assembler.assemble(values)) for values in (one, other)}
        assert len(hashes) == (1 if is_same else 2)


def test_another_process_builds_the_model_again(lift: Path) -> None:
    operation = build_analysis("control", **OPTIONS).prepared(lift)
    sent = pickle.loads(pickle.dumps(operation))
    assert isinstance(sent, SweptControl)
    assert isinstance(operation, SweptControl)
    assert sent.describe() == operation.describe()
    assert sent.design is not None
    assert operation.design is not None
    given = {"coordinate": np.array([[-1.06], [-1.07]])}
    found, expected = (
        item.run(item.design.model, given, 2).arrays["end_error"]  # type: ignore[union-attr]
        for item in (sent, operation)
    )
    np.testing.assert_array_equal(found, expected)


def test_a_case_out_of_range_leaves_the_others_alone(lift: Path) -> None:
    found = run(lift, {DELAY: [0.0, 100.0]})
    assert found.status.values.tolist()[0] == 0
    assert np.isnan(found.end_error.values[1])
    assert "the delay is longer than the motion" in found.message.values[1]


def test_a_structure_with_other_coordinates_is_no_case() -> None:
    springs = {"kind": "cable", "spring_constant": 200, "damping": 2.0, "prestress": 10}
    scene = {
        "name": "bars",
        "classes": {
            "bar": {"kind": "bar", "radius": 0.005, "spring_constant": 1e5, "damping": 20.0},
            "cable": springs,
        },
        "shape": {
            "kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "twist": 155.0,
            "opposite_class": "cable", "node_mass": 0.05, "anchor_bottom": True,
        },
        "actuators": [{"name": "winch", "members": "top1", "rate": 0.1}],
    }  # fmt: skip
    found = sweep(scene, do="control", over={"shape.bars": [3, 4]}, workers=1, t_end=0.2)
    assert found.status.values[0] == 0
    assert "designed for another model or motion" in found.message.values[1]


def test_start_errors_have_the_units_of_the_verb_control() -> None:
    texts = {"0.01": 0.01, "10mm": 0.01, "1cm": 0.01, "1.2deg": "1.2deg"}
    assert {text: SweptControl(start_error=text).start_error for text in texts} == pytest.approx(texts)
    option = next(option for option in SweptControl.list_options() if option.name == "start_error")
    assert option.kind is str


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"to": "z=1", "plan": "a.npz"}, InvalidValueError, "given twice"),
        ({"to": " ; "}, InvalidValueError, "no target"),
        ({"duration": 2.0}, InvalidValueError, "has no duration"),
        ({"draws": 0}, InvalidValueError, "draws"),
        ({"draw_seed": -1}, InvalidValueError, "seed"),
        ({"start_error": -1.0}, InvalidValueError, "out of range"),
        ({"start_error": "soon"}, InvalidValueError, "not an error of the start"),
        ({"start_error": "1deg"}, InvalidValueError, "no coordinate is an angle"),
        ({"sample_time": 0.0}, InvalidValueError, "sample"),
        ({"last": 9.0}, InvalidValueError, "last"),
        ({"plan": "missing.npz"}, TensegrityError, "missing.npz"),
        ({"to": "n2.z=5"}, InfeasibleError, "no plan to hold"),
        ({"least_tension": "much"}, InvalidValueError, "least tension"),
        ({"mpc": True, "horizon": 0}, InvalidValueError, "horizon"),
        ({"keep": ["speed"]}, UnknownNameError, "speed"),
        ({"keep": ["cut", "cut"]}, DuplicateNameError, "kept twice"),
    ],
)
def test_options_that_state_no_loop_are_refused(
    lift: Path, options: dict[str, Any], kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words):
        run(lift, {CORD: [80.0]}, **options)


def test_inputs_and_scenes_without_actuators_are_refused(lift: Path) -> None:
    for values in ([0.0, 0.1], [0.1]):
        with pytest.raises(InvalidValueError, match="inputs are those of the motion"):
            run(lift, {"input.winch": values})
    with pytest.raises(StructureError):
        run(EXAMPLES / "two_nodes.toml", {CORD: [80.0]})
