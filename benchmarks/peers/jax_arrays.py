"""JAX: whole arrays in double precision, jit-compiled by XLA for one core; called from Python."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from harness.problem import Problem
from harness.tools import Candidate, Tools, Unavailable, Way, repeat_python

MOST_MEMBERS = 10_000


def import_jax() -> Any:
    """Return JAX set to double precision on the CPU; raises Unavailable without it."""
    try:
        import jax
    except ImportError:
        raise Unavailable("not installed: jax") from None
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_platforms", "cpu")
    return jax


def ways(problem: Problem, quantity: str, tools: Tools) -> list[Way]:
    """Return title and maker of the candidate for that quantity."""
    return [("JAX, jit", lambda: _make(problem, quantity))]


def _make(problem: Problem, quantity: str) -> Candidate:
    jax, started = import_jax(), time.perf_counter()
    if quantity == "tangent_stiffness" and problem.n_members > MOST_MEMBERS:
        raise Unavailable(f"not attempted above {MOST_MEMBERS:,} members: XLA folds the tables for minutes")
    function = jax.jit(functions(jax, problem, quantity))
    at = jax.device_put(problem.coordinate)
    function(at).block_until_ready()
    made = time.perf_counter() - started
    run = repeat_python(lambda: function(at).block_until_ready())
    return Candidate("JAX, jit", run, lambda: np.asarray(function(at)).reshape(-1), made=made)


def functions(jax: Any, problem: Problem, quantity: str) -> Callable[[Any], Any]:
    """Return f(coordinate) of that quantity, not compiled; raises Unavailable."""
    np_, (i, j), mu, rho = jax.numpy, (problem.first, problem.second), problem.mu, problem.rest_length
    fixed, free, slackens = problem.fixed_position, problem.free, np.array(problem.tension_only)

    of_nodes = _group(np.concatenate([i, j]), problem.n_nodes)
    pattern = problem.stiffness_pattern
    signed = pattern.slot + np.where(pattern.sign > 0, 0, 9 * problem.n_members)
    of_nonzeros = _group(pattern.place, pattern.n_nonzeros, signed)

    def members(q: Any) -> tuple[Any, Any, Any]:
        nodes = (q if problem.is_all_free else np_.asarray(fixed).at[free].set(q)).reshape(-1, 3)
        vector = nodes[i] - nodes[j]
        length = np_.sqrt((vector * vector).sum(axis=1))
        return vector, length, np_.where(slackens & (length <= rho), 0.0, mu)

    def force(q: Any) -> Any:
        vector, length, taut = members(q)
        pull = (taut * (1 - rho / length))[:, None] * vector
        return problem.external + _padded(np_, np_.concatenate([-pull, pull]), of_nodes).sum(axis=1)

    def energy(q: Any) -> Any:
        _, length, taut = members(q)
        return 0.5 * (taut * (length - rho) ** 2).sum()

    def stiffness(q: Any) -> Any:
        vector, length, taut = members(q)
        along = taut * rho / length
        blocks = (along / length**2)[:, None, None] * vector[:, :, None] * vector[:, None, :]
        blocks = blocks + (taut - along)[:, None, None] * np.eye(3)
        flat = blocks.reshape(-1)
        return _padded(np_, np_.concatenate([flat, -flat]), of_nonzeros).sum(axis=1)

    known = {"node_force": force, "elastic_energy": energy, "tangent_stiffness": stiffness}
    if quantity not in known:
        raise Unavailable("left to force, energy and stiffness")
    return known[quantity]


def _group(target: Any, count: int, source: Any = None) -> Any:
    """Return which terms each target adds up, (count, most terms of one), padded with one past the last.

    XLA adds by index (`.at[].add`) far more slowly on a CPU than it sums a gathered table.
    """
    source = np.arange(len(target)) if source is None else source
    order = np.argsort(target, kind="stable")
    sizes = np.bincount(target, minlength=count)
    column = np.arange(len(target)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    table = np.full((count, sizes.max()), np.iinfo(np.int64).max)
    table[target[order], column] = source[order]
    return table


def _padded(np_: Any, terms: Any, table: Any) -> Any:
    """Return terms[table], zero for the padding."""
    return np_.take(terms, table, axis=0, mode="fill", fill_value=0.0)
