"""CasADi's own C by -O3 -march=native: the unrolled SX expression, our expression, or the MX map.

Without -fno-semantic-interposition gcc does not inline CasADi's own small functions in a shared library: they
are external symbols, which another library may replace.
"""

import time
from functools import partial

import casadi as ca
import numpy as np
from harness.problem import Problem
from harness.tools import Candidate, CompileFailed, Tools, Unavailable, Way

from peers.casadi_expressions import mapped, own_expression, unrolled
from tensegrity_codegen.codegen.compilation.flags import Compiler

FLAGS = ("-O3", "-march=native", "-fno-semantic-interposition", "-fPIC", "-shared")
UNROLLED, SAME, MAP = "CasADi C, unrolled", "CasADi C, our expression", "CasADi C, MX map"

# Members beyond which unrolled C is not attempted; the force of 903 takes most of a minute to compile.
MOST_MEMBERS = {"node_force": 1000}
MOST_OTHERWISE = 100
MOST_COPIES = 100  # of our own expression


def ways(problem: Problem, quantity: str, tools: Tools) -> list[Way]:
    """Return title and maker of the candidates for that quantity, by each compiler."""
    found: list[Way] = []
    for compiler in tools.compilers:
        for title in (UNROLLED, SAME, MAP):
            name = f"{title} ({compiler.name})"
            found.append((name, partial(_make, title, problem, quantity, tools, compiler)))
    return found


def _make(title: str, problem: Problem, quantity: str, tools: Tools, compiler: Compiler) -> Candidate:
    most = MOST_MEMBERS.get(quantity, MOST_OTHERWISE)
    if title == UNROLLED and problem.n_members > most:
        raise Unavailable(f"not attempted above {most} members, to keep the run short")
    if title == SAME and problem.n_members > MOST_COPIES:
        raise Unavailable(f"left to structures of at most {MOST_COPIES} members")
    started = time.perf_counter()
    function = {UNROLLED: unrolled, SAME: own_expression, MAP: mapped}[title](problem, quantity)
    generator = ca.CodeGenerator("peer.c")
    generator.add(function)
    text, written = generator.dump(), time.perf_counter() - started
    command = (*compiler.command, *FLAGS, "peer.c")
    try:
        built = tools.compilation.build({"peer.c": text}, command, version=compiler.version)
    except CompileFailed as error:
        raise Unavailable(str(error)) from None
    result = np.zeros(function.nnz_out(0))
    run = tools.runner.casadi(built, function.name(), problem.coordinate, result)
    name = f"{title} ({compiler.name})"
    return Candidate(name, run, result.copy, called="C", built=built, made=written + built.seconds)
