"""SciPy's integrators over the accelerations of the compiled model, called from Python."""

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import ode, odeint, solve_ivp

from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.studies.work_precision.library_contenders import (
    ATOL_OF_RTOL,
    CompiledMotion,
    compile_problem,
    initial_state,
    place_samples,
)
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Run
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.formulations import choose_formulation

Derivative = Callable[[float, FloatArray], FloatArray]
# Derivative, initial state, times, rtol -> times and states that are reached, message or "", evaluations.
Solver = Callable[[Derivative, FloatArray, FloatArray, float], tuple[FloatArray, FloatArray, str, int]]

TOLERANCES = tuple(10.0**-k for k in range(2, 12))
MAX_STEPS = 1_000_000  # between two samples


def contenders(
    problem: MotionProblem, compiled: Callable[[], CompiledMotion] | None = None, *, usual: bool = False
) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield SciPy's methods over node positions, or over rigid bars where there are some.

    compiled: makes the motion to run; compiled for the problem if not given. usual: those of solve_ivp alone,
    without those whose steps are taken in compiled code.
    """
    for name, solver in SOLVERS.items():
        if solver.func is _solve_ivp or not usual:
            yield name, partial(_make, problem, name, solver, compiled or partial(_compile, problem))


def _compile(problem: MotionProblem) -> CompiledMotion:
    model = compile_problem(problem, _title(problem), "rk54", "native", None)
    return CompiledMotion(model, {}, initial_state(model))


def _title(problem: MotionProblem) -> str:
    return choose_formulation(rigid_bars=bool(problem.structure.is_rigid.any())).name


def _make(
    problem: MotionProblem, name: str, solve: Solver, compiled: Callable[[], CompiledMotion]
) -> Contender:
    motion = compiled()
    model, start, times = motion.model, motion.state, problem.sample_time
    derivative = _build_derivative(motion)
    no_positions = np.zeros((0, problem.structure.n_nodes, 3))

    def run(setting: float) -> Callable[[], Run]:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what they say is in the status
                solution = solve(derivative, start, times, setting)
        except NonFiniteError as error:
            return partial(Run, no_positions, "unstable", error.problem, 0, 0)
        return lambda: look(*solution)

    def look(reached: FloatArray, states: FloatArray, problem_text: str, count: int) -> Run:
        raw = RawTrajectory(reached, states, "ok", "", name, 0, 0)
        position = place_samples(model, raw, motion.arguments) if len(states) else no_positions
        return Run(position, "failed" if problem_text else "ok", problem_text, len(reached), count)

    return Contender(name, "peer", _title(problem), name.split()[1], "tolerance", TOLERANCES, run)


def _build_derivative(motion: CompiledMotion) -> Derivative:
    """Return (t [s], x) -> x' = (q', H^-1 f) by as little Python as possible."""
    function = motion.model.function("acceleration")
    n = len(motion.model.manifest.coordinate_name)
    arrays = [motion.arguments.get(name, motion.model.nominal(name)) for name in function.arguments]
    changing = [(k, name) for k, name in enumerate(function.arguments) if name in ("coordinate", "velocity")]
    slices = [(k, slice(0, n) if name == "coordinate" else slice(n, 2 * n)) for k, name in changing]

    def derivative(_: float, x: FloatArray) -> FloatArray:
        for k, state_slice in slices:
            arrays[k] = x[state_slice]
        return np.concatenate([x[n:], function.values(arrays, None)])

    return derivative


def _solve_ivp(
    method: Any, derivative: Derivative, start: FloatArray, times: FloatArray, rtol: float
) -> tuple[FloatArray, FloatArray, str, int]:
    solution = solve_ivp(
        derivative, (0.0, times[-1]), start, method, t_eval=times, rtol=rtol, atol=ATOL_OF_RTOL * rtol
    )
    states = solution.y.T if np.size(solution.y) else np.zeros((0, len(start)))
    return solution.t, states, "" if solution.status == 0 else str(solution.message), int(solution.nfev)


def _ode(
    options: dict[str, Any], derivative: Derivative, start: FloatArray, times: FloatArray, rtol: float
) -> tuple[FloatArray, FloatArray, str, int]:
    count, states = 0, [start]

    def counted(t: float, x: FloatArray) -> FloatArray:
        nonlocal count
        count += 1
        return derivative(t, x)

    solver = ode(counted).set_integrator(**options, rtol=rtol, atol=ATOL_OF_RTOL * rtol, nsteps=MAX_STEPS)
    solver.set_initial_value(start, 0.0)
    for time in times[1:]:
        try:
            state = solver.integrate(time)
        except ValueError:  # what becomes of an error of the derivative
            raise NonFiniteError("the accelerations are not finite", where="acceleration") from None
        if not solver.successful():
            return times[: len(states)], np.array(states), "did not reach the next sample", count
        states.append(state)
    return times, np.array(states), "", count


def _odeint(
    derivative: Derivative, start: FloatArray, times: FloatArray, rtol: float
) -> tuple[FloatArray, FloatArray, str, int]:
    atol = ATOL_OF_RTOL * rtol
    result: Any = odeint(
        derivative, start, times, full_output=True, tfirst=True, rtol=rtol, atol=atol, mxstep=MAX_STEPS
    )
    states, told = result
    is_whole = told["message"] == "Integration successful."
    return times, states, "" if is_whole else told["message"], int(told["nfe"][-1])


# Those first whose steps are taken in compiled code.
SOLVERS: dict[str, partial[Any]] = {
    "SciPy VODE (Adams)": partial(_ode, {"name": "vode", "method": "adams"}),
    "SciPy VODE (BDF)": partial(_ode, {"name": "vode", "method": "bdf"}),
    "SciPy DOP853 (ode)": partial(_ode, {"name": "dop853"}),
    "SciPy LSODA (odeint)": partial(_odeint),
    "SciPy DOP853": partial(_solve_ivp, "DOP853"),
    "SciPy LSODA": partial(_solve_ivp, "LSODA"),
    "SciPy Radau": partial(_solve_ivp, "Radau"),
}
