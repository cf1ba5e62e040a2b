"""CasADi's virtual machine: no C, the expression is interpreted; called through its buffers from Python."""

import time

import casadi as ca
import numpy as np
from harness.problem import Problem
from harness.tools import Candidate, Tools, Unavailable, Way, repeat_python

from peers.casadi_expressions import mapped, unrolled

UNROLLED, MAP = "CasADi VM", "CasADi VM, MX map"
MOST_MEMBERS = 10_000  # an SX of more takes minutes to differentiate


def ways(problem: Problem, quantity: str, tools: Tools) -> list[Way]:
    """Return title and maker of the candidates for that quantity."""
    return [(title, lambda title=title: _make(title, problem, quantity)) for title in (UNROLLED, MAP)]


def _make(title: str, problem: Problem, quantity: str) -> Candidate:
    if title == UNROLLED and problem.n_members > MOST_MEMBERS:
        raise Unavailable(f"not attempted above {MOST_MEMBERS} members")
    started = time.perf_counter()
    function: ca.Function = {UNROLLED: unrolled, MAP: mapped}[title](problem, quantity)
    made = time.perf_counter() - started
    result, at = np.zeros(function.nnz_out(0)), problem.coordinate.copy()
    buffer, trigger = function.buffer()
    buffer.set_arg(0, memoryview(at))
    buffer.set_res(0, memoryview(result))
    kept = (function, buffer, at, result)
    return Candidate(title, repeat_python(trigger), result.copy, made=made, kept=kept)
