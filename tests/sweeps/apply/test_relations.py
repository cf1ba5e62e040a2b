"""Entries that equal a key, a multiple of it, or it plus a constant, to the last bit."""

import numpy as np

from tensegrity_codegen.sweeps.apply.relations import find_relations

X = np.random.default_rng(3).uniform(0.5, 2.0, (8, 5)) * np.array([1.0, 1e6, -1e-3, 1.0, 1.0])
X[:, 3] = 4.0  # a key that does not vary
X[2, 4] = 0.0


def test_relations_are_found_and_computed_to_the_last_bit() -> None:
    y = np.stack(
        [X[:, 1], X[:, 0] * 0.3, np.deg2rad(X[:, 0]), X[:, 2] + 0.1, X[:, 4] * -7.7, X[:, 4] + 1e5], axis=1
    )
    found = find_relations(X, y)
    assert found.entries.tolist() == list(range(6))
    assert found.keys.tolist() == [1, 0, 0, 2, 4, 4]
    assert np.array_equal(found.compute(X), y)


def test_what_follows_otherwise_is_left() -> None:
    y = np.stack([X[:, 0] ** 2, X[:, 0] + X[:, 2], 2 * X[:, 0] + 1, X[:, 0] * (1 + 1e-13 * X[:, 4])], axis=1)
    assert not len(find_relations(X, y).entries)


def test_nearly_a_multiple_is_taken_only_where_it_is_allowed() -> None:
    y = np.array([[float(f"{value * 1.7:.12e}")] for value in X[:, 0]])
    assert not len(find_relations(X, y).entries)
    found = find_relations(X, y, 3e-12)
    assert found.keys.tolist() == [0]
    assert np.allclose(found.compute(X), y, rtol=3e-12, atol=0.0)


def test_entries_of_many_keys_are_told_apart() -> None:
    x = np.random.default_rng(4).normal(size=(9, 400))
    found = find_relations(x, x[:, ::-1])
    assert found.keys.tolist() == list(range(400))[::-1]
