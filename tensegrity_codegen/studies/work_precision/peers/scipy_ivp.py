"""SciPy's solve_ivp over the accelerations of the compiled model, called from Python."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tensegrity_codegen.errors import NonFiniteError
from tensegrity_codegen.runtime.flow import build_derivative
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory
from tensegrity_codegen.studies.work_precision.contender import Contender, Run
from tensegrity_codegen.studies.work_precision.own import (
    ATOL_OF_RTOL,
    compile_problem,
    initial_state,
    place_samples,
)
from tensegrity_codegen.studies.work_precision.problem import MotionProblem

__all__ = ["contenders"]

METHODS: tuple[Any, ...] = ("DOP853", "LSODA", "Radau")
TOLERANCES = tuple(10.0**-k for k in range(2, 12))


def contenders(problem: MotionProblem) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield SciPy's methods over node positions, or over rigid bars where there are some."""
    title = "rigid_bar" if problem.structure.is_rigid.any() else "node_position"
    for method in METHODS:
        yield f"SciPy {method}", partial(_make, problem, title, method)


def _make(problem: MotionProblem, title: str, method: Any) -> Contender:
    model = compile_problem(problem, title, "rk54", "native", None)
    derivative, start, times = build_derivative(model, {}), initial_state(model), problem.sample_time
    nothing = np.zeros((0, problem.structure.n_nodes, 3))

    def run(setting: float) -> Callable[[], Run]:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what they say is in the status
                found = solve_ivp(
                    derivative, (0.0, times[-1]), start, method, t_eval=times, rtol=setting,
                    atol=ATOL_OF_RTOL * setting,
                )  # fmt: skip
        except NonFiniteError as error:
            return partial(Run, nothing, "unstable", error.problem, 0, 0)
        return lambda: look(found)

    def look(found: Any) -> Run:
        states = found.y.T if np.size(found.y) else np.zeros((0, len(start)))
        raw = RawTrajectory(found.t, states, "ok", "", method, 0, 0)
        status = "ok" if found.status == 0 else "failed"
        place = place_samples(model, raw) if len(states) else nothing
        return Run(place, status, str(found.message), len(found.t), int(found.nfev))

    return Contender(f"SciPy {method}", "peer", title, method, "tolerance", TOLERANCES, run)
