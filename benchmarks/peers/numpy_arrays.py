"""NumPy: whole arrays, contributions added up by a sparse incidence matrix or by numpy.add.at."""

from collections.abc import Callable

import numpy as np
from harness.problem import Problem
from harness.tools import Candidate, Tools, Unavailable, Way, repeat_python
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Arrays:
    """The physics of a problem in whole arrays."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.position = problem.fixed_position.copy()
        self.slack_below = np.where(problem.tension_only, problem.rest_length, -np.inf)

    def members(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return member vectors, lengths and spring constants, zero for slack cables."""
        problem = self.problem
        self.position[problem.free] = coordinate
        nodes = self.position.reshape(-1, 3)
        vector = nodes[problem.first] - nodes[problem.second]
        length = np.sqrt(np.einsum("ek,ek->e", vector, vector))
        return vector, length, problem.mu * (length > self.slack_below)

    def pull(self, coordinate: FloatArray) -> FloatArray:
        """Return t d / l of every member [N]."""
        vector, length, mu = self.members(coordinate)
        return (mu * (1 - self.problem.rest_length / length))[:, None] * vector

    def energy(self, coordinate: FloatArray) -> float:
        """Return the strain energy [J]."""
        _, length, mu = self.members(coordinate)
        extension = length - self.problem.rest_length
        return 0.5 * float(mu @ (extension * extension))

    def blocks(self, coordinate: FloatArray) -> FloatArray:
        """Return mu rho/l^3 d d^T + mu (1 - rho/l) I of every member, (n_members, 3, 3) [N/m]."""
        vector, length, mu = self.members(coordinate)
        along = mu * self.problem.rest_length / length
        blocks = vector[:, :, None] * ((along / (length * length))[:, None] * vector)[:, None, :]
        blocks[:, (0, 1, 2), (0, 1, 2)] += (mu - along)[:, None]
        return blocks


def ways(problem: Problem, quantity: str, tools: Tools) -> list[Way]:
    """Return title and maker of the candidates for that quantity."""
    titles = ("NumPy, add.at", "NumPy, incidence") if quantity == "node_force" else ("NumPy, incidence",)
    titles = ("NumPy",) if quantity == "elastic_energy" else titles
    return [(title, lambda title=title: _make(title, problem, quantity)) for title in titles]


def _make(title: str, problem: Problem, quantity: str) -> Candidate:
    call, at = _functions(Arrays(problem), quantity)[title], problem.coordinate
    return Candidate(title, repeat_python(lambda: call(at)), lambda: np.asarray(call(at)).reshape(-1))


def _functions(arrays: Arrays, quantity: str) -> dict[str, Callable[[FloatArray], object]]:
    """Return title -> f(coordinate); raises Unavailable where there is none."""
    problem = arrays.problem
    if quantity == "node_force":
        incidence, external = problem.incidence, problem.external

        def add_at(q: FloatArray) -> FloatArray:
            pull, force = arrays.pull(q), external.copy()
            np.subtract.at(force, problem.first, pull)
            np.add.at(force, problem.second, pull)
            return force

        return {"NumPy, add.at": add_at, "NumPy, incidence": lambda q: external + incidence @ arrays.pull(q)}
    if quantity == "elastic_energy":
        return {"NumPy": arrays.energy}
    if quantity == "tangent_stiffness":
        adds = problem.stiffness_pattern.matrix(problem.n_members)
        return {"NumPy, incidence": lambda q: adds @ arrays.blocks(q).reshape(-1)}
    raise Unavailable("left to force, energy and stiffness")
