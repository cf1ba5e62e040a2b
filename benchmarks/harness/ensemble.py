"""Many states of one structure in one go: the rate of 10,000 prisms on one core, from Python and from C."""

import time
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from peers import casadi_c, jax_arrays, numba_loops
from peers.casadi_expressions import unrolled
from peers.numpy_batch import make_numpy

from harness.ours import Build, Ours, list_emitters, make_request
from harness.problem import Problem, make_problem
from harness.session import Kept, Session
from harness.tools import Candidate, CompileFailed, Tools, Unavailable, Way, repeat_python
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.system.errors import TensegrityError

COUNT = 10_000
MANY = " x "  # in the name of a structure of which many states are evaluated
STRUCTURE = "prism"
QUANTITIES = ("node_force", "elastic_energy", "tangent_stiffness")
LOOP = "Python loop over a CasADi function"
MAP_VM, MAP_C = "CasADi map, VM", "CasADi map, C (gcc -O3)"
NUMBA, JAX = "numba, loop over states", "JAX, jit of vmap"
PEERS = (LOOP, MAP_VM, MAP_C, NUMBA, JAX)  # compared by default
FloatArray = NDArray[np.float64]


def run_ensemble(session: Session, tools: Tools, ours: Ours, count: int, kept: Kept) -> None:
    """Time `count` states of the prism; rows are named "prism x <count>" and hold ns a state."""
    problem = make_problem(STRUCTURE)
    for name, quantity in list_ensembles(count):
        if kept.take(session, name, quantity):
            continue
        ways = list_ensemble_ways(problem, quantity, tools, ours, count)
        session.compare(name, problem.n_members, quantity, ways, (LOOP,))
        kept.keep(session, name, quantity)


def list_ensembles(count: int) -> list[tuple[str, str]]:
    """Return (name, quantity) of the comparisons of `count` states."""
    return [(f"{STRUCTURE}{MANY}{count}", quantity) for quantity in QUANTITIES]


def list_ensemble_ways(
    problem: Problem, quantity: str, tools: Tools, ours: Ours, count: int
) -> list[tuple[str, Way]]:
    """Return (side, (title, maker)) of all candidates."""
    states = problem.coordinates(count)
    native = [Build(compiler, "native") for compiler in tools.compilers]
    own: list[Way] = [
        (f"C, {emitter} ({build.title})", partial(_in_c, ours, problem, quantity, emitter, build, count))
        for emitter in list_emitters()
        for build in native
    ]
    own += [
        (
            f"Python, batch axis, {emitter} ({build.title})",
            partial(_leading_axis, problem, quantity, states, emitter, build),
        )
        for emitter in list_emitters()
        for build in native
    ]
    own.append(("Python, one state a call", partial(_call_by_call, problem, quantity, states)))
    others: list[Way] = [
        (LOOP, partial(_casadi_loop, problem, quantity, states)),
        (MAP_VM, partial(_casadi_map, problem, quantity, states)),
        (MAP_C, partial(_casadi_map_c, problem, quantity, states, tools)),
        ("NumPy, all states at once", partial(make_numpy, problem, quantity, states)),
        (NUMBA, partial(_numba, problem, quantity, states)),
        (JAX, partial(_jax, problem, quantity, states)),
    ]
    return [*(("ours", way) for way in own), *(("peer", way) for way in others)]


def _in_c(ours: Ours, problem: Problem, quantity: str, emitter: str, build: Build, count: int) -> Candidate:
    candidate = ours.make(problem, quantity, emitter, build, count)
    candidate.name = f"C, {emitter} ({build.title})"
    return candidate


def _call_by_call(problem: Problem, quantity: str, states: FloatArray) -> Candidate:
    """Our library through its Python interface, one call a state."""
    library = build_library(problem.structure, problem.request(quantity), flags="native")
    function = library.load().function(quantity)
    if function.arguments != ("coordinate",):
        raise Unavailable(f"depends on {', '.join(function.arguments)}")
    first = function.values((states[0],))
    result = np.zeros((len(states), *first.shape))
    pairs = list(zip(states, result, strict=True))

    def call() -> None:
        for state, row in pairs:
            function.values((state,), row)

    name = "Python, one state a call"
    return Candidate(name, repeat_python(call), lambda: result[0].reshape(-1).copy(), per_call=len(states))


def _leading_axis(
    problem: Problem, quantity: str, states: FloatArray, emitter: str, build: Build
) -> Candidate:
    """Our library through its Python interface, all states in one call."""
    request = make_request(problem, quantity, emitter, batch=True)
    compiler = build.compiler.name
    try:
        library = build_library(problem.structure, request, compiler=compiler, flags=build.flags)
        first = np.asarray(library.load().compute_batch(quantity, coordinate=states))[0].reshape(-1)
    except TensegrityError as error:
        raise Unavailable(f"refused: {str(error).splitlines()[0]}") from None
    batch = library.load().compute_batch
    run = repeat_python(lambda: batch(quantity, coordinate=states))
    return Candidate("Python, batch axis", run, first.copy, per_call=len(states))


def _casadi_loop(problem: Problem, quantity: str, states: FloatArray) -> Candidate:
    function = unrolled(problem, quantity)

    def call() -> None:
        for state in states:
            function(state)

    value = partial(_nonzeros, function, states[0])
    return Candidate(LOOP, repeat_python(call), value, per_call=len(states))


def _casadi_map(problem: Problem, quantity: str, states: FloatArray) -> Candidate:
    function = unrolled(problem, quantity)
    size = function.nnz_out(0)
    mapped, result = function.map(len(states)), np.zeros(len(states) * size)
    buffer, trigger = mapped.buffer()
    buffer.set_arg(0, memoryview(states.reshape(-1)))
    buffer.set_res(0, memoryview(result))
    kept = (mapped, buffer, states, result)
    return Candidate(MAP_VM, repeat_python(trigger), result[:size].copy, per_call=len(states), kept=kept)


def _casadi_map_c(problem: Problem, quantity: str, states: FloatArray, tools: Tools) -> Candidate:
    function = unrolled(problem, quantity)
    size, compiler = function.nnz_out(0), tools.compilers[0]
    whole = function.map(len(states))
    generator = ca.CodeGenerator("peer.c")
    generator.add(whole)
    command = (*compiler.command, *casadi_c.FLAGS, "peer.c")
    try:
        built = tools.compilation.build({"peer.c": generator.dump()}, command, version=compiler.version)
    except CompileFailed as error:
        raise Unavailable(str(error)) from None
    result = np.zeros(len(states) * size)
    run = tools.runner.casadi(built, whole.name(), states, result)
    return Candidate(MAP_C, run, result[:size].copy, called="C", per_call=len(states), built=built)


def _numba(problem: Problem, quantity: str, states: FloatArray) -> Candidate:
    loops = numba_loops.Loops(problem)
    one, result = loops.function(quantity), np.zeros((len(states), loops.size(quantity)))

    @loops.compile
    def every(coordinates: FloatArray, out: FloatArray) -> None:
        for k in range(len(coordinates)):
            one(coordinates[k], out[k])

    run = repeat_python(lambda: every(states, result))
    return Candidate(NUMBA, run, lambda: result[0].copy(), per_call=len(states))


def _jax(problem: Problem, quantity: str, states: FloatArray) -> Candidate:
    jax, started = jax_arrays.import_jax(), time.perf_counter()
    function = jax.jit(jax.vmap(jax_arrays.functions(jax, problem, quantity)))
    at = jax.device_put(states)
    function(at).block_until_ready()
    made = time.perf_counter() - started
    run = repeat_python(lambda: function(at).block_until_ready())
    value = lambda: np.asarray(function(at)[0]).reshape(-1)  # noqa: E731
    return Candidate(JAX, run, value, per_call=len(states), made=made)


def _nonzeros(function: ca.Function, state: FloatArray) -> FloatArray:
    return np.array(function(state).nonzeros())
