"""Controllers in C with a distribution of tensions: whole loops, limits, precision, two in one program."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle, build_controller
from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.loop.tension_distribution import (
    TensionDistribution,
    design_distribution,
)
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import InvalidValueError, MissingSourceError
from tests.body_scenes import assemble_document
from tests.codegen.build_c import STRICT, has_sanitizers, require_cpp, run
from tests.codegen.compilers import require_compiler
from tests.codegen.quickly import without_optimisation
from tests.control.embedded.daqp import require_daqp_archive
from tests.control.embedded.replay import check_same, replay, replay_states
from tests.control.feedback.pinned_prism import draw_errors, move_prism, prism_document

pytest.importorskip("daqp")
SEED = 1


@pytest.fixture(scope="module", autouse=True)
def archive() -> Iterator[None]:
    require_daqp_archive()
    with without_optimisation():
        yield


@pytest.fixture(scope="module")
def distribution(model: CompiledModel, motion: Motion) -> TensionDistribution:
    return design_distribution(model, motion, least_tension=10.0)


@pytest.fixture(scope="module")
def loop(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    estimator: Estimator,
    distribution: TensionDistribution,
) -> ControlRun:
    """A loop in which least tensions yield, rates limit, and all is well at the end."""
    parts = {"estimator": estimator, "distribution": distribution}
    return simulate_control(
        model, motion, gains.at_knots(), t_end=1.0, disturbance=draw_errors(model, SEED, SEED), **parts
    )


@pytest.fixture(scope="module")
def bundle(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    estimator: Estimator,
    distribution: TensionDistribution,
    tmp_path_factory: pytest.TempPathFactory,
) -> ControllerBundle:
    folder = tmp_path_factory.mktemp("controller") / "ctl"
    return build_controller(model, motion, gains, estimator=estimator, distribution=distribution, out=folder)


@pytest.mark.thorough
def test_a_noisy_loop_is_that_of_python(
    bundle: ControllerBundle, motion: Motion, estimator: Estimator, loop: ControlRun
) -> None:
    controller = bundle.load()
    check_same(replay(controller, loop, motion, estimator, SEED), loop, motion)
    assert {"ok", "rate_limited", "least_tension"} <= set(loop.step_status)
    assert 1 <= int(controller.read("distribution.iterations")) <= 100


@pytest.mark.thorough
def test_a_simulated_loop_in_c_is_that_of_python(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    estimator: Estimator,
    distribution: TensionDistribution,
    loop: ControlRun,
) -> None:
    draw = draw_errors(model, SEED, SEED)
    (found,) = simulate_control_batch(
        model, motion, gains, draws=[draw], estimator=estimator, distribution=distribution, t_end=1.0
    )
    assert found.step_status == loop.step_status
    np.testing.assert_allclose(found.coordinate, loop.coordinate, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.command, loop.command, rtol=0, atol=1e-9)
    assert found.yielding is not None
    np.testing.assert_array_equal(found.yielding, loop.yielding)


def test_yielding_members_are_those_of_python(
    bundle: ControllerBundle, distribution: TensionDistribution, loop: ControlRun
) -> None:
    controller, driven = bundle.load(), distribution.cables.driven
    assert controller.init() == "ok"
    assert loop.yielding is not None
    assert loop.estimate is not None
    # The loop holds its command at an outlier, which steps from states cannot know.
    count = [*loop.step_status, "outlier"].index("outlier")
    assert loop.yielding[:count].any()
    for k in range(min(count, 60)):
        status, _ = controller.step_state(0.005 * k, loop.estimate[k])
        assert status == loop.step_status[k]
        assert (
            controller.read("distribution.yields").astype(bool).tolist() == loop.yielding[k, driven].tolist()
        )


@pytest.mark.thorough
def test_an_own_range_and_a_distribution_without_gains(
    model: CompiledModel, motion: Motion, distribution: TensionDistribution, tmp_path: Path
) -> None:
    """The last actuator's range ends half-way on its path."""
    limits = np.tile([0.1, 0.5], (9, 1))
    start, end = motion.rest_length[0, 8], motion.rest_length[-1, 8]
    limits[8, int(end > start)] = 0.5 * (start + end)
    wide = {"limits": ActuatorLimits(range=limits), "distribution": distribution}
    bundle = build_controller(model, motion, out=tmp_path / "ctl", **wide)
    done = simulate_control(model, motion, t_end=1.2, disturbance=draw_errors(model, 3), **wide)
    check_same(replay_states(bundle.load(), done), done, motion, tolerance=1e-10)


def test_a_program_that_is_cut_short_leaves_commands_within_rate_and_range(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    estimator: Estimator,
    distribution: TensionDistribution,
    loop: ControlRun,
    tmp_path: Path,
) -> None:
    parts = {"estimator": estimator, "distribution": distribution}
    bundle = build_controller(
        model, motion, gains, **parts, code=ControllerCode(qp_iterations=1), out=tmp_path / "ctl"
    )
    done = replay(bundle.load(), loop, motion, estimator, SEED)
    assert {"ok", "not_solved"} <= set(done.statuses)
    bounds = distribution.bounds
    start = motion.at(0.0).input[bounds.place]
    moved = np.abs(np.diff(np.vstack([start, done.command]), axis=0))
    assert (moved <= bounds.rate * 0.005 + 1e-12).all()
    assert (done.command >= bounds.least).all()
    assert (done.command <= bounds.most).all()


@pytest.mark.thorough
def test_single_precision_gives_the_same_statuses_and_nearly_the_same_commands(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    estimator: Estimator,
    distribution: TensionDistribution,
    loop: ControlRun,
    tmp_path: Path,
) -> None:
    parts = {"estimator": estimator, "distribution": distribution}
    bundle = build_controller(
        model, motion, gains, **parts, code=ControllerCode(precision="single"), out=tmp_path / "ctl"
    )
    done = replay(bundle.load(), loop, motion, estimator, SEED)
    assert "not_solved" not in done.statuses
    same = sum(ours == theirs for ours, theirs in zip(done.statuses, loop.step_status, strict=True))
    assert same > 0.8 * len(done.statuses)
    assert np.median(np.abs(done.command - loop.command).max(axis=1)) < 1e-5
    command = [*require_compiler("gcc").command, "-std=c99", "-O1", *STRICT, "-Wshadow", "-Wdouble-promotion"]
    run([*command, "-c", "pinned_prism_control.c", "-o", str(tmp_path / "single.o")], bundle.folder)


def test_the_bundle_has_the_solver_with_its_licence_and_no_memory_of_its_own(
    bundle: ControllerBundle, tmp_path: Path
) -> None:
    assert {"LICENSE-DAQP.txt", "pinned_prism_control_daqp.h"} <= set(bundle.files)
    assert "MIT License" in (bundle.folder / "LICENSE-DAQP.txt").read_text(encoding="utf-8")
    assert "LICENSE-DAQP.txt" in (bundle.folder / "README.md").read_text(encoding="utf-8")
    command = [*require_compiler("gcc").command, "-std=c99", "-O0", *STRICT, "-Wshadow"]
    run([*command, "-c", "pinned_prism_control.c", "-o", str(tmp_path / "control.o")], bundle.folder)
    table = [line.split()[-2:] for line in run(["nm", "control.o"], tmp_path).stdout.splitlines()]
    assert not [symbol for kind, symbol in table if kind in "dDbBC"]
    outside = {symbol for kind, symbol in table if kind == "U"}
    assert not outside & {"malloc", "calloc", "realloc", "free"}
    assert not [symbol for kind, symbol in table if "daqp" in symbol.lower() and kind.isupper()]
    run([*require_cpp("g++"), "-x", "c++", "-std=c++11", "-c", "pinned_prism_control.c", "-o",
         str(tmp_path / "control_cpp.o")], bundle.folder)  # fmt: skip


TWO = """
#include "pinned_prism_control.h"
#include "other_control.h"
#include <string.h>
int main(void)
{
  static pinned_prism_control a;
  static other_control b;
  double rest[9], other[9], state[12] = {0};
  int k, is_same = 1;
  pinned_prism_control_init(&a, NULL);
  other_control_init(&b, NULL);
  memcpy(state, a.estimate, 6 * sizeof state[0]);
  for (k = 0; k < 50; ++k) {
    pinned_prism_control_next_state(&a, state, rest);
    other_control_next_state(&b, state, other);
    is_same &= memcmp(rest, other, sizeof rest) == 0 && a.status == b.status;
  }
  return !is_same;
}
"""


@pytest.mark.thorough
def test_two_controllers_in_one_program_under_sanitizers(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    distribution: TensionDistribution,
    bundle: ControllerBundle,
    estimator: Estimator,
    tmp_path: Path,
) -> None:
    parts = {"estimator": estimator, "distribution": distribution}
    other = build_controller(
        model, motion, gains, **parts, code=ControllerCode(name="other", library=False), out=tmp_path / "ctl"
    )
    (tmp_path / "main.c").write_text(TWO, encoding="utf-8")
    sanitize = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = [*require_compiler("gcc").command, "-std=c99", "-O0", "-ffp-contract=off"]
    command += sanitize if has_sanitizers(require_compiler("gcc"), tmp_path) else []
    sources = [
        str(item.folder / file) for item in (bundle, other) for file in item.files if file.endswith(".c")
    ]
    sources = [name for name in sources if not name.endswith("example.c")]
    folders = [f"-I{item.folder}" for item in (bundle, other)]
    run([*command, *folders, "main.c", *sources, "-lm", "-o", "main"], tmp_path)
    run([str(tmp_path / "main")], tmp_path)


@pytest.mark.thorough
def test_inputs_that_are_no_actuators(tmp_path: Path) -> None:
    document = prism_document()
    document["inputs"] = [{"name": "hand", "kind": "rest_length", "members": ["top1", "opposite2"]}]
    system, request = assemble_document(document)
    model = build_library(system, want_analyses(system, request, ("control", "simulate"))).load()
    motion = move_prism(model)
    moved = motion.input.copy()
    moved[:, motion.input_name.index("hand")] = 0.002 * np.sin(motion.time)
    motion = replace(motion, input=moved)
    distribution = design_distribution(model, motion, least_tension=5.0)
    bundle = build_controller(model, motion, distribution=distribution, out=tmp_path / "ctl")
    done = simulate_control(
        model, motion, distribution=distribution, t_end=0.5, disturbance=draw_errors(model, 3)
    )
    check_same(replay_states(bundle.load(), done), done, motion)


@pytest.mark.parametrize("value", [0, -1, 10**6, 2.5, True, "many"])
def test_a_wrong_number_of_iterations_is_refused(
    model: CompiledModel, motion: Motion, distribution: TensionDistribution, value: object, tmp_path: Path
) -> None:
    with pytest.raises(InvalidValueError, match="qp_iterations"):
        build_controller(
            model,
            motion,
            distribution=distribution,
            code=ControllerCode(qp_iterations=value),
            out=tmp_path / "ctl",  # type: ignore[arg-type]
        )
    assert not (tmp_path / "ctl").exists()


def test_another_archive_is_refused_and_nothing_is_written(
    model: CompiledModel, motion: Motion, distribution: TensionDistribution, tmp_path: Path
) -> None:
    (tmp_path / "daqp.tar.gz").write_bytes(b"something else")
    with pytest.raises(MissingSourceError, match="SHA-256"):
        build_controller(
            model,
            motion,
            distribution=distribution,
            code=ControllerCode(daqp_sdist=tmp_path / "daqp.tar.gz"),
            out=tmp_path / "ctl",
        )
    assert not (tmp_path / "ctl").exists()


def test_a_distribution_for_another_motion_is_refused(
    model: CompiledModel, motion: Motion, distribution: TensionDistribution, tmp_path: Path
) -> None:
    other = replace(motion, time=2.0 * motion.time)
    with pytest.raises(InvalidValueError, match="designed for another motion"):
        build_controller(model, other, distribution=distribution, out=tmp_path / "ctl")
