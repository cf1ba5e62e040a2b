"""Connected pieces of graphs are those of SciPy, in the order of their first nodes."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tensegrity_codegen.structure.pieces import find_pieces


@pytest.mark.parametrize(
    ("count", "edges"), [(0, 0), (1, 0), (5, 0), (40, 12), (300, 150), (300, 290), (2000, 2500)]
)
def test_random_graphs_have_the_pieces_of_scipy(count: int, edges: int) -> None:
    random = np.random.default_rng(count + edges)
    first, second = random.integers(0, max(count, 1), (2, edges))
    graph = coo_array((np.ones(edges), (first, second)), shape=(max(count, 1), max(count, 1)))
    expected, label = connected_components(graph, directed=False)
    found, piece = find_pieces(count, first, second)
    assert found == (expected if count else 0)
    assert piece.tolist() == label[:count].tolist()


def test_a_long_chain_in_any_order_is_one_piece() -> None:
    order = np.random.default_rng(3).permutation(10_000)
    found, piece = find_pieces(10_000, order[:-1], order[1:])
    assert found == 1
    assert not piece.any()
