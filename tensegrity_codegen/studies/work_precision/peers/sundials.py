"""SUNDIALS' CVODES and IDAS through CasADi, over the accelerations in node positions."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.studies.work_precision.library_contenders import ATOL_OF_RTOL
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Run, Unavailable
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.request import ModelRequest

TOLERANCES = tuple(10.0**-k for k in range(2, 11))
MAX_WORK = 20_000_000  # members times steps between two samples: some ten seconds
MAX_MEMBERS = 1_000
MAX_DENSE = 200  # members up to which dense matrices are tried

ADAMS = {"linear_multistep_method": "adams"}
FUNCTIONAL = {"nonlinear_solver_iteration": "functional"}
# Linear solver of Newton's iteration -> its name in CasADi.
LINEAR_SOLVERS = {"sparse QR": "qr", "dense LU": "lapacklu", "sparse LU": "csparse"}


@dataclass(frozen=True)
class Setting:
    """A solver of SUNDIALS with options of CasADi's integrator; name: unique in a report."""

    name: str
    solver: str
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def needs_jacobian(self) -> bool:
        """Whether steps are solved by Newton's iteration."""
        return self.options.get("nonlinear_solver_iteration") != "functional"


USUAL = (Setting("CVODES (CasADi)", "cvodes"), Setting("IDAS (CasADi)", "idas"))


def _list_settings() -> Iterator[Setting]:
    """Yield all settings, those first that are the fastest on most scenes."""
    yield Setting("CVODES (CasADi; Adams, functional iteration)", "cvodes", ADAMS | FUNCTIONAL)
    for title, linear in LINEAR_SOLVERS.items():
        options = {"linear_solver": linear}
        yield Setting(f"CVODES (CasADi; Adams, Newton, {title})", "cvodes", ADAMS | options)
        yield Setting(f"CVODES (CasADi; BDF, Newton, {title})", "cvodes", options)
        yield Setting(f"IDAS (CasADi; {title})", "idas", options)
    yield Setting("CVODES (CasADi; BDF, functional iteration)", "cvodes", FUNCTIONAL)


def usual_contenders(problem: MotionProblem) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield CVODES and IDAS as CasADi sets them, over expressions that its virtual machine evaluates."""
    for setting in USUAL:
        yield setting.name, partial(_make, problem, setting, partial(_write_symbolic, problem))


def contenders(
    problem: MotionProblem, compiler: str | None = None
) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield CVODES and IDAS with every multistep method, iteration and linear solver, over compiled code.

    Where a structure is too large for compiled derivatives, Newton's iteration evaluates expressions by
    CasADi's virtual machine.
    """
    compiled = cache(partial(_write_compiled, problem, compiler))

    @cache
    def write(needs_jacobian: bool) -> dict[str, Any]:
        equations, has_jacobian = compiled()
        return equations if has_jacobian or not needs_jacobian else _write_symbolic(problem)

    for setting in _list_settings():
        yield setting.name, partial(_make, problem, setting, partial(write, setting.needs_jacobian))


def _make(problem: MotionProblem, setting: Setting, write: Callable[[], dict[str, Any]]) -> Contender:
    structure = problem.structure
    if structure.is_rigid.any():
        raise Unavailable("rigid bars: would need an index reduction of its own")
    if structure.n_members > MAX_MEMBERS:
        raise Unavailable(f"not attempted above {MAX_MEMBERS} members")
    if setting.options.get("linear_solver") == "lapacklu" and structure.n_members > MAX_DENSE:
        raise Unavailable(f"not attempted above {MAX_DENSE} members")
    ode = write()
    node_axes = structure.coordinate_node_axis
    node, axis = node_axes.T
    start = np.concatenate([structure.node_position[node, axis], structure.node_velocity[node, axis]])
    solvers: dict[float, ca.Function] = {}

    def prepare(rtol: float) -> None:
        options = {
            "reltol": rtol,
            "abstol": ATOL_OF_RTOL * rtol,
            "max_num_steps": MAX_WORK // structure.n_members,
            "show_eval_warnings": False,
            "print_stats": False,
            **setting.options,
        }
        solvers[rtol] = ca.integrator("motion", setting.solver, ode, 0.0, problem.sample_time[1:], options)

    def run(rtol: float) -> Callable[[], Run]:
        try:
            states = np.array(solvers[rtol](x0=start)["xf"]).T
        except RuntimeError as error:
            problem_text = str(error).strip()[-200:]
            return lambda: Run(np.zeros((0, structure.n_nodes, 3)), "failed", problem_text, 0, 0)
        return lambda: look(states, solvers[rtol].stats())

    def look(states: Any, stats: dict[str, Any]) -> Run:
        result = np.tile(structure.node_position, (len(problem.sample_time), 1, 1))
        result[1:, node, axis] = states[:, : len(node_axes)]
        return Run(result, "ok", "", int(stats.get("nsteps", 0)), int(stats.get("nfevals", 0)))

    name, solver = setting.name, setting.solver
    return Contender(name, "peer", "node_position", solver, "tolerance", TOLERANCES, run, prepare)


def _write_symbolic(problem: MotionProblem) -> dict[str, Any]:
    """Return the equations as expressions, inputs at their values."""
    model = build_model(problem.structure, ModelRequest((), formulation="node_position"))
    symbols = {name: argument.symbol for name, argument in model.arguments.items()}
    state = [symbols.pop("coordinate"), symbols.pop("velocity")]
    values = [model.arguments[name].nominal for name in symbols]
    rate = ca.substitute([model.expression("acceleration")], list(symbols.values()), values)
    return {"x": ca.vertcat(*state), "ode": ca.vertcat(state[1], *rate)}


def build_rates(problem: MotionProblem, compiler: str | None) -> tuple[CompiledModel, Path]:
    """Return the model of the accelerations with CasADi's interface, for this machine, and its file."""
    request = ModelRequest(
        ("acceleration",), formulation="node_position", emitter="auto", interfaces=("casadi",)
    )
    try:
        built = build_library(problem.structure, request, flags="native", compiler=compiler, calls=MANY_CALLS)
    except TensegrityError as error:
        raise Unavailable(error.problem) from error
    return built.load(), built.path


def _write_compiled(problem: MotionProblem, compiler: str | None) -> tuple[dict[str, Any], bool]:
    """Return the equations, accelerations compiled for this machine, and whether their Jacobian is too."""
    model, path = build_rates(problem, compiler)
    state = ca.MX.sym("x", 2 * len(model.manifest.coordinate_name))
    position, velocity = ca.vertsplit(state, state.numel() // 2)
    given = {"coordinate": position, "velocity": velocity}
    options = {"enable_fd": True}  # CasADi asks for a Jacobian that functional iteration never evaluates
    acceleration = ca.external(f"{model.manifest.name}_acceleration", str(path), options)
    names = model.function("acceleration").arguments
    values = [given[name] if name in given else model.nominal(name) for name in names]
    has_jacobian = any(
        source_part.name == "casadi_derivatives" and source_part.is_included
        for source_part in model.manifest.parts
    )
    return {"x": state, "ode": ca.vertcat(velocity, acceleration(*values))}, has_jacobian
