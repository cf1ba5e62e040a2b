"""Saddle matrices factored by tables: the factors are those of the matrix, in any graph, without pivoting."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.integrators.implicit import SaddlePattern, build_saddle_pattern, order_blocks


def factor(pattern: SaddlePattern, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L and D of the matrix in the order of elimination, by the tables alone, as the generated C does it."""
    place = np.array(pattern.elimination_row)
    ordered = np.zeros_like(matrix)
    ordered[np.ix_(place, place)] = matrix
    value = np.zeros(len(pattern.factor_column), dtype=matrix.dtype)
    pivot = np.zeros(pattern.size, dtype=matrix.dtype)
    for row in range(pattern.size):
        spare = np.zeros(pattern.size, dtype=matrix.dtype)
        columns = pattern.entry_column[pattern.entry_start[row] : pattern.entry_start[row + 1]]
        spare[list(columns)] = ordered[row, list(columns)]
        pivot[row] = ordered[row, row]
        for k in range(pattern.factor_start[row], pattern.factor_start[row + 1]):
            column = pattern.factor_column[k]
            for m in range(pattern.update_start[k], pattern.update_start[k + 1]):
                spare[pattern.update_row[m]] -= value[pattern.update_entry[m]] * spare[column]
            value[k] = spare[column] / pivot[column]
            pivot[row] -= value[k] * spare[column]
    lower = np.eye(pattern.size, dtype=matrix.dtype)
    for row in range(pattern.size):
        for k in range(pattern.factor_start[row], pattern.factor_start[row + 1]):
            lower[row, pattern.factor_column[k]] = value[k]
    return lower, pivot


def random_saddle(seed: int, n: int, m: int, compliance: float) -> tuple[SaddlePattern, np.ndarray]:
    """Blocks of up to three coordinates, a positive definite A, m rows of G over two blocks each."""
    rng = np.random.default_rng(seed)
    blocks = [list(range(k, min(k + 3, n))) for k in range(0, n, 3)]
    a = np.diag(rng.uniform(3.0, 5.0, n))
    pairs = [tuple(int(k) for k in rng.choice(n, 2, replace=False)) for _ in range(n // 2)] if n > 1 else []
    for i, j in pairs:
        a[i, j] = a[j, i] = rng.uniform(-0.3, 0.3)
    g = np.zeros((m, n))
    for row in range(m):
        for block in rng.choice(len(blocks), min(2, len(blocks)), replace=False):
            g[row, blocks[block]] = rng.normal(size=len(blocks[block]))
    pattern = build_saddle_pattern(n, blocks, pairs, [np.flatnonzero(row).tolist() for row in g])
    return pattern, np.block([[a, g.T], [g, -compliance * np.eye(m)]])


@given(st.integers(0, 10**6), st.integers(1, 24), st.integers(0, 7), st.sampled_from([0.0, 1e-9, 1.0]))
def test_the_tables_factor_any_saddle_matrix(seed: int, n: int, m: int, compliance: float) -> None:
    m = min(m, n // 3)  # rows of G that can be independent
    pattern, matrix = random_saddle(seed, n, m, compliance)
    lower, pivot = factor(pattern, matrix)
    place = np.array(pattern.elimination_row)
    ordered = np.zeros_like(matrix)
    ordered[np.ix_(place, place)] = matrix
    scale = np.abs(matrix).max() * max(1.0, np.abs(lower).max() ** 2)
    np.testing.assert_allclose(lower @ np.diag(pivot) @ lower.T, ordered, atol=1e-12 * scale)
    assert np.all(pivot[place[:n]] > 0)
    assert np.all(pivot[place[n:]] < 0)


def test_complex_symmetric_matrices_use_the_same_tables() -> None:
    pattern, matrix = random_saddle(3, 18, 4, 0.0)
    matrix = matrix.astype(complex)
    matrix[:18, :18] *= 2.0 + 5.0j
    lower, pivot = factor(pattern, matrix)
    place = np.array(pattern.elimination_row)
    np.testing.assert_allclose((lower @ np.diag(pivot) @ lower.T)[np.ix_(place, place)], matrix, atol=1e-12)


def test_multipliers_come_after_the_nodes_that_they_join() -> None:
    pattern, _ = random_saddle(11, 21, 6, 0.0)
    for row in range(6):
        after = pattern.elimination_row[21 + row]
        joined = [k for k in range(21) if _has_entry(pattern, after, pattern.elimination_row[k])]
        assert joined
        assert all(pattern.elimination_row[k] < after for k in joined)


def _has_entry(pattern: SaddlePattern, row: int, column: int) -> bool:
    first, last = pattern.entry_start[row], pattern.entry_start[row + 1]
    return column in pattern.entry_column[first:last]


def test_bars_that_share_no_node_fill_nothing_in() -> None:
    blocks = [[3 * k, 3 * k + 1, 3 * k + 2] for k in range(6)]
    bars = [[*blocks[k], *blocks[k + 1]] for k in range(0, 6, 2)]
    pattern = build_saddle_pattern(18, blocks, [], bars)
    assert len(pattern.factor_column) == len(pattern.entry_column) == 18


def test_least_degree_starts_at_the_ends_of_a_chain_and_keeps_to_what_comes_before() -> None:
    chain = [(k, k + 1) for k in range(4)]
    assert order_blocks([set()] * 5, chain)[0] == 0
    assert order_blocks([{1, 2}, set(), set(), set(), set()], chain).index(0) > 1
