"""Factors of symmetric matrices against solutions by LU, and whether they tell definite matrices."""

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.runtime.statics.factors import (
    Factoriser,
    find_lowest_curvature,
    find_lowest_dense,
    find_lowest_sparse,
)


def chain(lowest: float, n: int = 30):
    """Chain of springs with one eigenvalue moved to `lowest`, as a dense array."""
    matrix = sparse.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n)).toarray()
    value, vector = np.linalg.eigh(matrix)
    value[0] = lowest
    return vector @ np.diag(value) @ vector.T


KINDS = {"dense": np.asarray, "sparse": sparse.csc_array}


@pytest.fixture(params=["superlu", "cholmod"])
def library(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Which library factorises sparse matrices; without scikit-sparse there is only one."""
    if request.param == "superlu":
        monkeypatch.setitem(__import__("sys").modules, "sksparse", None)
    else:
        pytest.importorskip("sksparse", reason="scikit-sparse (extra [sparse]) is not installed")
    return str(request.param)


@pytest.mark.parametrize("kind", KINDS)
def test_definite_matrices_are_solved_with_one_ordering_for_one_pattern(kind, library) -> None:
    factoriser, rng = Factoriser(), np.random.default_rng(0)
    for lowest in (1.0, 0.01, 1e-6):
        matrix, right = chain(lowest), rng.normal(size=30)
        solve = factoriser.factorise(KINDS[kind](matrix))
        assert solve is not None
        np.testing.assert_allclose(solve(right), np.linalg.solve(matrix, right), rtol=1e-7)
    assert factoriser.n_factors == 3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lowest", [-1e-6, -0.5])
def test_matrices_with_a_negative_eigenvalue_have_no_factors(kind, lowest, library) -> None:
    factoriser = Factoriser()
    assert factoriser.factorise(KINDS[kind](chain(lowest))) is None
    assert factoriser.factorise(KINDS[kind](chain(0.1))) is not None  # the same object goes on
    assert factoriser.factorise(KINDS[kind](chain(lowest))) is None


def test_another_pattern_is_ordered_anew(library) -> None:
    factoriser = Factoriser()
    for n in (30, 31):
        matrix = sparse.diags_array([2.1, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n)).tocsc()
        for scale in (1.0, 2.0):
            solve = factoriser.factorise(scale * matrix)
            assert solve is not None
            np.testing.assert_allclose(scale * matrix @ solve(np.ones(n)), np.ones(n), atol=1e-12)


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
