"""SUNDIALS' CVODE itself over our compiled accelerations, by the libraries that scikit-sundae brings.

Python sets the solver up and calls it once a sample; steps and accelerations are C.
"""

import ctypes
import importlib.util
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.studies.study import load_c
from tensegrity_codegen.studies.work_precision.library_contenders import ATOL_OF_RTOL
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Run, Unavailable
from tensegrity_codegen.studies.work_precision.peers.sundials import MAX_DENSE, TOLERANCES, build_rates

ADAMS, BDF, NORMAL = 1, 2, 1  # constants of cvode.h
MAX_STEPS = 10_000_000  # between two samples
SETTINGS = {
    "Adams, fixed point": (ADAMS, False),
    "Adams, Newton, dense LU": (ADAMS, True),
    "BDF, Newton, dense LU": (BDF, True),
}
POINTERS = ("SUNDenseMatrix", "SUNLinSol_Dense", "SUNNonlinSol_FixedPoint", "N_VMake_Serial", "CVodeCreate")
RATES = """\
#include <string.h>
typedef struct {
  double *(*data)(void *); /* N_VGetArrayPointer */
  int (*call)(const double **, double **, long long *, double *, int);
  const double **arg;
  double **res;
  long long *iw;
  double *w;
  long long n, coordinate, velocity; /* number of coordinates, places of both arguments */
} motion;

/* x' = (q', H^-1 f) */
int rates(double t, void *x, void *dx, void *user)
{
  const motion *m = user;
  const double *from = m->data(x);
  double *to = m->data(dx);
  (void)t;
  memcpy(to, from + m->n, (size_t)m->n * sizeof *to);
  m->arg[m->coordinate] = from;
  m->arg[m->velocity] = from + m->n;
  m->res[0] = to + m->n;
  return m->call(m->arg, m->res, m->iw, m->w, 0);
}
"""


def contenders(
    problem: MotionProblem, compiler: str | None = None
) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield CVODE with both multistep methods, fixed-point iteration and Newton's with dense matrices."""
    compiled = cache(partial(build_rates, problem, compiler))
    for title in SETTINGS:
        yield f"CVODE (C; {title})", partial(_make, problem, title, compiled)


@cache
def _load_cvode() -> ctypes.CDLL:
    """Return the library CVODE, whose symbols include those that it depends on; raises Unavailable."""
    package = importlib.util.find_spec("sksundae")
    folder = Path(package.origin).parents[1] / "scikit_sundae.libs" if package and package.origin else Path()
    paths = [path for library in ("core", "cvode") for path in folder.glob(f"libsundials_{library}[-.]*")]
    if len(paths) < 2:
        raise Unavailable("not installed: scikit-sundae, with shared libraries of SUNDIALS")
    library = [ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL) for path in paths][-1]
    for name in POINTERS:
        getattr(library, name).restype = ctypes.c_void_p
    return library


def _make(
    problem: MotionProblem, title: str, compiled: Callable[[], tuple[CompiledModel, Path]]
) -> Contender:
    structure, times = problem.structure, problem.sample_time
    (method, uses_newton), name = SETTINGS[title], f"CVODE (C; {title})"
    if structure.is_rigid.any():
        raise Unavailable("rigid bars: would need an index reduction of its own")
    if uses_newton and structure.n_members > MAX_DENSE:
        raise Unavailable(f"not attempted above {MAX_DENSE} members")
    cvode = _load_cvode()
    node, axis = structure.coordinate_node_axis.T
    start = np.concatenate([structure.node_position[node, axis], structure.node_velocity[node, axis]])
    motion = _set_motion(*compiled(), len(node))
    state, size = start.copy(), ctypes.c_int64(len(start))
    context, memory = ctypes.c_void_p(), ctypes.c_void_p()
    cvode.SUNContext_Create(0, ctypes.byref(context))
    cvode.SUNContext_ClearErrHandlers(context)
    vector = ctypes.c_void_p(cvode.N_VMake_Serial(size, state.ctypes.data_as(ctypes.c_void_p), context))
    memory.value = cvode.CVodeCreate(method, context)
    cvode.CVodeInit(memory, load_c("cvode_rates", RATES).rates, ctypes.c_double(0.0), vector)
    cvode.CVodeSStolerances(memory, ctypes.c_double(1e-3), ctypes.c_double(1e-3))
    cvode.CVodeSetMaxHnilWarns(memory, -1)  # of steps that are lost in the time: it would print them
    cvode.CVodeSetMaxNumSteps(memory, ctypes.c_long(MAX_STEPS))
    if uses_newton:
        matrix = ctypes.c_void_p(cvode.SUNDenseMatrix(size, size, context))
        cvode.CVodeSetLinearSolver(
            memory, ctypes.c_void_p(cvode.SUNLinSol_Dense(vector, matrix, context)), matrix
        )
    else:
        solver = ctypes.c_void_p(cvode.SUNNonlinSol_FixedPoint(vector, 0, context))
        cvode.CVodeSetNonlinearSolver(memory, solver)
    reached, moments = ctypes.c_double(), [ctypes.c_double(t) for t in times]

    def run(rtol: float) -> Callable[[], Run]:
        state[:] = start
        cvode.CVodeSetUserData(memory, ctypes.byref(motion))
        cvode.CVodeReInit(memory, moments[0], vector)
        cvode.CVodeSStolerances(memory, ctypes.c_double(rtol), ctypes.c_double(ATOL_OF_RTOL * rtol))
        states = [start]
        for moment in moments[1:]:
            status = cvode.CVode(memory, moment, vector, ctypes.byref(reached), NORMAL)
            if status < 0:
                no_positions = np.zeros((0, structure.n_nodes, 3))
                return partial(Run, no_positions, "failed", f"CVODE returned {status}", 0, 0)
            states.append(state.copy())
        return partial(look, states)

    def look(states: list[Any]) -> Run:
        counts = [ctypes.c_long(), ctypes.c_long()]
        cvode.CVodeGetNumSteps(memory, ctypes.byref(counts[0]))
        cvode.CVodeGetNumRhsEvals(memory, ctypes.byref(counts[1]))
        position = np.tile(structure.node_position, (len(times), 1, 1))
        position[:, node, axis] = np.array(states)[:, : len(node)]
        return Run(position, "ok", "", *(count.value for count in counts))

    return Contender(name, "peer", "node_position", "cvode", "tolerance", TOLERANCES, run)


class _Motion(ctypes.Structure):
    """The struct of the C text above."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("data", "call", "arg", "res", "iw", "w")),
        *((name, ctypes.c_longlong) for name in ("n", "coordinate", "velocity")),
    )


def _set_motion(model: CompiledModel, path: Path, n: int) -> _Motion:
    """Return the data of the rates, other arguments at their nominal values."""
    name, library = f"{model.manifest.name}_acceleration", ctypes.CDLL(str(path))
    sizes = [ctypes.c_longlong() for _ in range(4)]
    getattr(library, f"{name}_work")(*map(ctypes.byref, sizes))
    n_arg, n_res, n_iw, n_w = (size.value for size in sizes)
    names = list(model.function("acceleration").arguments)
    nominal = [model.nominal(name) for name in names]
    arg, res = (ctypes.c_void_p * (n_arg + 1))(), (ctypes.c_void_p * max(1, n_res))()
    arg[: len(names)] = [array.ctypes.data for array in nominal]
    iw, w = (ctypes.c_longlong * max(1, n_iw))(), (ctypes.c_double * max(1, n_w))()
    # Accelerations without damping have no velocity, which then goes to the place behind all arguments.
    argument_index = [names.index(name) if name in names else n_arg for name in ("coordinate", "velocity")]
    functions = (ctypes.CDLL(None).N_VGetArrayPointer, getattr(library, name))
    pointers = (ctypes.cast(pointer, ctypes.c_void_p) for pointer in (*functions, arg, res, iw, w))
    motion = _Motion(*pointers, n, *argument_index)
    motion.kept = (library, nominal, arg, res, iw, w)  # what it points to
    return motion
