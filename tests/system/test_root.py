"""Brent's method beside SciPy's, on random functions of several shapes."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from tensegrity_codegen.system.root import find_root

SHAPES: tuple[Callable[[float, float, float], float], ...] = (
    lambda x, r, k: math.expm1(k * (x - r)),
    lambda x, r, k: math.atan(100 * k * (x - r)),
    lambda x, r, k: (x - r) ** 3,
    lambda x, r, k: (x - r) ** 9 + 1e-12 * (x - r),
    lambda x, r, k: (x - r) * (1 + k * math.sin(5 * x) ** 2),
    lambda x, r, k: 1.0 if x > r else -k,
)


class Counted:
    def __init__(self, function: Callable[[float], float]) -> None:
        self.function = function
        self.calls = 0

    def __call__(self, x: float) -> float:
        self.calls += 1
        return self.function(x)


@pytest.mark.parametrize("shape", range(len(SHAPES)))
@pytest.mark.parametrize("tolerance", [0.0, 1e-6])
def test_the_root_is_that_of_scipy_in_about_as_many_calls(shape: int, tolerance: float) -> None:
    random = np.random.default_rng(shape)
    ours = theirs = 0
    for _ in range(200):
        root, k = random.uniform(-2, 3), random.uniform(0.1, 4)
        function = Counted(lambda x, r=root, k=k: SHAPES[shape](x, r, k))
        low, high = root - random.uniform(0, 3), root + random.uniform(0, 3)
        found = find_root(function, low, high, tolerance)
        ours += function.calls
        assert low <= found <= high
        expected = brentq(function, low, high, xtol=max(tolerance, 1e-300), rtol=1e-15, maxiter=1000)
        theirs += function.calls
        assert abs(found - expected) <= 2 * tolerance + 16 * math.ulp(root)
    assert ours <= 1.2 * (theirs - ours)


def test_a_bracket_from_above_and_roots_at_its_ends() -> None:
    assert find_root(lambda x: x * x - 2, 2.0, 0.0, 0.0) == pytest.approx(math.sqrt(2), rel=1e-15)
    assert find_root(lambda x: x, 0.0, 1.0, 0.0) == 0.0
    assert find_root(lambda x: x - 1, 0.0, 1.0, 0.0) == 1.0


def test_values_of_one_sign_or_none_are_refused() -> None:
    with pytest.raises(ValueError, match="same sign"):
        find_root(lambda x: x * x + 1, -1.0, 1.0, 0.0)
    with pytest.raises(ValueError, match="not a number"):
        find_root(lambda x: math.nan, -1.0, 1.0, 0.0)
