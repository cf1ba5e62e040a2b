"""Rank by singular values."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.analysis.rank import MAX_ROWS, find_rank
from tensegrity_codegen.system.errors import FormulationError, NonFiniteError
from tests.runtime.analysis.plain import icosahedron, prism


def test_prism_and_icosahedron() -> None:
    """Rank 11 of 12 and 29 of 30: one self-stress, and one mechanism beside the six rigid motions."""
    for structure, rank in ((prism(3, np.radians(150)), 11), (icosahedron(), 29)):
        found = find_rank(structure.matrix)
        assert (found.rank, found.largest_rank) == (rank, rank + 1)
        assert len(found.selfstress) == 1
        assert found.free_motion.shape[1] == 6 + 1
        assert found.gap > 1e9
        assert found.warning == ""
        assert found.above / found.singular_value[0] > 1e-2
        assert np.abs(structure.matrix @ found.selfstress[0]).max() < 1e-13
        assert np.abs(structure.matrix.T @ found.free_motion).max() < 1e-13


@pytest.mark.parametrize(("shift", "size"), [(1000.0, 1.0), (0.0, 1e-3), (0.0, 1e3), (1e4, 1e3)])
def test_place_and_size_do_not_matter(shift, size) -> None:
    structure = prism(3, np.radians(150))
    moved = type(structure)(structure.position * size + shift, structure.pairs, structure.is_cable)
    found, plain = find_rank(moved.matrix), find_rank(structure.matrix)
    assert (found.rank, found.warning) == (11, "")
    np.testing.assert_allclose(np.abs(found.selfstress), np.abs(plain.selfstress), atol=1e-9)


@pytest.mark.parametrize(("turn", "rank"), [(0.0, 11), (1e-7, 11), (1e-4, 12), (0.1, 12)])
def test_a_twist_beside_the_right_one_has_full_rank(turn, rank) -> None:
    """The smallest singular value is proportional to the error of the twist."""
    assert find_rank(prism(3, np.radians(150) + turn).matrix).rank == rank


def test_values_without_a_clear_gap_are_reported() -> None:
    left, right = (np.linalg.qr(np.random.default_rng(k).normal(size=(6, 6)))[0] for k in (1, 2))
    values = np.array([1.0, 0.5, 1e-5, 3e-7, 1e-8, 1e-9])
    found = find_rank(left @ np.diag(values) @ right)
    assert found.rank == 3
    assert "differ by a factor of 33" in found.warning
    assert found.above == pytest.approx(1e-5, rel=1e-6)
    near = find_rank(left @ np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 2e-6]) @ right)
    assert near.rank == 6
    assert "next to the tolerance" in near.warning
    assert find_rank(left @ np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 1e-3]) @ right).warning == ""


@pytest.mark.parametrize("last", [0.0, 1e-17])
def test_a_value_of_rounded_coordinates_is_named_and_counts_as_zero_when_told(last) -> None:
    """An exact zero beside it does not hide it: the dome of the gallery has both at millimetres."""
    matrix = np.diag([1.0, 0.5, 0.3, 1.3e-5, last])
    found = find_rank(matrix)
    assert found.rank == 4
    assert "1.3e-05 of the largest" in found.warning
    assert "`rank_tolerance=1e-4` counts it so" in found.warning
    told = find_rank(matrix, tolerance=1e-4)
    assert (told.rank, told.warning) == (3, "")


def test_least_solutions() -> None:
    """Tensions for a load in the range of A, displacements for elongations in that of A^T."""
    matrix = icosahedron().matrix
    found = find_rank(matrix)
    tension = np.random.default_rng(3).normal(size=30)
    back, left = found.find_tension(matrix @ tension)
    np.testing.assert_allclose(matrix @ back, matrix @ tension, atol=1e-12)
    assert left < 1e-12
    assert abs(found.selfstress @ back) < 1e-12
    pushed = found.find_tension(found.free_motion[:, 0])
    assert pushed[1] == pytest.approx(1.0)
    motion = found.find_displacement(matrix.T @ np.arange(36.0))
    np.testing.assert_allclose(matrix.T @ motion, matrix.T @ np.arange(36.0), atol=1e-12)


@pytest.mark.parametrize("shape", [(0, 0), (3, 0), (0, 2), (3, 2)])
def test_nothing_to_decompose(shape) -> None:
    """No members, no free coordinates, or members between anchors only."""
    found = find_rank(np.zeros(shape))
    assert found.rank == 0
    assert found.selfstress.shape == (shape[1], shape[1])
    assert found.free_motion.shape == (shape[0], shape[0])


def test_bad_matrices_are_refused() -> None:
    with pytest.raises(NonFiniteError, match="equilibrium_matrix"):
        find_rank(np.array([[np.nan, 1.0]]))
    with pytest.raises(FormulationError, match="too large"):
        find_rank(np.zeros((MAX_ROWS + 1, 1)))
