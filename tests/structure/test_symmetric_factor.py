"""Factors of small symmetric matrices: they solve, they stay sparse, symbols and numbers agree."""

import itertools

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.structure.symmetric_factor import factorise


def matrix(diagonal: list[float], coupling: dict[tuple[int, int], float]) -> np.ndarray:
    dense = np.diag(diagonal)
    for (i, j), value in coupling.items():
        dense[i, j] = dense[j, i] = value
    return dense


def chain(count: int) -> tuple[list[float], dict[tuple[int, int], float]]:
    rng = np.random.default_rng(count)
    shuffled = rng.permutation(count).tolist()
    pairs = itertools.pairwise(shuffled)
    return rng.uniform(2, 3, count).tolist(), {pair: float(rng.uniform(0.2, 0.9)) for pair in pairs}


@pytest.mark.parametrize("count", [1, 2, 3, 10, 200])
def test_the_solution_undoes_the_matrix(count: int) -> None:
    diagonal, coupling = chain(count)
    right = np.linspace(-1, 2, count)
    found = np.array(factorise(diagonal, coupling).solve(right.tolist()))
    np.testing.assert_allclose(matrix(diagonal, coupling) @ found, right, atol=1e-14)


def test_a_dense_matrix_is_solved_too() -> None:
    rng = np.random.default_rng(5)
    pairs = [(i, j) for i in range(6) for j in range(i)]
    coupling = {pair: float(rng.uniform(-0.3, 0.3)) for pair in pairs}
    found = np.array(factorise([2.0] * 6, coupling).solve([1.0, 0.0, 2.0, 0.0, -1.0, 3.0]))
    expected = np.linalg.solve(matrix([2.0] * 6, coupling), [1.0, 0.0, 2.0, 0.0, -1.0, 3.0])
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_a_chain_in_any_order_has_no_fill() -> None:
    factor = factorise(*chain(200))
    assert sum(len(below) for below in factor.below) == 199


def test_symbols_and_numbers_give_the_same_bits() -> None:
    diagonal, coupling = chain(9)
    right = np.random.default_rng(1).normal(size=9)
    symbols = ca.SX.sym("m", 9)
    solution = factorise(ca.vertsplit(symbols), coupling).solve(right.tolist())
    found = ca.Function("f", [symbols], [ca.vertcat(*solution)])(diagonal)
    np.testing.assert_array_equal(
        np.array(found).ravel(), factorise(diagonal, coupling).solve(right.tolist())
    )
