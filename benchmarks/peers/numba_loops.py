"""numba: one loop over the members, compiled with fast math; called from Python."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from harness.problem import Problem
from harness.tools import Candidate, Tools, Unavailable, Way, repeat_python
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def ways(problem: Problem, quantity: str, tools: Tools) -> list[Way]:
    """Return title and maker of the candidate for that quantity."""
    return [("numba", lambda: _make(problem, quantity))]


def _make(problem: Problem, quantity: str) -> Candidate:
    loops = Loops(problem)
    call, size = loops.function(quantity), loops.size(quantity)
    result, at = np.zeros(size), problem.coordinate
    started = time.perf_counter()
    call(at, result)
    made = time.perf_counter() - started
    return Candidate("numba", repeat_python(lambda: call(at, result)), result.copy, made=made)


class Loops:
    """The loops of one problem, compiled when first called. Raises Unavailable without numba."""

    def __init__(self, problem: Problem) -> None:
        try:
            import numba
        except ImportError:
            raise Unavailable("not installed: numba") from None
        self.problem = problem
        self.compile: Any = numba.njit(fastmath=True, error_model="numpy", boundscheck=False)

    def size(self, quantity: str) -> int:
        """Return how many values the quantity has."""
        nonzeros = self.problem.stiffness_pattern.n_nonzeros if quantity == "tangent_stiffness" else 0
        return {"node_force": 3 * self.problem.n_nodes, "elastic_energy": 1}.get(quantity, nonzeros)

    def function(self, quantity: str) -> Callable[[FloatArray, FloatArray], None]:
        """Return f(coordinate, result) of that quantity; raises Unavailable."""
        makers = {
            "node_force": self._force,
            "elastic_energy": self._energy,
            "tangent_stiffness": self._stiffness,
        }
        if quantity not in makers:
            raise Unavailable("left to force, energy and stiffness")
        return makers[quantity]()

    def _data(self) -> tuple[Any, ...]:
        p = self.problem
        return p.first, p.second, p.mu, p.rest_length, np.array(p.tension_only)

    def _place(self) -> Callable[[FloatArray], FloatArray]:
        """Return the function that puts coordinates among held nodes, (3 n_nodes,)."""
        fixed, free = self.problem.fixed_position, self.problem.free
        if self.problem.is_all_free:
            return self.compile(lambda q: q)  # type: ignore[no-any-return]

        @self.compile
        def place(q: FloatArray) -> FloatArray:
            position = fixed.copy()
            for k in range(free.size):
                position[free[k]] = q[k]
            return position

        return place  # type: ignore[no-any-return]

    def _force(self) -> Callable[[FloatArray, FloatArray], None]:
        first, second, mu, rho, slackens = self._data()
        external, place = self.problem.external.reshape(-1).copy(), self._place()

        @self.compile
        def force(q: FloatArray, result: FloatArray) -> None:
            r = place(q)
            for k in range(external.size):
                result[k] = external[k]
            for e in range(first.size):
                i, j = 3 * first[e], 3 * second[e]
                x, y, z = r[i] - r[j], r[i + 1] - r[j + 1], r[i + 2] - r[j + 2]
                length = np.sqrt(x * x + y * y + z * z)
                density = mu[e] * (length - rho[e]) / length
                if slackens[e] and density < 0.0:
                    density = 0.0
                result[i] -= density * x
                result[i + 1] -= density * y
                result[i + 2] -= density * z
                result[j] += density * x
                result[j + 1] += density * y
                result[j + 2] += density * z

        return force  # type: ignore[no-any-return]

    def _energy(self) -> Callable[[FloatArray, FloatArray], None]:
        first, second, mu, rho, slackens = self._data()
        place = self._place()

        @self.compile
        def energy(q: FloatArray, result: FloatArray) -> None:
            r, total = place(q), 0.0
            for e in range(first.size):
                i, j = 3 * first[e], 3 * second[e]
                x, y, z = r[i] - r[j], r[i + 1] - r[j + 1], r[i + 2] - r[j + 2]
                extension = np.sqrt(x * x + y * y + z * z) - rho[e]
                if slackens[e] and extension < 0.0:
                    extension = 0.0
                total += 0.5 * mu[e] * extension * extension
            result[0] = total

        return energy  # type: ignore[no-any-return]

    def _stiffness(self) -> Callable[[FloatArray, FloatArray], None]:
        first, second, mu, rho, slackens = self._data()
        place, target = self._place(), _targets(self.problem)

        @self.compile
        def stiffness(q: FloatArray, result: FloatArray) -> None:
            r = place(q)
            d = np.empty(3)
            for k in range(result.size):
                result[k] = 0.0
            for e in range(first.size):
                i, j = 3 * first[e], 3 * second[e]
                for a in range(3):
                    d[a] = r[i + a] - r[j + a]
                length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
                if slackens[e] and length <= rho[e]:
                    continue
                along = mu[e] * rho[e] / length
                outer = along / (length * length)
                for a in range(3):
                    for b in range(3):
                        value = outer * d[a] * d[b]
                        if a == b:
                            value += mu[e] - along
                        for c in range(4):
                            place_of = target[e, a, b, c]
                            if place_of >= 0:
                                result[place_of] += value if c < 2 else -value

        return stiffness  # type: ignore[no-any-return]


def _targets(problem: Problem) -> NDArray[np.int64]:
    """Return which non-zeros entry (a, b) of each member's block adds to, (n_members, 3, 3, 4), -1: none.

    The first two are added to, the other two taken from.
    """
    pattern, n = problem.stiffness_pattern, problem.n_members
    target = np.full((9 * n, 4), -1, dtype=np.int64)
    at_second = problem.second[pattern.slot // 9]
    row = problem.free[pattern.row[pattern.place]] // 3
    kind = np.where(pattern.sign > 0, 0, 2) + (row == at_second)
    target[pattern.slot, kind] = pattern.place
    return target.reshape(n, 3, 3, 4)
