"""The smallest eigenvalue of a stiffness, dense and by Lanczos, against a full decomposition."""

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.runtime.statics.curvature import (
    find_lowest_curvature,
    find_lowest_dense,
    find_lowest_sparse,
)
from tests.runtime.statics.test_factors import chain


@pytest.mark.parametrize("find", [find_lowest_dense, find_lowest_sparse])
@pytest.mark.parametrize("lowest", [0.005, -0.5])
def test_lowest_curvature_with_and_without_a_neutral_motion(find, lowest) -> None:
    stiffness = sparse.csc_array(chain(lowest))
    down = np.linalg.eigh(stiffness.toarray())[1][:, 0]
    value, vector = find(stiffness, np.zeros((30, 0)))
    assert value == pytest.approx(lowest, rel=1e-5)
    assert abs(vector @ down) == pytest.approx(1.0, rel=1e-4)
    above, _ = find(stiffness, down[:, None])
    assert above == pytest.approx(np.linalg.eigvalsh(stiffness.toarray())[1], rel=1e-5)


def test_nothing_left_is_infinitely_stiff() -> None:
    assert find_lowest_curvature(sparse.csc_array(np.eye(2)), np.eye(2))[0] == float("inf")
