"""How far results of the same force are apart, in units that rounding explains."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from peers.casadi_expressions import own_expression

from harness.problem import Problem


def largest_disagreement(problem: Problem, values: Sequence[NDArray[np.float64]]) -> float:
    """Return the largest difference between node forces, in units in the last place of each largest term."""
    stacked = np.array(values)
    unit = np.spacing(np.maximum(problem.largest_term(), np.finfo(float).tiny))
    return float(((stacked.max(axis=0) - stacked.min(axis=0)) / unit).max())


def count_unequal(problem: Problem, quantity: str, values: Sequence[NDArray[np.float64]]) -> int:
    """Return how many values differ from those of CasADi's virtual machine for the package's expression."""
    function = own_expression(problem, quantity)
    expected = np.array(function(problem.coordinate).nonzeros())
    return int(sum(np.count_nonzero(value != expected) for value in values))
