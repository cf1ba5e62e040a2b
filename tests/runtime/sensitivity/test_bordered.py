"""Factors of a stiffness with a border, where the stiffness is regular and where it is not."""

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.runtime.sensitivity.static_system import factorise


@pytest.mark.parametrize("rounding", [0.0, 1e-12])
@pytest.mark.parametrize("scale", [0.0, 1.0, 1e9])
def test_a_stiffness_without_resistance_to_a_motion_is_not_regular(scale: float, rounding: float) -> None:
    stiffness = sparse.csc_array(scale * np.array([[1.0, 1.0], [1.0, 1.0]]))
    factors, is_regular = factorise(stiffness, sparse.csc_array((0, 2)), np.zeros((2, 0)), rounding)
    assert not is_regular
    eigenvalue, direction = factors.find_softest()
    assert abs(eigenvalue) <= 1e-6 * max(scale, 1.0)
    assert np.linalg.norm(stiffness @ direction) <= 1e-6 * scale


def test_a_regular_stiffness_is_solved() -> None:
    stiffness = sparse.csc_array(np.array([[2.0, 1.0], [1.0, 3.0]]))
    factors, is_regular = factorise(stiffness, sparse.csc_array((0, 2)), np.zeros((2, 0)), 1e-16)
    assert is_regular
    moved, _, _ = factors.solve(np.array([[1.0], [2.0]]), np.zeros((0, 1)))
    np.testing.assert_allclose(stiffness @ moved, [[1.0], [2.0]], rtol=1e-14)
