"""Operation `control`: cases under the controller of the unchanged scene, beside single simulated loops."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import Disturbance, simulate_control, sweep
from tensegrity_codegen.cli.verbs.sweep import build_commands
from tensegrity_codegen.control.feedback.study.linear_loop import build_linear_loop
from tensegrity_codegen.control.feedback.study.loop_result import measure_run
from tensegrity_codegen.control.feedback.study.margins import find_margins
from tensegrity_codegen.sweeps.apply.assembler import build_assembler
from tensegrity_codegen.sweeps.apply.slots import hash_constants
from tensegrity_codegen.sweeps.operations import build_operation
from tensegrity_codegen.sweeps.operations.control import SweptControl
from tensegrity_codegen.sweeps.summary.results import read_results
from tensegrity_codegen.sweeps.summary.summary import summarize
from tensegrity_codegen.sweeps.tasks.unchanged_loop import UnchangedLoop
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InfeasibleError,
    InvalidValueError,
    StructureError,
    TensegrityError,
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


def design(lift: Path, **options: Any) -> UnchangedLoop:
    operation = build_operation("control", **(OPTIONS | options)).prepared(lift)
    assert isinstance(operation, SweptControl)
    assert operation.design is not None
    return operation.design


def find_delay_margin(lift: Path) -> float:
    loop = design(lift)
    parts = loop.parts
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
    parts = loop.parts
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
            rows.append(measure_run(loop.model, alone, loop.last))
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


def test_loops_in_python_and_in_c_are_the_same(lift: Path) -> None:
    """A delay of rounding is another delay, so that Python simulates the case, and no delay at all."""
    in_c, in_python = run(lift, {DELAY: [0.0, 1e-14]}).end_error.values
    assert in_python == pytest.approx(in_c, rel=1e-7)


def test_more_noise_than_the_estimator_knows(lift: Path) -> None:
    known, more, none = run(lift, {NOISE: [1e-4, 1.5e-4, 0.0]}, keep=["end_rms"], start_error=0.0).end_rms
    assert none < 1e-8
    assert float(more) == pytest.approx(1.5 * float(known), rel=1e-6)  # the lift is linear


def test_delays_and_noise_need_no_other_library(lift: Path) -> None:
    assembler = build_assembler(lift, [DELAY, NOISE, "nodes.n2.position[2]"])
    one, other = (assembler.assemble(values) for values in ([0.0, 1e-4, -1.0], [0.1, 1e-2, -1.0]))
    assert hash_constants(one) == hash_constants(other)


def test_another_process_builds_the_model_again(lift: Path) -> None:
    operation = build_operation("control", **OPTIONS).prepared(lift)
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


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"to": "z=1", "plan": "a.npz"}, InvalidValueError, "no motion, or two"),
        ({"to": " ; "}, InvalidValueError, "no motion, or two"),
        ({"duration": 2.0}, InvalidValueError, "has no duration"),
        ({"draws": 0}, InvalidValueError, "draws"),
        ({"draw_seed": -1}, InvalidValueError, "seed"),
        ({"start_error": -1.0}, InvalidValueError, "out of range"),
        ({"sample_time": 0.0}, InvalidValueError, "sample"),
        ({"last": 9.0}, InvalidValueError, "last"),
        ({"plan": "missing.npz"}, TensegrityError, "missing.npz"),
        ({"to": "n2.z=5"}, InfeasibleError, "no plan to hold"),
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
