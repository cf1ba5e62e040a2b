"""Projects for acados: their C beside the model, limits, bounds, refusals; with acados our own plans."""

import contextlib
import ctypes
import importlib.util
import io
import json
import os
import shlex
import subprocess
import sys
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen import ActuatorLimits, Equilibrium, Mpc, build_controller, compile_scene, design_mpc
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.control.feedback.loop.actuator_bounds import find_bounds
from tensegrity_codegen.export.export_acados import export_acados
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, OutputError
from tests.codegen.build_c import STRICT, run
from tests.codegen.compilers import require_compiler
from tests.codegen.quickly import without_optimisation
from tests.control.embedded.mpc_reference import ReferenceMpc

Array = NDArray[np.float64]

SAMPLE = 0.004  # [s]
INPUTS = {"push": 0.4, "slack_off": 0.002}
# Elastic bars; cables with either stiffness; inputs of force and rest length that are no actuators.
FRAME = """
name = "frame"
axes = "xz"

[classes.bar]
kind = "bar"
spring_constant = 4e3
mass = 0.15
damping = 3.0
prestress = -36.0

[classes.cable]
kind = "cable"
spring_constant = 300
prestress = 30
damping = 3.0

[nodes]
a = { position = [0, 0], anchored = true }
b = { position = [0.6, 0], mass = 0.1, anchored = "z" }
c = { position = [0.6, 0.4], mass = 0.1 }
d = { position = [0, 0.4], mass = 0.1 }

[members]
ac = { class = "bar", nodes = ["a", "c"] }
bd = { class = "bar", nodes = ["b", "d"] }
bottom = { class = "cable", nodes = ["a", "b"] }
top = { class = "cable", nodes = ["d", "c"] }
left = { kind = "cable", nodes = ["a", "d"], axial_stiffness = 120, prestress = 20, damping = 3.0 }
right = { class = "cable", nodes = ["b", "c"], prestress = 20 }

[[inputs]]
name = "push"
kind = "force"
nodes = ["d"]
direction = [1.0, 0.0]

[[inputs]]
name = "slack_off"
kind = "rest_length"
members = ["top"]

[[actuators]]
name = "at_top"
members = ["top"]
rate = 0.2
range = [0.3, 0.7]

[[actuators]]
name = "at_left"
members = ["left"]
rate = 0.3

[[actuators]]
name = "at_right"
members = ["right"]
"""
# What dynamics.c needs of acados and BLASFEO: vectors, and a matrix stored column by column.
HEADER = """
#include <stddef.h>
struct blasfeo_dvec { double *pa; };
struct blasfeo_dmat { double *pa; int rows; };
struct blasfeo_dvec_args { struct blasfeo_dvec *x; int xi; };
struct blasfeo_dmat_args { struct blasfeo_dmat *A; int ai, aj; };
void blasfeo_unpack_dvec(int m, struct blasfeo_dvec *from, int i, double *to, int step);
void blasfeo_pack_dvec(int m, double *from, int step, struct blasfeo_dvec *to, int i);
void blasfeo_pack_dmat(int m, int n, double *from, int width, struct blasfeo_dmat *to, int i, int j);
"""
DRIVER = """
#include "blasfeo_d_aux.h"
int frame_control_move_jacobian(void **in, void **out, void *p);
int frame_control_hold_jacobian(void **in, void **out, void *p);
void blasfeo_unpack_dvec(int m, struct blasfeo_dvec *from, int i, double *to, int step)
{
  for (int k = 0; k < m; ++k) to[k * step] = from->pa[i + k];
}
void blasfeo_pack_dvec(int m, double *from, int step, struct blasfeo_dvec *to, int i)
{
  for (int k = 0; k < m; ++k) to->pa[i + k] = from[k * step];
}
void blasfeo_pack_dmat(int m, int n, double *from, int width, struct blasfeo_dmat *to, int i, int j)
{
  for (int r = 0; r < m; ++r)
    for (int c = 0; c < n; ++c) to->pa[(j + c) * to->rows + i + r] = from[c * width + r];
}
void call(int moves, double *state, double *move, double *parameter, double *next, double *jacobian, int rows)
{
  struct blasfeo_dvec x = {state}, u = {move}, y = {next};
  struct blasfeo_dmat by = {jacobian, rows};
  struct blasfeo_dvec_args x_in = {&x, 0}, u_in = {&u, 0}, y_out = {&y, 0};
  struct blasfeo_dmat_args by_out = {&by, 0, 0};
  void *in[] = {&x_in, &u_in}, *out[] = {&y_out, &by_out};
  (moves ? frame_control_move_jacobian : frame_control_hold_jacobian)(in, out, parameter);
}
"""


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> tuple[CompiledModel, Equilibrium, Mpc]:
    """The frame at rest, with sums, least tensions, a range, and a first block of two commands."""
    path = tmp_path_factory.mktemp("frame") / "frame.toml"
    path.write_text(FRAME, encoding="utf-8")
    with without_optimisation():
        model = compile_scene(path, for_=("equilibrium", "control"))
    found = find_equilibrium(model, arguments=INPUTS)
    weight = np.concatenate([np.full(5, 1e3), np.ones(5), [10.0, 20.0]])
    mpc = design_mpc(
        model, found, weight, np.full(3, 1e4), sample=SAMPLE, horizon=12, blocks=[2, 2, 8], least_tension=3.0,
        integral_action=["c.x", "d.z"], arguments=INPUTS,
        coordinate_range={"b.x": (-1e3, float(found.coordinate[0]) + 5e-4)},
    )  # fmt: skip
    return model, found, mpc


@pytest.fixture(scope="module")
def project(frame: tuple[CompiledModel, Equilibrium, Mpc], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("acados") / "project"
    export_acados(*frame, out=folder, arguments=INPUTS)
    return folder


def load_script(folder: Path) -> Any:
    """Return the script of a project as a module."""
    spec = importlib.util.spec_from_file_location("make_solver", folder / "make_solver.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def script(project: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The script, where only acados is missing."""
    stand_in = ModuleType("acados_template")
    vars(stand_in).update(AcadosMultiphaseOcp=None, AcadosOcpSolver=None)
    monkeypatch.setitem(sys.modules, "acados_template", stand_in)
    return load_script(project)


def list_states(mpc: Mpc, script: Any) -> list[tuple[Array, Array]]:
    """Return states around the motion, and commands before them, at the samples."""
    rng = np.random.default_rng(0)
    states, inputs = (
        script.NUMBERS["motion_state"],
        script.NUMBERS["motion_input"][:, script.PROBLEM["place"]],
    )
    rows = [min(k, len(states) - 1) for k in range(30)]
    return [
        (
            states[k] + rng.normal(size=script.N_X) * np.repeat([4e-4, 4e-3], script.N_X // 2),
            inputs[k] + 2e-4 * rng.normal(size=script.N_U),
        )
        for k in rows
    ]


@pytest.mark.parametrize("moves", [True, False])
def test_a_sample_in_c_is_that_of_the_model(
    moves: bool, frame: tuple[CompiledModel, Equilibrium, Mpc], project: Path, tmp_path: Path
) -> None:
    """Against the NumPy reference over compiled functions of the model, and central differences of the C."""
    model, found, mpc = frame
    (tmp_path / "acados" / "utils").mkdir(parents=True)
    (tmp_path / "acados" / "utils" / "external_function_generic.h").write_text("", encoding="utf-8")
    (tmp_path / "blasfeo_d_aux.h").write_text(HEADER, encoding="utf-8")
    (tmp_path / "driver.c").write_text(DRIVER, encoding="utf-8")
    flags = ("-std=c99", "-O1", *STRICT, "-fPIC", "-shared", "-I.")
    command = [*require_compiler("gcc").command, *flags, "driver.c", str(project / "dynamics.c")]
    run([*command, "-lm", "-o", "dynamics.so"], tmp_path)
    library = ctypes.CDLL(str(tmp_path / "dynamics.so"))

    def call(x: Array, u: Array, p: Array) -> tuple[Array, Array]:
        size = len(x) + len(u)
        arrays = [x.copy(), u.copy(), p, np.zeros(len(x)), np.zeros((len(x), size))]
        library.call(int(moves), *(ctypes.c_void_p(item.ctypes.data) for item in arrays), size)
        return arrays[3], arrays[4]

    rng, n, m = np.random.default_rng(1), 5, 3
    rest = build_rest(model, found, SAMPLE, INPUTS)
    goal = np.concatenate([found.coordinate, np.zeros(n)])
    x = np.concatenate([goal + 1e-3 * rng.normal(size=2 * n), rng.normal(size=2), 1e-3 * rng.normal(size=m)])
    u = 1e-3 * rng.normal(size=m if moves else 0)
    p = np.concatenate([rest.input[0], goal])
    next_state, jacobian = call(x, u, p)
    # The reference moves the state with all inputs.
    reference = ReferenceMpc(model, rest, mpc, find_bounds(model, rest))
    value = rest.input[0].copy()
    deviation = x[-m:] + (u if moves else 0.0)
    value[reference.bounds.place] += deviation
    reached, by_state, by_input = reference._advance(x[: 2 * n].copy(), value)
    sums = x[2 * n : -m] + mpc.gains.integral_action @ (x[: 2 * n] - goal)
    np.testing.assert_allclose(next_state, np.concatenate([reached, sums, deviation]), rtol=1e-12, atol=1e-13)
    own = jacobian[:, len(u) :]
    np.testing.assert_allclose(own[: 2 * n, : 2 * n], by_state, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(own[: 2 * n, -m:], by_input, rtol=1e-10, atol=1e-11)
    step, both = 1e-6, np.concatenate([u, x])
    for k in range(len(both)):
        ends = [
            call(*np.split(both + sign * step * np.eye(len(both))[k], [len(u)])[::-1], p)[0]
            for sign in (1, -1)
        ]
        np.testing.assert_allclose(jacobian[:, k], (ends[0] - ends[1]) / (2 * step), rtol=1e-6, atol=1e-7)


def test_longest_rest_lengths_are_those_of_the_tensions(
    frame: tuple[CompiledModel, Equilibrium, Mpc], script: Any
) -> None:
    model, found, mpc = frame
    coordinate = found.coordinate + 0.01 * np.random.default_rng(2).normal(size=5)
    limits = np.array(ca.DM(script.member_limits(ca.DM(coordinate)))).ravel()
    length = np.asarray(model.compute("member_length", coordinate=coordinate))
    known = mpc.cables.find_rest_length(length, mpc.least_tension)[mpc.cables.limited]
    np.testing.assert_allclose(limits, known, rtol=1e-14)


class Recorder:
    """What the script tells a solver, by stage and name."""

    def __init__(self) -> None:
        self.told: dict[tuple[int, str], Array] = {}

    def set(self, stage: int, key: str, value: Array) -> None:
        self.told[stage, key] = value

    constraints_set = cost_set = set


def test_bounds_are_rates_and_ranges_of_the_commands(
    frame: tuple[CompiledModel, Equilibrium, Mpc], script: Any
) -> None:
    """The first command is 0.3 mm below the end of its range; the others are bounded at block ends."""
    model, found, _ = frame
    solver = Recorder()
    bounds = find_bounds(model, build_rest(model, found, 1.0, INPUTS))
    before = np.array([bounds.most[0] - 3e-4, 0.01, 0.02])
    state = script.NUMBERS["motion_state"][0]
    script.Controller(solver).begin(0, state, np.zeros(2), before)
    reach = SAMPLE * np.array([0.2, 0.3])
    np.testing.assert_allclose(solver.told[0, "ubu"], [3e-4, reach[1], 1e10], rtol=1e-9)
    np.testing.assert_allclose(
        solver.told[0, "lbu"], [-reach[0], -reach[1], -0.02 + bounds.least[2]], rtol=1e-9
    )
    np.testing.assert_allclose(solver.told[2, "ubu"][:2], 2 * reach)
    np.testing.assert_allclose(solver.told[4, "lbu"][:2], -8 * reach)
    np.testing.assert_allclose(solver.told[12, "ubx"][0], bounds.most[0])
    assert (2, "ubx") not in solver.told  # that of the first command is an input's
    np.testing.assert_allclose(solver.told[0, "lbx"][-3:], before)
    assert [end for end, moves in script.list_phases() if moves] == [1, 1, 1]


def test_a_project_is_whole_and_compiles(project: Path) -> None:
    names = {"README.md", "SHA256SUMS", "dynamics.c", "make_solver.py", "no_functions.c", "problem.json"}
    assert {path.name for path in project.iterdir() if path.is_file()} == names
    done = subprocess.run(
        [sys.executable, *shlex.split("-m ruff check --isolated --select E,F,W --line-length 120 .")],
        cwd=project, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    problem = json.loads((project / "problem.json").read_text(encoding="utf-8"))
    assert (problem["name"], problem["blocks"], problem["bounded"]) == ("frame", [2, 2, 8], [0])


def test_what_the_project_cannot_have_is_refused(
    frame: tuple[CompiledModel, Equilibrium, Mpc], tmp_path: Path
) -> None:
    model, found, mpc = frame
    for late, error, words in (
        ({"limits": ActuatorLimits(delay=[0.0, 0.01, 0.0])}, FormulationError, "actuators.at_left.delay"),
        ({"mpc": mpc.gains}, InvalidValueError, "mpc"),
        ({"out": tmp_path / "frame.toml" / "x"}, OutputError, "not a folder"),
        ({"overwrite": 1}, InvalidValueError, "overwrite"),
    ):
        (tmp_path / "frame.toml").write_text(FRAME, encoding="utf-8")
        given = {"mpc": mpc, "out": tmp_path / "p", "arguments": INPUTS, **late}  # type: ignore[dict-item]
        with pytest.raises(error, match=words):
            export_acados(model, found, **given)  # type: ignore[arg-type]
    assert not (tmp_path / "p").exists()


def test_lengths_with_a_condition_are_refused(
    frame: tuple[CompiledModel, Equilibrium, Mpc], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = ca.SX.sym("x", 5)
    length = ca.if_else(x[0] < 0.0, x[1], x[2]) * ca.SX.ones(6)
    made = SimpleNamespace(arguments={"coordinate": SimpleNamespace(symbol=x)}, expression=lambda _: length)
    monkeypatch.setattr("tensegrity_codegen.export.export_acados.build_model", lambda *_: made)
    with pytest.raises(FormulationError, match="lengths of members need an operation"):
        export_acados(*frame, out=tmp_path / "p", arguments=INPUTS)


@pytest.mark.peers
def test_acados_plans_what_the_controller_in_c_plans(
    frame: tuple[CompiledModel, Equilibrium, Mpc], project: Path, tmp_path: Path
) -> None:
    """Thirty samples with active limits of several kinds; DAQP in acados to 1e-12."""
    pytest.importorskip("acados_template", reason="needs acados and acados_template")
    if "ACADOS_SOURCE_DIR" not in os.environ:
        pytest.skip("ACADOS_SOURCE_DIR does not say where acados is built")
    model, found, mpc = frame
    script = load_script(project)
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of versions that acados has not tried
        peer = script.Controller(script.make_solver(**script.SOLVERS["daqp"]))
    ours = build_controller(model, found, mpc, out=tmp_path / "ours", arguments=INPUTS).load()
    ours.init()
    memory, seen = ours._memory, set()
    for k, (state, before) in enumerate(list_states(mpc, script)):
        peer.begin(k, state, np.zeros(2), before)
        peer.solver.solve()
        assert peer.read() == 0
        for place, value in enumerate(before.tolist()):
            memory.command[place] = memory.sent[place] = memory.sent[3 + place] = value
        memory.deviation[10] = memory.deviation[11] = 0.0
        seen.add(ours.step_state(k * SAMPLE, state)[0])
        moves, plan = np.array(list(memory.mpc.move)), np.array(list(memory.mpc.state))
        np.testing.assert_allclose(peer.moves.ravel(), moves, atol=1e-9)
        np.testing.assert_allclose(peer.state.ravel(), plan, atol=1e-8)
        peer.shift()
    assert len(seen) > 1
