"""Time of steps of model-predictive control by acados: the pinned prism and the two-stage tower.

python benchmarks/mpc_against_acados.py [--case prism] [--compare] [--only "blocks, in C"] [--reference FOLDER

Needs acados (https://docs.acados.org) and its Python package, with ACADOS_SOURCE_DIR set. Each row is one way
to state the problem of `design_mpc` in acados: blocks of equal deviations as phases without inputs
("blocks"), by bounds of inputs that are zero ("held"), or without blocks ("free"); derivatives of the
dynamics by CasADi alone ("by CasADi") or by C around CasADi's derivatives of the accelerations ("in C"). A
step is one real-time iteration in a closed loop with errors of the plant, timed by the CPU time of its
thread; setting references, bounds and the plan is not in it. Not solved: steps whose quadratic program ends
at the largest number of iterations or fails, which acados itself does not report as a failed step.
"""

import argparse
import contextlib
import io
import subprocess
import tempfile
import time
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from acados_template import AcadosMultiphaseOcp, AcadosOcpSolver
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tensegrity_codegen import ControllerCode, build_controller, design_mpc
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import find_bounds
from tensegrity_codegen.control.feedback.loop.cable_tensions import find_cables
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, bind_gust
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.symbolic.build import build_model
from tests.body_scenes import assemble_document
from tests.control.feedback import pinned_prism, tower_motion

Array = NDArray[np.float64]
TEMPLATE = Path(__file__).resolve().parent / "harness" / "acados_dynamics.c"
BLOCKS = (1, 1, 2, 4, 12)
SUBSTEPS = 1  # Runge-Kutta steps in a sample, as many as `design_mpc` chooses
SOFT_WEIGHT = 1e3  # over the largest weight
FLAGS = "-O3 -march=native"
HUGE = 1e10  # what acados takes as infinite
MOST_ITERATIONS = 40  # until a reference has converged
CONVERGED = 1e-12  # change of states and inputs


@dataclass(frozen=True)
class Problem:
    """A structure, its motion and weights; functions of (q, q', inputs) by CasADi.

    rate: accelerations and their derivatives; plant: accelerations, of stiffnesses and loads too; length: of
    the members with a least tension; slope, shift: longest rest length = slope length - shift.
    """

    name: str
    model: CompiledModel
    motion: Motion
    gains: Gains
    weights: tuple[Array, Array]
    errors: Disturbance
    t_end: float
    least: Array
    most: Array
    reach: Array
    rest: Array
    pull: Array
    slope: Array
    shift: Array
    rate: ca.Function
    plant: ca.Function
    length: ca.Function

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of states (q, q'), sums and inputs."""
        return len(self.gains.state_name), len(self.gains.integral_name), len(self.gains.actuators)


def make_problem(case: str) -> Problem:
    """Return the prism at 200 Hz with 5 N, or the tower at 100 Hz with 1 N, at least in its cables."""
    if case == "prism":
        document, model = pinned_prism.prism_document(), pinned_prism.build_prism("control")
        motion = pinned_prism.move_prism(model)
        gains, errors = pinned_prism.design_gains(model, motion), pinned_prism.draw_errors(model, 1)
        t_end, tension = 3.0, 5.0
    else:
        document = tomllib.loads(tower_motion.SCENE.read_text(encoding="utf-8"))
        del document["parameters"], document["inputs"], document["model"]["integrators"]
        document["actuators"] = [
            {"name": f"m_{k}", "members": [k], "rate": 0.05} for k in document["tendons"]
        ]
        model = tower_motion.build_tower()
        motion = tower_motion.move_tower(model)
        gains, errors = (
            tower_motion.design_tower_gains(model, motion),
            tower_motion.draw_tower_errors(model, 1),
        )
        t_end, tension = 7.0, 1.0
    system, request = assemble_document(document)
    symbolic = build_model(system, want_analyses(system, request, ("control",)))
    symbols = {name: argument.symbol for name, argument in symbolic.arguments.items()}
    at = [symbols.pop(name) for name in ("coordinate", "velocity", "input")]
    given = [np.reshape(symbolic.arguments[name].nominal, s.shape, order="F") for name, s in symbols.items()]
    loads = list(symbols.values())
    acceleration, length = symbolic.expression("acceleration"), symbolic.expression("member_length")
    nominal, length = ca.substitute([acceleration, length], loads, [ca.DM(value) for value in given])
    bounds = find_bounds(model, motion)
    cables = find_cables(model, bounds, np.full(len(model.manifest.member_name), tension), {})
    chosen = cables.limited
    spring, axial = cables.spring_constant[chosen], cables.axial_stiffness[chosen]
    slope = np.where(axial > 0.0, axial / (axial + tension), 1.0)
    shift = np.where(axial > 0.0, 0.0, tension / np.where(spring > 0.0, spring, 1.0))
    n, m = at[0].numel(), len(gains.actuators)
    derivatives = [ca.densify(ca.jacobian(nominal, symbol)) for symbol in at]
    return Problem(
        name=case,
        model=model,
        motion=motion,
        gains=gains,
        weights=(
            np.diag(np.concatenate([np.full(n, 100.0), np.full(n, 0.1), np.full(n, 10.0)])),
            1e6 * np.eye(m),
        ),
        errors=errors,
        t_end=t_end,
        least=bounds.least,
        most=bounds.most,
        reach=bounds.rate * gains.sample,
        rest=cables.base[chosen],
        pull=cables.incidence[chosen],
        slope=slope,
        shift=shift,
        rate=ca.Function("accelerations", at, ca.cse([ca.densify(nominal), *derivatives])),
        plant=ca.Function("plant", [*at, *loads], [acceleration]),
        length=ca.Function("length", at[:1], [length[chosen.tolist()]]),
    )


# The problem in acados.


def compile_accelerations(problem: Problem, folder: Path) -> str:
    """Compile the accelerations and their derivatives into a shared library in a folder; return its name."""
    name = f"{problem.name}_accelerations"
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": False})
    generator.add(problem.rate)
    text = generator.dump()
    source, library = folder / f"{name}.c", folder / f"lib{name}.so"
    if not library.exists() or source.read_text(encoding="utf-8") != text:
        source.write_text(text, encoding="utf-8")
        command = [
            "gcc",
            "-shared",
            "-fPIC",
            *FLAGS.split(),
            f"-Wl,-soname,{library}",
            str(source),
            "-o",
            str(library),
        ]
        subprocess.run(command, check=True)
    return name


def write_dynamics(problem: Problem, has_move: bool, name: str) -> str:
    """Write the dynamics of a phase in C into the current folder; return the name of the file."""
    n, k, m = problem.sizes
    rate = problem.rate
    defined = {
        "NQ": n // 2, "NZ": k, "NU": m, "SAMPLE": repr(problem.gains.sample), "SUBSTEPS": SUBSTEPS,
        "SZ_ARG": rate.sz_arg(), "SZ_RES": rate.sz_res(), "SZ_IW": rate.sz_iw(), "SZ_W": rate.sz_w(),
        "VALUE": f"{name}_value", "VALUE_AND_JACOBIAN": f"{name}_jacobian", "WITH_MOVE": int(has_move),
    }  # fmt: skip
    rows = ", ".join("{" + ", ".join(map(repr, row)) + "}" for row in problem.gains.integral_action.tolist())
    text = [
        *(f"#define {key} {value}" for key, value in defined.items()),
        f"static const double SUM_OUTPUT[NZ][2 * NQ] = {{{rows}}};",
        TEMPLATE.read_text(encoding="utf-8"),
    ]
    Path(f"{name}.c").write_text("\n".join(text), encoding="utf-8")
    return f"{name}.c"


def advance(problem: Problem, x: Any, u: Any) -> tuple[Any, Any]:
    """Return the state a sample later, and its derivatives by the state and the inputs, in MX."""
    n, width, step = x.numel() // 2, x.numel() + u.numel(), problem.gains.sample / SUBSTEPS
    by = ca.MX(ca.DM.eye(width)[: 2 * n, :])
    for _ in range(SUBSTEPS):
        total, total_by = 0, 0
        rate, rate_by = ca.MX(2 * n, 1), ca.MX(2 * n, width)
        for share, part in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            now, now_by = x + share * step * rate, by + share * step * rate_by
            acceleration, by_q, by_v, by_u = problem.rate(now[:n], now[n:], u)
            rate = ca.vertcat(now[n:], acceleration)
            turns = by_q @ now_by[:n, :] + by_v @ now_by[n:, :] + ca.horzcat(ca.MX(n, 2 * n), by_u)
            rate_by = ca.vertcat(now_by[n:, :], turns)
            total, total_by = total + part * rate, total_by + part * rate_by
        x, by = x + step / 6 * total, by + step / 6 * total_by
    return x, by


def set_model(model: Any, problem: Problem, has_move: bool, dynamics: str, name: str) -> None:
    """Set the dynamics of a phase: states (q, q', sums, deviation), inputs are changes of the deviation."""
    n, k, m = problem.sizes
    x, move = ca.MX.sym("x", n + k + m), ca.MX.sym("move", m if has_move else 0)
    p = ca.MX.sym("p", m + n + m)
    model.name, model.x, model.u, model.p = name, x, move, p
    deviation = x[n + k :] + (move if has_move else 0)
    if dynamics == "in C":
        model.dyn_ext_fun_type = "generic"
        model.dyn_generic_source = write_dynamics(problem, has_move, name)
        model.dyn_disc_fun, model.dyn_disc_fun_jac = f"{name}_value", f"{name}_jacobian"
        model.disc_dyn_expr = x  # acados asks for one
    else:
        output, one = ca.DM(problem.gains.integral_action), ca.DM.eye(m)
        after, by = advance(problem, x[:n], p[:m] + deviation)
        sums = x[n : n + k] + output @ (x[:n] - p[m : m + n])
        model.disc_dyn_expr = ca.vertcat(after, sums, deviation)
        whole = ca.vertcat(
            ca.horzcat(by[:, :n], ca.MX(n, k), by[:, n:]),
            ca.horzcat(output, ca.DM.eye(k), ca.DM(k, m)),
            ca.horzcat(ca.DM(m, n + k), one),
        )
        by_move = ca.vertcat(by[:, n:], ca.DM(k, m), one)
        model.disc_dyn_custom_jac_ux_expr = ca.horzcat(by_move, whole) if has_move else whole
    rest = problem.rest + ca.DM(problem.pull) @ (p[m + n :] + x[n + k :])
    excess = rest - problem.slope * problem.length(x[: n // 2]) + problem.shift
    model.con_h_expr = excess if has_move else []
    model.con_h_expr_e = excess


def set_cost(cost: Any, problem: Problem, has_move: bool) -> None:
    """Set the weights of a phase, and of excess over the longest rest lengths."""
    n, k, m = problem.sizes
    q, r = problem.weights
    size, soft = n + k + m, np.full(len(problem.slope), SOFT_WEIGHT * np.abs(r).max())
    by_move = np.vstack([np.zeros((n + k, m)), np.eye(m)])[:, : m if has_move else 0]
    cost.cost_type_0 = cost.cost_type = cost.cost_type_e = "LINEAR_LS"
    cost.W_0, cost.W, cost.W_e = r, block_diag(q, r), problem.gains.S[-1]
    cost.Vx_0, cost.Vx, cost.Vx_e = np.eye(size)[n + k :], np.eye(size), np.eye(size)[: n + k]
    cost.Vu_0, cost.Vu = by_move[n + k :], by_move
    cost.yref_0, cost.yref, cost.yref_e = np.zeros(m), np.zeros(size), np.zeros(n + k)
    nothing = np.zeros(len(soft))
    if has_move:
        cost.Zl, cost.Zu, cost.zl, cost.zu = soft, soft, nothing, nothing
    cost.Zl_e, cost.Zu_e, cost.zl_e, cost.zu_e = soft, soft, nothing, nothing


def set_constraints(constraints: Any, problem: Problem, has_move: bool) -> None:
    """Set which inputs, deviations and rest lengths are bounded in a phase; the bounds change in time."""
    n, k, m = problem.sizes
    wide, slack, high = np.full(m, HUGE), np.arange(len(problem.slope)), np.zeros(len(problem.slope))
    if has_move:
        constraints.idxbu, constraints.lbu, constraints.ubu = np.arange(m), -wide, wide
        constraints.idxbx, constraints.lbx, constraints.ubx = n + k + np.arange(m), -wide, wide
        constraints.lh, constraints.uh, constraints.idxsh = np.full(len(slack), -HUGE), high, slack
    constraints.idxbx_e, constraints.lbx_e, constraints.ubx_e = n + k + np.arange(m), -wide, wide
    constraints.lh_e, constraints.uh_e, constraints.idxsh_e = np.full(len(slack), -HUGE), high, slack


@dataclass(frozen=True)
class Form:
    """How the problem is stated: blocks, and whether samples without a move are phases of their own."""

    blocks: tuple[int, ...]
    has_phases: bool

    @property
    def ends(self) -> Array:
        """Numbers of samples to the ends of the blocks."""
        return np.cumsum(self.blocks)

    @property
    def starts(self) -> Array:
        """First samples of the blocks."""
        return self.ends - np.array(self.blocks)

    @property
    def phases(self) -> list[tuple[int, bool]]:
        """Numbers of samples of the phases, and whether inputs move in them."""
        if not self.has_phases:
            return [(sum(self.blocks), True)]
        found: list[tuple[int, bool]] = []
        for moves in [k in self.starts for k in range(sum(self.blocks))]:
            if found and found[-1][1] == moves:
                found[-1] = (found[-1][0] + 1, moves)
            else:
                found.append((1, moves))
        return found


FORMS = {
    "blocks": Form(BLOCKS, has_phases=True),
    "held": Form(BLOCKS, has_phases=False),
    "free": Form((1,) * sum(BLOCKS), has_phases=False),
}


class Peer:
    """A problem as acados solves it, with a plan that moves on from sample to sample."""

    def __init__(
        self, problem: Problem, form: str, dynamics: str, options: dict[str, Any], folder: Path
    ) -> None:
        self.problem, self.form, self.horizon = problem, FORMS[form], sum(FORMS[form].blocks)
        n, k, m = problem.sizes
        phases = self.form.phases
        ocp = AcadosMultiphaseOcp(N_list=[count for count, _ in phases])
        ocp.name = f"{problem.name}_{form}_{dynamics}".replace(" ", "_")
        with contextlib.chdir(folder):
            for i, (_, has_move) in enumerate(phases):
                set_model(ocp.model[i], problem, has_move, dynamics, f"{ocp.name}_{i}")
                set_cost(ocp.cost[i], problem, has_move)
                set_constraints(ocp.constraints[i], problem, has_move)
                ocp.parameter_values[i] = np.zeros(m + n + m)
            ocp.constraints[0].x0 = np.zeros(n + k + m)
            chosen = ocp.solver_options
            chosen.tf, chosen.cost_scaling = float(self.horizon), np.ones(self.horizon + 1)
            chosen.integrator_type, chosen.hessian_approx = "DISCRETE", "GAUSS_NEWTON"
            chosen.nlp_solver_type, chosen.print_level = "SQP_RTI", 0
            for name, value in options.items():
                setattr(chosen, name, value)
            ocp.code_gen_options.ext_fun_compile_flags = FLAGS
            if dynamics == "in C":
                ocp.code_gen_options.model_external_shared_lib_name = compile_accelerations(problem, folder)
                ocp.code_gen_options.model_external_shared_lib_dir = str(folder)
            ocp.code_gen_options.code_export_directory = str(folder / ocp.name)
            ocp.code_gen_options.json_file = f"{ocp.name}.json"
            with contextlib.redirect_stdout(io.StringIO()):
                self.solver = AcadosOcpSolver(ocp, verbose=False)
        self.bounded = [bool(k and k in self.form.ends) for k in range(self.horizon + 1)]
        self.forget()

    def forget(self) -> None:
        """Begin again from the motion."""
        self.state: Array | None = None
        self.move = np.zeros((len(self.form.blocks), self.problem.sizes[2]))

    def begin(self, time: float, x: Array, sums: Array, before: Array) -> None:
        """Set state, references, bounds and the plan for a step at a time; before: the command until then."""
        problem, solver, sample = self.problem, self.solver, self.problem.gains.sample
        k, m = problem.sizes[1:]
        points = [problem.motion.at(time + i * sample) for i in range(self.horizon + 1)]
        goal = np.array([np.concatenate([point.coordinate, point.velocity]) for point in points])
        planned = np.array([problem.motion.at(time + (i + 0.5) * sample).input for i in range(self.horizon)])
        self.planned = planned
        if self.state is None:
            self.state = goal.copy()
        self.state[0] = x
        deviation = np.repeat(self.move, self.form.blocks, axis=0)
        shown = np.vstack([before - planned[0], deviation])
        start = np.concatenate([x, sums, shown[0]])
        solver.constraints_set(0, "lbx", start)
        solver.constraints_set(0, "ubx", start)
        last = self.form.ends - 1
        for i in range(self.horizon + 1):
            at_end = planned[min(i, self.horizon - 1)]
            earlier = planned[max(i - 1, 0)]
            solver.set(i, "p", np.concatenate([at_end, goal[i], earlier]))
            solver.set(i, "x", np.concatenate([self.state[i], sums, shown[i]]))
            if i == 0:
                solver.cost_set(i, "yref", np.zeros(m))
            elif i < self.horizon:
                solver.cost_set(i, "yref", np.concatenate([goal[i], np.zeros(k + m)]))
            else:
                solver.cost_set(i, "yref", np.concatenate([goal[i], np.zeros(k)]))
            self._bound(i, shown, last)
            if i > 0 and self.bounded[i]:
                solver.constraints_set(i, "lbx", np.maximum(problem.least - earlier, -HUGE))
                solver.constraints_set(i, "ubx", np.minimum(problem.most - earlier, HUGE))
            elif 0 < i < self.horizon and not self.form.has_phases:
                solver.constraints_set(i, "uh", np.full(len(problem.slope), HUGE))

    def _bound(self, i: int, shown: Array, last: Array) -> None:
        """Set plan and bounds of the change of the deviation in a sample."""
        if i == self.horizon or (self.form.has_phases and i not in self.form.starts):
            return
        problem, solver, planned = self.problem, self.solver, self.planned
        solver.set(i, "u", shown[i + 1] - shown[i])
        if i not in self.form.starts:
            low = high = np.zeros(problem.sizes[2])
        else:
            b = int(np.searchsorted(self.form.starts, i))
            reach = problem.reach * self.form.blocks[b]
            turn = planned[last[b]] - planned[last[b - 1]] if b else np.zeros(len(reach))
            low, high = -reach - turn, reach - turn
            if b == 0:
                before = shown[0] + planned[0]
                low, high = np.maximum(low, problem.least - before), np.minimum(high, problem.most - before)
        solver.constraints_set(i, "lbu", low)
        solver.constraints_set(i, "ubu", high)

    def read(self) -> int:
        """Take the plan that was found; return the status of the quadratic program, 0 where it is solved."""
        n, k, _ = self.problem.sizes
        found = np.array([self.solver.get(i, "x") for i in range(self.horizon + 1)])
        self.state = found[:, :n].copy()
        self.move = found[self.form.starts + 1, n + k :]
        return int(self.solver.get_stats("qp_stat")[-1])

    def shift(self) -> None:
        """Move the plan on by a sample."""
        assert self.state is not None
        self.state[:-1] = self.state[1:]
        blocks = np.repeat(np.arange(len(self.form.blocks)), self.form.blocks)
        self.move = self.move[blocks[np.minimum(self.form.starts + 1, self.horizon - 1)]]

    @property
    def command(self) -> Array:
        """The first command of the plan."""
        found: Array = self.planned[0] + self.move[0]
        return found


# Closed loop, reference, table.

HPIPM = {"qp_solver": "PARTIAL_CONDENSING_HPIPM", "qp_tol": 1e-6, "qp_solver_iter_max": 1000}
FULL = {**HPIPM, "qp_solver": "FULL_CONDENSING_HPIPM", "qp_solver_cond_ric_alg": 0}
WARM = {"qp_solver_warm_start": 2, "nlp_solver_warm_start_first_qp": True}
SOLVERS: dict[str, dict[str, Any]] = {
    "HPIPM, 20 stages": HPIPM,
    "HPIPM, 20 stages, warm": {**HPIPM, **WARM},
    "HPIPM, a stage a block": {
        **HPIPM,
        "qp_solver_cond_N": len(BLOCKS),
        "qp_solver_cond_block_size": [*BLOCKS, 0],
        "qp_solver_cond_ric_alg": 0,
    },
    "HPIPM, condensed": FULL,
    "HPIPM, condensed, warm": {**FULL, **WARM},
    "DAQP, condensed": {**FULL, "qp_solver": "FULL_CONDENSING_DAQP", **WARM, "qp_solver_warm_start": 1},
}
EXACT = {**SOLVERS["DAQP, condensed"], "qp_tol": 1e-12}
COMPARED = {"HPIPM, condensed, warm": {**FULL, **WARM}, "DAQP, exact": EXACT}
ROWS = [
    *(("blocks", "in C", name) for name in SOLVERS if "20" not in name),
    *(("blocks", "by CasADi", "HPIPM, condensed"), ("held", "by CasADi", "HPIPM, 20 stages")),
    *(("free", dynamics, "HPIPM, 20 stages, warm") for dynamics in ("in C", "by CasADi")),
]
ROUNDS = 3
WARM_UP = 10  # steps that are not counted
PLANT_STEPS = 4  # Runge-Kutta steps of the plant in a sample
STATES = 200  # of a reference
SWING, FREQUENCY = 2e-3, 0.7  # of the states of a reference about the motion [rad or m, Hz]
OFFSET = 2e-4  # of the command before a state of a reference from the motion's [m]


def drive(peer: Peer) -> tuple[Array, int, float]:
    """Return CPU times [s] of steps in the closed loop with the errors, failed steps, last error [m, rad]."""
    problem, errors, sample = peer.problem, peer.problem.errors, peer.problem.gains.sample
    gust = bind_gust(problem.model, errors.gust, None)
    start = problem.motion.at(0.0)
    x = np.concatenate([start.coordinate + np.asarray(errors.coordinate_error), start.velocity])
    sums, before, times, failed = np.zeros(problem.sizes[1]), start.input, [], 0
    peer.forget()
    for i in range(round(problem.t_end / sample)):
        now = i * sample
        peer.begin(now, x, sums, before)
        since = time.thread_time_ns()
        peer.solver.solve()
        times.append(1e-9 * (time.thread_time_ns() - since))
        failed += peer.read() != 0
        point = problem.motion.at(now)
        sums = sums + problem.gains.integral_action @ (x - np.concatenate([point.coordinate, point.velocity]))
        before = peer.command
        x = simulate_plant(problem, x, before, None if gust is None else gust.at(now))
        peer.shift()
    left = x[: len(x) // 2] - problem.motion.at(problem.t_end).coordinate
    return np.array(times[WARM_UP:]), failed, float(np.abs(left).max())


def simulate_plant(problem: Problem, x: Array, command: Array, load: Array | None) -> Array:
    """Return the state of the plant a sample later."""
    n, step = len(x) // 2, problem.gains.sample / PLANT_STEPS
    loads = problem.model.nominal("node_load") if load is None else load

    def rate(state: Array) -> Array:
        found = problem.plant(state[:n], state[n:], command, problem.errors.axial_stiffness, loads.T)
        return np.concatenate([state[n:], np.array(found).ravel()])

    for _ in range(PLANT_STEPS):
        first = rate(x)
        second = rate(x + 0.5 * step * first)
        third = rate(x + 0.5 * step * second)
        x = x + step / 6 * (first + 2 * second + 2 * third + rate(x + step * third))
    return x


def list_states(problem: Problem) -> list[tuple[float, Array, Array, Array]]:
    """Return time, state, sums and command before of states about the motion.

    At time t = i sample coordinates are those of the motion + SWING sin(w t + phase), with their rates;
    commands before are the motion's half a sample earlier + OFFSET sin(w t + their phase); the sums go on
    from sample to sample.
    """
    sample = problem.gains.sample
    n, k, m = problem.sizes
    phase = np.random.default_rng(1).uniform(0.0, 2 * np.pi, n // 2 + m)
    turn = 2 * np.pi * FREQUENCY
    given, sums = [], np.zeros(k)
    for i in range(STATES):
        now = i * sample
        point = problem.motion.at(now)
        error = np.concatenate(
            [
                SWING * np.sin(turn * now + phase[: n // 2]),
                SWING * turn * np.cos(turn * now + phase[: n // 2]),
            ]
        )
        before = problem.motion.at(now - 0.5 * sample).input + OFFSET * np.sin(turn * now + phase[n // 2 :])
        given.append((now, np.concatenate([point.coordinate, point.velocity]) + error, sums, before))
        sums = sums + problem.gains.integral_action @ error
    return given


def make_reference(peer: Peer) -> dict[str, Array]:
    """Return states about the motion, and what acados plans from them.

    `fresh`: one iteration from the motion; `sequence`: one from the shifted plan of the state before;
    `converged`: as many as change anything.
    """
    given = list_states(peer.problem)
    found = {
        name: np.array(rows)
        for name, rows in zip(("time", "state", "sums", "before"), zip(*given, strict=True), strict=True)
    }
    for kind in ("fresh", "sequence", "converged"):
        rows = []
        peer.forget()
        for item in given:
            if kind != "sequence":
                peer.forget()
            peer.begin(*item)
            change, count = np.inf, 0
            while count < (MOST_ITERATIONS if kind == "converged" else 1) and change > CONVERGED:
                old = np.concatenate([peer.state.ravel(), peer.move.ravel()])
                peer.solver.solve()
                status, count = peer.read(), count + 1
                change = np.abs(np.concatenate([peer.state.ravel(), peer.move.ravel()]) - old).max()
            rows.append((peer.command, peer.state.copy(), peer.move.copy(), count, status, change))
            peer.shift()
        names = ("command", "states", "moves", "iterations", "status", "change")
        found |= {
            f"{kind}_{name}": np.array(row) for name, row in zip(names, zip(*rows, strict=True), strict=True)
        }
    return found


def compare(problem: Problem, solver: str, folder: Path) -> str:
    """Return a row: steps of a solver of acados and of `design_mpc` in turns, from the same states.

    Both go on from their own plan of the state before; ours is compiled with the same flags.
    """
    peer = Peer(problem, "blocks", "in C", COMPARED[solver], folder)
    tension = 5.0 if problem.name == "prism" else 1.0
    mpc = design_mpc(
        problem.model, problem.motion, *problem.weights, sample=problem.gains.sample, blocks=BLOCKS,
        integral_action=problem.gains.integral_action, least_tension=tension, soft_weight=SOFT_WEIGHT,
    )  # fmt: skip
    least = np.where(np.isin(np.arange(len(mpc.least_tension)), mpc.cables.limited), tension, -np.inf)
    mpc = replace(mpc, least_tension=least)  # the least tension itself, also below it on the motion
    code = ControllerCode(name="ahead", qp_iterations=1000)
    bundle = build_controller(problem.model, problem.motion, mpc, out=folder / "ours", code=code)
    sources = ("ahead_control.c", "ahead_control_model.c", "-lm")
    command = ["gcc", "-std=c99", *FLAGS.split(), "-fPIC", "-shared", "-o", bundle.description.library]
    subprocess.run([*command, *sources], cwd=bundle.folder, check=True)
    controller = bundle.load()
    controller.init()
    memory, (n, _, m) = controller._memory, problem.sizes
    spent: dict[str, list[float]] = {"acados": [], "ours": []}
    differences, unsolved = [], 0
    for now, x, sums, before in list_states(problem):
        peer.begin(now, x, sums, before)
        since = time.thread_time_ns()
        peer.solver.solve()
        spent["acados"].append(1e-3 * (time.thread_time_ns() - since))
        unsolved += peer.read() != 0
        for place, value in enumerate(sums.tolist()):
            memory.deviation[n + place] = value
        for place, value in enumerate(before.tolist()):
            memory.command[place] = memory.sent[place] = memory.sent[m + place] = value
        since = time.thread_time_ns()
        word, _ = controller.step_state(now, x)
        spent["ours"].append(1e-3 * (time.thread_time_ns() - since))
        unsolved += word == "not_solved"
        state = np.array(list(memory.mpc.state)).reshape(-1, n)
        differences.append(
            (np.abs(np.array(list(memory.command)) - peer.command).max(), np.abs(state - peer.state).max())
        )
        peer.shift()
    middle = {name: np.median(row[WARM_UP:]) for name, row in spent.items()}
    high = {name: np.percentile(row[WARM_UP:], 99) for name, row in spent.items()}
    away = np.array(differences).max(axis=0)
    cells = [
        f"{problem.name}, {solver}",
        *(f"{middle[name]:.0f} / {high[name]:.0f}" for name in ("acados", "ours")),
        f"{middle['ours'] / middle['acados']:.2f}",
        f"{away[0]:.1e} m, {away[1]:.1e}",
        str(unsolved),
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print one row for each way to state and solve the problem, or write references."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", choices=("prism", "tower"), action="append")
    parser.add_argument("--only", default="", help="rows whose form, dynamics and solver contain this")
    parser.add_argument("--compare", action="store_true", help="steps of acados and of design_mpc in turns")
    parser.add_argument(
        "--reference", type=Path, help="write plans of the blocks to FOLDER/CASE.npz, no table"
    )
    options = parser.parse_args()
    if options.compare:
        heads = ("acados, median / 99 % [us]", "ours", "ratio", "commands, plans differ by", "not solved")
        print(f"| case, solver | {' | '.join(heads)} |\n|---|---|---|---|---|---|")
        for case in options.case or ("prism", "tower"):
            for solver in COMPARED:
                with tempfile.TemporaryDirectory() as folder:
                    print(compare(make_problem(case), solver, Path(folder)), flush=True)
        return
    if options.reference is None:
        heads = ("median [us]", "99 % below [us]", "least [us]", "not solved", "last error [m, rad]")
        print(f"| case, form, dynamics, solver | {' | '.join(heads)} |")
        print("|---|---|---|---|---|---|")
    for case in options.case or ("prism", "tower"):
        problem = make_problem(case)
        with tempfile.TemporaryDirectory() as folder:
            if options.reference is not None:
                peer = Peer(problem, "blocks", "in C", EXACT, Path(folder))
                np.savez_compressed(options.reference / f"{case}.npz", **make_reference(peer))
                continue
            for number, row in enumerate(ROWS):
                title = f"{case}, {', '.join(row)}"
                if options.only not in title:
                    continue
                place = Path(folder) / str(number)
                place.mkdir()
                peer = Peer(problem, *row[:2], SOLVERS[row[2]], place)
                rounds = [drive(peer) for _ in range(ROUNDS)]
                best = min(rounds, key=lambda found: np.percentile(found[0], 99) / np.median(found[0]))
                times = 1e6 * best[0]
                shown = [
                    f"{value:.0f}" for value in (np.median(times), np.percentile(times, 99), times.min())
                ]
                print(f"| {title} | {' | '.join(shown)} | {best[1]} | {best[2]:.1e} |", flush=True)


if __name__ == "__main__":
    main()
