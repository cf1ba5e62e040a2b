"""Stationary Riccati equations: closed forms, systems that the doubling algorithm leaves to QZ, refusals."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from tensegrity_codegen.control.feedback.design.riccati import RESIDUAL, compute_gain, find_stationary
from tensegrity_codegen.system.errors import ConvergenceError

Array = NDArray[np.float64]


def draw_system(seed: int, n: int, m: int, radius: float) -> tuple[Array, Array, Array, Array]:
    """Return a random system with eigenvalues up to a modulus, and weights of all states."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    a *= radius / np.abs(np.linalg.eigvals(a)).max()
    root = rng.normal(size=(n, n))
    return a, rng.normal(size=(n, m)), root @ root.T, np.diag(rng.uniform(0.5, 2.0, m))


@pytest.mark.parametrize("radius", [0.5, 1.0, 1.2])
@pytest.mark.parametrize("seed", range(4))
def test_the_solution_is_that_of_scipy_and_stabilises(seed: int, radius: float) -> None:
    a, b, q, r = draw_system(seed, 8, 3, radius)
    p, residual = find_stationary(a, b, q, r, "test")
    assert residual < RESIDUAL
    np.testing.assert_allclose(p, solve_discrete_are(a, b, q, r), rtol=1e-7, atol=1e-8 * np.abs(p).max())
    assert np.abs(np.linalg.eigvals(a - b @ compute_gain(p, a, b, r))).max() < 1.0


def test_a_scalar_system_has_the_solution_of_its_quadratic_equation() -> None:
    """p = q + a^2 p r / (r + b^2 p)."""
    a, b, q, r = 1.3, 0.4, 2.0, 5.0
    half = (r * (1 - a**2) - b**2 * q) / 2
    expected = (-half + np.sqrt(half**2 + b**2 * q * r)) / b**2
    p, _ = find_stationary(*(np.array([[value]]) for value in (a, b, q, r)), "test")
    assert p[0, 0] == pytest.approx(expected, rel=1e-12)


def test_an_unstable_motion_without_weight_is_stabilised() -> None:
    """The recursion from 0 stays at 0 there; the solution mirrors the eigenvalue: 2 becomes 1/2."""
    one, zero = np.eye(1), np.zeros((1, 1))
    p, _ = find_stationary(2.0 * one, one, zero, one, "test")
    assert p[0, 0] == pytest.approx(3.0, rel=1e-12)
    assert 2.0 - compute_gain(p, 2.0 * one, one, one)[0, 0] == pytest.approx(0.5, rel=1e-12)


def test_what_no_input_changes_is_refused() -> None:
    a, b = np.diag([1.1, 0.5]), np.array([[0.0], [1.0]])
    with pytest.raises(ConvergenceError):
        find_stationary(a, b, np.eye(2), np.eye(1), "test")


def test_many_fast_and_slow_motions_with_sums() -> None:
    """40 oscillators from 5 to 9,000 rad/s, sampled at 100 Hz, with sums of 10 of them."""
    rng, n, k, step = np.random.default_rng(0), 40, 10, 0.01
    rate, decay = np.geomspace(5.0, 9000.0, n), rng.uniform(0.5, 100.0, n)
    turn, fade = step * rate, np.exp(-decay * step)
    a = np.block(
        [
            [np.diag(fade * np.cos(turn)), np.diag(fade * np.sin(turn) / rate)],
            [np.diag(-fade * rate * np.sin(turn)), np.diag(fade * np.cos(turn))],
        ]
    )
    b = np.vstack([np.diag(step**2 * np.ones(n)), np.diag(step * np.ones(n))]) @ rng.normal(size=(n, 20))
    whole = np.zeros((2 * n + k, 2 * n + k))
    whole[: 2 * n, : 2 * n], whole[2 * n :, :k], whole[2 * n :, 2 * n :] = a, np.eye(k), np.eye(k)
    q = np.diag(np.concatenate([np.full(n, 1e3), np.ones(n), np.full(k, 1e2)]))
    b = np.vstack([b, np.zeros((k, 20))])
    p, residual = find_stationary(whole, b, q, 1e5 * np.eye(20), "test")
    assert residual < RESIDUAL
    closed = whole - b @ compute_gain(p, whole, b, 1e5 * np.eye(20))
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
