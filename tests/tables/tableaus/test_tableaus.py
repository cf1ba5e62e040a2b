"""Coefficients of the Runge-Kutta pairs: they meet the order conditions that their names promise."""

import numpy as np
import pytest

from tensegrity_codegen.tables.tableaus import EXPLICIT, TABLEAUS
from tensegrity_codegen.tables.tableaus.tableau import Row, Tableau


def dense(row: Row, size: int) -> np.ndarray:
    values = np.zeros(size)
    for stage, value in row.items():
        values[stage] = value
    return values


def matrix(table: Tableau) -> np.ndarray:
    """A, a row a stage; the first is empty, the last is the step."""
    size = table.rates
    rows = [dense({}, size), *(dense(row, size) for row in (*table.rows, *table.dense_rows))]
    return np.array(rows)


@pytest.mark.parametrize("name", TABLEAUS)
def test_the_step_integrates_powers_up_to_its_order(name: str) -> None:
    """Sum b_i c_i^(q-1) = 1/q for q = 1..p: the quadrature conditions."""
    table = TABLEAUS[name]
    a = matrix(table)
    b, c = a[table.stages], a.sum(axis=1)
    assert c[table.stages] == pytest.approx(1.0, abs=1e-14)
    for q in range(1, table.order + 1):
        assert b @ c ** (q - 1) == pytest.approx(1 / q, abs=2e-14)
    assert abs(b @ c**table.order - 1 / (table.order + 1)) > 1e-6


@pytest.mark.parametrize("name", TABLEAUS)
def test_tall_trees_hold_up_to_the_order(name: str) -> None:
    """b A^(q-1) 1 = 1/q!: a linear equation is met to the order, and not beyond."""
    table = TABLEAUS[name]
    a, vector = matrix(table), np.ones(table.rates)
    factorial = 1.0
    for q in range(1, table.order + 1):
        factorial *= q
        assert a[table.stages] @ vector == pytest.approx(1 / factorial, abs=2e-14)
        vector = a @ vector
    assert abs(a[table.stages] @ vector * factorial * (table.order + 1) - 1.0) > 1e-3


@pytest.mark.parametrize("name", TABLEAUS)
def test_bushy_and_tall_trees_mix(name: str) -> None:
    """b (c^m * A c^n) = 1 / ((n + 1) (n + m + 2)) while n + m + 2 is at most the order."""
    table = TABLEAUS[name]
    a = matrix(table)
    b, c = a[table.stages], a.sum(axis=1)
    for m in range(table.order - 1):
        for n in range(1, table.order - m - 1):
            assert b @ (c**m * (a @ c**n)) == pytest.approx(1 / ((n + 1) * (n + m + 2)), abs=5e-14)


@pytest.mark.parametrize("name", TABLEAUS)
def test_error_estimates_vanish_on_low_powers_only(name: str) -> None:
    """The estimate goes with h^p, that of two, e5^2 / e3 where both are small, with h^(2p - q)."""
    table = TABLEAUS[name]
    c = matrix(table).sum(axis=1)
    orders = [
        next(q for q in range(1, 10) if abs(dense(row, table.rates) @ c ** (q - 1)) > 1e-6)
        for row in table.errors
    ]
    assert (orders[0] if len(orders) == 1 else 2 * orders[0] - orders[1]) == table.error_order


@pytest.mark.parametrize("name", [name for name, table in TABLEAUS.items() if table.dense])
def test_dense_output_meets_polynomials_of_its_degree(name: str) -> None:
    """x' = t^m: the interpolant is exact in between for m below its order, and no further."""
    table = TABLEAUS[name]
    c = matrix(table).sum(axis=1)
    for m in range(table.dense_order):
        k = c**m
        rise = dense(table.rows[-1], table.rates) @ k
        parts = [rise, k[0] - rise, 2 * rise - (k[table.stages] + k[0])]
        parts += [dense(row, table.rates) @ k for row in table.dense]
        for s in np.linspace(0.0, 1.0, 7):
            total = 0.0
            for power in range(len(parts) - 1, -1, -1):
                total = (parts[power] + total) * (s if power % 2 == 0 else 1.0 - s)
            assert total == pytest.approx(s ** (m + 1) / (m + 1), abs=1e-13)


@pytest.mark.parametrize("name", TABLEAUS)
def test_vibrations_change_by_what_the_record_says(name: str) -> None:
    """|R(i a) - e^(i a)| is c a^p within a factor of 3 for a of 1 to 4, R the stability polynomial."""
    table = TABLEAUS[name]
    a, b = matrix(table), matrix(table)[table.stages]
    factor, power = table.vibration_loss
    moments, vector = [1.0], np.ones(table.rates)
    for _ in range(table.stages):
        moments.append(float(b @ vector))
        vector = a @ vector
    for angle in (1.0, 2.0, 4.0):
        found = sum(moment * (1j * angle) ** k for k, moment in enumerate(moments))
        assert 1 / 3 < abs(found - np.exp(1j * angle)) / (factor * angle**power) < 3


def test_every_module_with_a_tableau_is_a_method() -> None:
    assert tuple(EXPLICIT) == ("rk4", *TABLEAUS)
    assert set(TABLEAUS) >= {"rk54", "rk853"}
