"""Dense and sparse trust-region steps against the conditions that define them."""

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.runtime.statics.curvature import find_lowest_curvature
from tensegrity_codegen.runtime.statics.dense_curvature import DenseCurvature, find_lowest_dense
from tensegrity_codegen.runtime.statics.sparse_curvature import SparseCurvature, find_lowest_sparse

KINDS = {"dense": lambda k: DenseCurvature(k, 1e-12), "sparse": SparseCurvature}


def matrix(lowest: float, n: int = 30):
    """Chain of springs with one eigenvalue moved to `lowest`."""
    chain = sparse.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n)).toarray()
    value, vector = np.linalg.eigh(chain)
    value[0] = lowest
    return sparse.csc_array(vector @ np.diag(value) @ vector.T), vector[:, 0]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lowest", [0.01, 0.0, -0.5])
@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e5])
def test_step_is_as_good_as_any_within_the_radius(kind, lowest, radius) -> None:
    stiffness, _ = matrix(lowest)
    rng = np.random.default_rng(3)
    gradient = rng.normal(size=30)
    step = KINDS[kind](stiffness).find_step(gradient, radius)
    length = np.linalg.norm(step.vector)
    assert length <= 1.45 * radius

    def change(vector):
        return gradient @ vector + vector @ (stiffness @ vector) / 2

    assert step.predicted == pytest.approx(-change(step.vector), rel=1e-9)
    for _ in range(200):
        other = rng.normal(size=30)
        other *= length / np.linalg.norm(other)
        assert change(step.vector) <= change(other)


@pytest.mark.parametrize("kind", KINDS)
def test_step_is_newtons_where_the_radius_permits(kind) -> None:
    stiffness, _ = matrix(0.01)
    gradient = np.arange(30.0)
    step = KINDS[kind](stiffness).find_step(gradient, 1e9)
    np.testing.assert_allclose(step.vector, -np.linalg.solve(stiffness.toarray(), gradient), rtol=1e-6)
    assert not step.at_boundary


@pytest.mark.parametrize("kind", KINDS)
def test_step_leaves_along_negative_curvature_without_any_slope_there(kind) -> None:
    stiffness, down = matrix(-0.5)
    gradient = np.ones(30) - down * (down @ np.ones(30))
    step = KINDS[kind](stiffness).find_step(gradient, 100.0)
    assert abs(step.vector @ down) > 50


@pytest.mark.parametrize("find", [find_lowest_dense, find_lowest_sparse])
@pytest.mark.parametrize("lowest", [0.005, -0.5])
def test_lowest_curvature_with_and_without_a_neutral_motion(find, lowest) -> None:
    stiffness, down = matrix(lowest)
    value, vector = find(stiffness, np.zeros((30, 0)))
    assert value == pytest.approx(lowest, rel=1e-5)
    assert abs(vector @ down) == pytest.approx(1.0, rel=1e-4)
    above, _ = find(stiffness, down[:, None])
    assert above == pytest.approx(np.linalg.eigvalsh(stiffness.toarray())[1], rel=1e-5)


def test_nothing_left_is_infinitely_stiff() -> None:
    assert find_lowest_curvature(sparse.csc_array(np.eye(2)), np.eye(2))[0] == float("inf")
