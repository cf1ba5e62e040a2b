"""How many numbers a linear model needs at each time point of a trajectory (S&K 5, 6, Figs. 3 and 4).

With k members and a actuated ones, in three dimensions, and n nodes:

    node positions      3n (3n + a)   dense second-order A and B; fewer where the sparsity is used
    sorted, blocks      6k + 3a       a symmetric 3 x 3 block a member, a 3 x 1 block an actuated one
    sorted, scalars     2k + 3k       mu (1 - rho/l), mu rho/l^3 and the member vector d
    as printed          n (n + m)     the count that S&K 6 states for node positions, m = a inputs
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.sample import sample_structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.distances.pair_graph import AxisGraph
from tensegrity_codegen.tables.request import ModelRequest


def count_stored_numbers(structure: Structure) -> dict[str, int]:
    """Return way of storing -> numbers a time point for the linear model of `structure`.

    node_position_dense, node_position_sparse (the non-zeros of its Jacobians), sorted_blocks,
    sorted_scalars, as_printed; an actuated member is one with a rest-length input.
    """
    s, k = len(structure.axes), structure.n_members
    actuated = {e for item in structure.inputs if item.kind == "rest_length" for e in item.targets}
    coordinates, inputs = len(structure.coordinate_node_axis), len(structure.inputs)
    model = build_model(structure, ModelRequest(()))
    stiffness = model.expression("tangent_stiffness").nnz()
    control = model.expression("input_jacobian").nnz() if inputs else 0
    return {
        "node_position_dense": coordinates * (coordinates + inputs),
        "node_position_sparse": stiffness + control,
        "sorted_blocks": s * (s + 1) // 2 * k + s * len(actuated),
        "sorted_scalars": 2 * k + s * k,
        "as_printed": structure.n_nodes * (structure.n_nodes + inputs),
    }


def compare_stored_numbers(nodes: Iterable[int] = range(6, 31, 2), seed: int = 0) -> dict[str, Any]:
    """Return n_nodes, n_members, n_actuated and each way's numbers, (n_n,) each, for structures like prisms.

    The random structures have 2 n members and 3 n / 2 actuated cables, as the three-bar prism has.
    """
    counts = list(nodes)
    structures = [sample_structure(n, "sparse", seed) for n in counts]
    rows = [count_stored_numbers(structure) for structure in structures]
    return {
        "n_nodes": np.array(counts),
        "n_members": np.array([structure.n_members for structure in structures]),
        "n_actuated": np.array([len(structure.inputs) for structure in structures]),
        **{name: np.array([row[name] for row in rows]) for name in rows[0]},
    }


def find_difference_pattern(n_nodes: int = 6, order: str = "uvec321") -> NDArray[np.int8]:
    """Return D (3k, 3n) of all pairs of free nodes, entries -1, 0, +1 (S&K Fig. 3)."""
    ends = np.array(np.triu_indices(n_nodes, 1), dtype=np.int64).T
    incidence = AxisGraph(ends, np.zeros(n_nodes, dtype=bool)).incidence.astype(np.int8)
    identity = np.eye(3, dtype=np.int8)
    if order == "uvec321":
        return np.kron(incidence, identity)
    rows = np.kron(incidence, identity).reshape(len(ends), 3, -1)
    return np.ascontiguousarray(rows.swapaxes(0, 1).reshape(3 * len(ends), -1))
