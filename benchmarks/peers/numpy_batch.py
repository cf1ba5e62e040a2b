"""NumPy over many states at once: a leading axis for the states in every array."""

import numpy as np
from harness.problem import Problem
from harness.tools import Candidate, repeat_python
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def make_numpy(problem: Problem, quantity: str, states: FloatArray) -> Candidate:
    """Return the candidate that evaluates all states (n_states, n_coordinates) in one go."""
    function = {
        "node_force": _force,
        "elastic_energy": _energy,
        "tangent_stiffness": _stiffness,
    }[quantity]
    shared = _Shared(problem, states)

    def value() -> FloatArray:
        return np.asarray(function(shared)[0]).reshape(-1)

    run = repeat_python(lambda: function(shared))
    return Candidate("NumPy, all states at once", run, value, per_call=len(states))


class _Shared:
    """What does not change from call to call."""

    def __init__(self, problem: Problem, states: FloatArray) -> None:
        self.problem, self.states = problem, states
        self.position = np.tile(problem.fixed_position, (len(states), 1))
        self.slack_below = np.where(problem.tension_only, problem.rest_length, -np.inf)
        self.incidence = problem.incidence.toarray()
        self.adds = problem.stiffness_pattern.matrix(problem.n_members)

    def members(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return vectors (n_states, n_members, 3), lengths and spring constants (n_states, n_members)."""
        self.position[:, self.problem.free] = self.states
        nodes = self.position.reshape(len(self.states), -1, 3)
        vector = nodes[:, self.problem.first] - nodes[:, self.problem.second]
        length = np.sqrt(np.einsum("sek,sek->se", vector, vector))
        return vector, length, self.problem.mu * (length > self.slack_below)


def _force(shared: _Shared) -> FloatArray:
    vector, length, mu = shared.members()
    pull = (mu * (1 - shared.problem.rest_length / length))[:, :, None] * vector
    return shared.problem.external + shared.incidence @ pull


def _energy(shared: _Shared) -> FloatArray:
    _, length, mu = shared.members()
    return 0.5 * (mu * (length - shared.problem.rest_length) ** 2).sum(axis=1)


def _stiffness(shared: _Shared) -> FloatArray:
    vector, length, mu = shared.members()
    along = mu * shared.problem.rest_length / length
    blocks = (along / length**2)[:, :, None, None] * vector[:, :, :, None] * vector[:, :, None, :]
    blocks += (mu - along)[:, :, None, None] * np.eye(3)
    return (shared.adds @ blocks.reshape(len(shared.states), -1).T).T
