"""Controllers in C programs: warnings, sanitizers, threads, two of them, small machines, build files."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle, build_controller
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tests.cases import thorough
from tests.codegen.build_c import STRICT, has_sanitizers, require_cpp, run
from tests.codegen.compilers import FAMILIES, require_compiler
from tests.codegen.quickly import SANITIZE, without_optimisation
from tests.control.embedded.replay import check_same, replay

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen" / "scene" / "examples"
LIFT = """
[[actuators]]
name = "winch"
members = "cord"
rate = 0.2
[[sensors]]
kind = "member_length"
members = "cord"
noise = 1e-3
"""
PROMOTION = "-Wdouble-promotion"


@pytest.fixture(scope="module")
def single(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    estimator: Estimator,
    tmp_path_factory: pytest.TempPathFactory,
) -> ControllerBundle:
    """The controller of the prism in single precision, under another name."""
    folder = tmp_path_factory.mktemp("single") / "ctl"
    with without_optimisation():
        return build_controller(
            model,
            motion,
            gains,
            estimator=estimator,
            code=ControllerCode(precision="single", name="small"),
            out=folder,
        )


@pytest.fixture(scope="module")
def lift(tmp_path_factory: pytest.TempPathFactory) -> ControllerBundle:
    """A mass on a cord in node positions, held at its equilibrium."""
    folder = tmp_path_factory.mktemp("lift")
    scene = folder / "lift.toml"
    text = (EXAMPLES / "two_nodes.toml").read_text(encoding="utf-8")
    scene.write_text('axes = "z"\n' + text + LIFT, encoding="utf-8")
    with without_optimisation():
        model = compile_scene(scene, for_=("equilibrium", "control"))
        found = find_equilibrium(model)
        gains = design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
        estimator = design_kalman(model, found, sample=0.02, knots=2)
        return build_controller(
            scene, found, gains, estimator=estimator, code=ControllerCode(name="lift"), out=folder / "ctl"
        )


def list_c(bundle: ControllerBundle) -> list[str]:
    return [name for name in bundle.files if name.endswith(".c") and name != "example.c"]


def compile_all(bundle: ControllerBundle, command: tuple[str, ...], *options: str) -> None:
    for name in list_c(bundle):
        run([*command, *options, *STRICT, "-Wshadow", "-c", name, "-o", f"{name}.o"], bundle.folder)


@pytest.mark.thorough
def test_no_compiler_warns(bundle: ControllerBundle, single: ControllerBundle) -> None:
    gcc = require_compiler("gcc").command
    compile_all(bundle, gcc, "-std=c99", "-O1")
    compile_all(single, gcc, "-std=c99", "-O1", PROMOTION)
    compile_all(bundle, require_cpp("g++"), "-x", "c++", "-std=c++11", "-O0")


@pytest.mark.thorough
@pytest.mark.parametrize("family", FAMILIES)
def test_no_compiler_of_any_family_warns(
    family: str, bundle: ControllerBundle, single: ControllerBundle, lift: ControllerBundle
) -> None:
    command = require_compiler(family).command
    for controller in (bundle, lift):
        compile_all(controller, command, "-std=c99", "-O2")
    compile_all(single, command, "-std=c99", "-Os", PROMOTION)
    cpp = require_cpp({"gcc": "g++", "clang": "clang++", "zig": "zig"}[family])
    for controller in (bundle, single, lift):
        compile_all(controller, cpp, "-x", "c++", "-std=c++11", "-O1")


@pytest.mark.thorough
def test_parts_that_are_not_there_leave_nothing_unused(
    model: CompiledModel, motion: Motion, gains: Gains, tmp_path: Path
) -> None:
    gcc = require_compiler("gcc").command
    no_force = design_kalman(model, motion, sample=0.005, disturbance=0.0, knots=2)
    built = [
        build_controller(model, motion, out=tmp_path / "open", code=ControllerCode(library=False)),
        build_controller(model, motion, gains, out=tmp_path / "state", code=ControllerCode(library=False)),
        build_controller(
            model,
            motion,
            gains,
            estimator=no_force,
            out=tmp_path / "plain",
            code=ControllerCode(library=False),
        ),
    ]
    for bundle in built:
        compile_all(bundle, gcc, "-std=c99", "-O1")
    assert list_c(built[0]) == list_c(built[1]) == ["pinned_prism_control.c"]
    text = (tmp_path / "plain" / "pinned_prism_control_model.h").read_text(encoding="utf-8")
    assert "mass_matrix" not in text
    assert "member_tension(" not in text


def test_objects_hold_no_data_that_changes_and_call_no_allocator(bundle: ControllerBundle) -> None:
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm is not installed: binutils has it")
    compile_all(bundle, require_compiler("gcc").command, "-std=c99", "-O1", "-fPIC")
    lines = [
        line.split()
        for name in list_c(bundle)
        for line in run([nm, f"{name}.o"], bundle.folder).stdout.splitlines()
    ]
    kinds = {words[-2] for words in lines}
    assert kinds <= {"T", "t", "r", "R", "U"}
    outside = {words[-1] for words in lines if words[-2] == "U" and "prism" not in words[-1]}
    assert outside <= {"memset", "memcpy", "sin", "cos", "sincos", "sqrt", "_GLOBAL_OFFSET_TABLE_"}


# Two controllers in one program, the first one in 16 threads that all must give the same numbers.
THREADS = r"""
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include "lift_control.h"
#include "pinned_prism_control.h"

enum { STEPS = 400, THREADS = 16 };
static double found[THREADS][STEPS][PINNED_PRISM_CONTROL_N_ACTUATORS];
static double lengths[STEPS][PINNED_PRISM_CONTROL_N_SENSORS];

static void *drive(void *place)
{
  const int thread = *(const int *)place;
  pinned_prism_control c;
  int k;
  pinned_prism_control_init(&c, NULL);
  for (k = 0; k < STEPS; ++k) {
    pinned_prism_control_step(&c, k * PINNED_PRISM_CONTROL_SAMPLE, lengths[k], found[thread][k]);
  }
  return NULL;
}

static int hold_lift(void)
{
  lift_control c;
  const double length[1] = {1.5}, bad[1] = {0.0};
  double rest[1], worst = 0.0;
  int k, status = lift_control_init(&c, NULL);
  for (k = 0; k < 100; ++k) {
    const double before = c.command[0];
    status = lift_control_step(&c, k * LIFT_CONTROL_SAMPLE, k % 10 == 9 ? bad : length, rest);
    worst = c.command[0] - before > worst ? c.command[0] - before : worst;
    worst = before - c.command[0] > worst ? before - c.command[0] : worst;
    if ((k % 10 == 9) != (status == LIFT_CONTROL_INVALID_LENGTH)) return 1;
  }
  printf("%s; %s; %s; %s\n", lift_control_status_text(status), lift_control_actuator_name(0),
         lift_control_actuator_name(1), lift_control_status_text(-1));
  return worst > 0.2 * LIFT_CONTROL_SAMPLE * 1.000001;
}

int main(void)
{
  pthread_t thread[THREADS];
  int place[THREADS], k, j, same = 1;
  for (k = 0; k < STEPS; ++k) {
    for (j = 0; j < PINNED_PRISM_CONTROL_N_SENSORS; ++j) {
      lengths[k][j] = 0.3 + 0.001 * ((k * 7 + j * 3) % 11);
    }
    if (k % 17 == 3) lengths[k][k % 9] = 0.0;
    if (k % 23 == 5) lengths[k][k % 9] = 0.0 / (lengths[k][0] - lengths[k][0]);
  }
  for (k = 0; k < THREADS; ++k) {
    place[k] = k;
    if (pthread_create(&thread[k], NULL, drive, &place[k]) != 0) return 2;
  }
  for (k = 0; k < THREADS; ++k) {
    pthread_join(thread[k], NULL);
    same = same && memcmp(found[0], found[k], sizeof found[0]) == 0;
  }
  printf("same %d\n", same);
  return hold_lift() || !same;
}
"""


@pytest.mark.thorough
@pytest.mark.parametrize("sanitize", [*thorough(False), True])
def test_two_controllers_and_16_threads(
    bundle: ControllerBundle, lift: ControllerBundle, tmp_path: Path, sanitize: bool
) -> None:
    gcc = require_compiler("gcc")
    if sanitize and not has_sanitizers(gcc, tmp_path):
        pytest.skip("the sanitizers of gcc are not installed")
    (tmp_path / "main.c").write_text(THREADS, encoding="utf-8")
    sources = [str(item.folder / name) for item in (bundle, lift) for name in list_c(item)]
    folders = [f"-I{item.folder}" for item in (bundle, lift)]
    options = SANITIZE if sanitize else ("-O1",)
    command = [
        *gcc.command,
        "-std=gnu99",
        *options,
        *folders,
        "main.c",
        *sources,
        "-o",
        "main",
        "-lm",
        "-pthread",
    ]
    run(command, tmp_path)
    said = run([str(tmp_path / "main")], tmp_path).stdout.splitlines()
    assert said[0] == "same 1"
    assert said[1] == "a measured length is not above 0; the last command holds; winch; ; not a status"


def test_the_makefile_builds_the_example(bundle: ControllerBundle, tmp_path: Path) -> None:
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    folder = copy(bundle, tmp_path)
    run(["make", "CC=" + " ".join(require_compiler("gcc").command)], folder)
    said = run([str(folder / "example")], folder).stdout
    assert said.startswith("step 0: the command is what feedback asks for")
    assert said.count("m_opposite3") == 10
    assert run(["sha256sum", "-c", "SHA256SUMS"], bundle.folder).returncode == 0


@pytest.mark.thorough
def test_cmake_builds_the_example(lift: ControllerBundle, tmp_path: Path) -> None:
    if shutil.which("cmake") is None:
        pytest.skip("cmake is not installed")
    folder = copy(lift, tmp_path)
    run(["cmake", "-S", ".", "-B", "build"], folder)
    run(["cmake", "--build", "build"], folder)
    assert "step 9" in run([str(folder / "build" / "lift_control_example")], folder).stdout


def copy(bundle: ControllerBundle, folder: Path) -> Path:
    shutil.copytree(bundle.folder, folder / "copy")
    return folder / "copy"


def test_single_precision_follows_double(
    single: ControllerBundle, model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    """Commands differ by less than 2e-5 of the rest lengths; no double is in the sources."""
    for name in list_c(single):
        text = (single.folder / name).read_text(encoding="utf-8")
        assert not re.search(r"\bdouble\b", re.sub(r"/\*.*?\*/|\"[^\"\n]*\"", "", text, flags=re.DOTALL))
    run_ = simulate_control(
        model, motion, gains.at_knots(), estimator=estimator, t_end=1.0, disturbance=Disturbance(seed=4)
    )
    done = replay(single.load(), run_, motion, estimator, 4)
    np.testing.assert_allclose(done.command, run_.command, rtol=0, atol=2e-5 * motion.rest_length.max())


@pytest.mark.thorough
def test_a_small_machine_needs_no_arithmetic_in_double(single: ControllerBundle, tmp_path: Path) -> None:
    """Cortex-M4, -Os: sizes are printed, and no helper of double arithmetic is called."""
    pytest.importorskip("ziglang", reason="the package ziglang is not installed")
    nm, size = shutil.which("nm"), shutil.which("size")
    if nm is None or size is None:
        pytest.skip("nm and size are not installed: binutils has them")
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "thumb-linux-musleabihf", "-mcpu=cortex_m4"]
    options = ["-Os", "-std=c99", "-g0", "-fno-sanitize=undefined", *STRICT, PROMOTION]
    zig_compiler = require_compiler("zig")
    objects = []
    for name in list_c(single):
        objects.append(str(tmp_path / f"{name}.o"))
        run([*zig, *options, "-c", name, "-o", objects[-1]], single.folder, zig_compiler)
    called = subprocess.run([nm, *objects], capture_output=True, text=True, check=False).stdout
    if "U " not in called:
        pytest.skip("nm of this machine does not read objects of ARM")
    assert not re.search(r"__aeabi_(d|f2d|i2d|ui2d|l2d)|__\w+df[23]|\bmalloc\b", called)
    print(subprocess.run([size, *objects], capture_output=True, text=True, check=False).stdout)


def test_a_noisy_loop_in_node_positions_is_that_of_python(lift: ControllerBundle) -> None:
    with without_optimisation():
        model = compile_scene(lift.folder.parent / "lift.toml", for_=("equilibrium", "control"))
    found = find_equilibrium(model)
    gains = design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
    estimator = design_kalman(model, found, sample=0.02, knots=2)
    loop = simulate_control(
        model,
        found,
        gains,
        estimator=estimator,
        t_end=1.0,
        disturbance=Disturbance(coordinate_error=[0.05], seed=1),
    )
    motion = build_rest(model, found)
    check_same(replay(lift.load(), loop, motion, estimator, 1), loop, motion)
