"""Steps of many cases: each is the step that the search for one case takes."""

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.runtime.statics.batch.trust_region import find_steps
from tensegrity_codegen.runtime.statics.dense_curvature import DenseCurvature


def make_stiffness(random: np.random.Generator, size: int, lowest: float) -> np.ndarray:
    vector = np.linalg.qr(random.normal(size=(size, size)))[0]
    value = np.geomspace(1.0, 1e4, size)
    value[0] = lowest
    return (vector * value) @ vector.T


@pytest.mark.parametrize("lowest", [1.0, 0.0, -3.0], ids=["stable", "singular", "curved"])
@pytest.mark.parametrize("size", [1, 2, 7])
def test_steps_are_those_of_single_cases(lowest: float, size: int) -> None:
    random = np.random.default_rng(size)
    count = 12
    stiffness = np.array([make_stiffness(random, size, lowest) for _ in range(count)])
    stiffness = (stiffness + stiffness.transpose(0, 2, 1)) / 2
    gradient = random.normal(size=(count, size))
    radius, noise = np.geomspace(1e-3, 1e3, count), np.full(count, 1e-12)
    found = find_steps(stiffness, gradient, radius, noise)
    for k in range(count):
        alone = DenseCurvature(sparse.csc_array(stiffness[k]), noise[k]).find_step(gradient[k], radius[k])
        assert found.at_boundary[k] == alone.at_boundary
        # Alone the shift is found to six digits, which near a singular stiffness are few of the length.
        np.testing.assert_allclose(found.vector[k], alone.vector, atol=1e-2 * np.linalg.norm(alone.vector))
        assert found.predicted[k] == pytest.approx(alone.predicted, rel=1e-2)
        assert found.length[k] <= radius[k] * (1 + 1e-6)


def test_no_gradient_no_step() -> None:
    found = find_steps(np.eye(3)[None], np.zeros((1, 3)), np.ones(1), np.zeros(1))
    assert found.predicted[0] == 0.0
    assert found.length[0] == 0.0
