"""The chapter on S&K: node distances as coordinates, its Figs. 2 to 5 and what lies beyond them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.pages.diagram import Diagram, Series, dress_axes
from tensegrity_codegen.report.pages.page import Chapter, Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Table, make_table
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.canvas import INK, SEQUENCE, new_figure
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.inverse_time import inverse_section
from tensegrity_codegen.studies.papers.sk.motion import drift_section, sample_structure, trajectory_section
from tensegrity_codegen.studies.papers.sk.offset import offset_section
from tensegrity_codegen.studies.study import build_sections
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.pair_coordinates import AxisGraph
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.progress import ProgressFunction
from tensegrity_codegen.tables.request import ModelRequest

# How many numbers a linear model needs at each time point of a trajectory (S&K 5, 6, Figs. 3 and 4).
#
# With k members and a actuated ones, in three dimensions, and n nodes:
#
#     node positions      3n (3n + a)   dense second-order A and B; fewer where the sparsity is used
#     sorted, blocks      6k + 3a       a symmetric 3 x 3 block a member, a 3 x 1 block an actuated one
#     sorted, scalars     2k + 3k       mu (1 - rho/l), mu rho/l^3 and the member vector d
#     as printed          n (n + m)     the count that S&K 6 states for node positions, m = a inputs


def count_stored_numbers(structure: Structure) -> dict[str, int]:
    """Return way of storing -> numbers a time point for the linear model of `structure`.

    node_position_dense, node_position_sparse (the non-zeros of its Jacobians), sorted_blocks,
    sorted_scalars, as_printed; an actuated member is one with a rest-length input.
    """
    s, k = len(structure.axes), structure.n_members
    actuated = {e for source in structure.inputs if source.kind == "rest_length" for e in source.targets}
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


def compare_stored_numbers(nodes: Iterable[int] = range(6, 31, 2)) -> dict[str, Any]:
    """Return n_nodes, n_members, n_actuated and each way's numbers, (n_n,) each, for structures like prisms.

    The random structures have 2 n members and 3 n / 2 actuated cables, as the three-bar prism has.
    """
    counts = list(nodes)
    structures = [sample_structure(n) for n in counts]
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


# Way of storing -> name in legend and table, unit line of its column.
WAYS = {
    "as_printed": ("node positions as printed", "n (n + a)"),
    "node_position_dense": ("node positions, dense", "3n (3n + a)"),
    "node_position_sparse": ("node positions, sparse", "non-zeros"),
    "sorted_blocks": ("sorted, blocks", "6k + 3a"),
    "sorted_scalars": ("sorted, scalars", "5k"),
}


def pattern_section() -> Section:
    """Return the section with the pattern of D for six nodes, in both orders of components."""
    patterns = {order: find_difference_pattern(6, order) for order in ("uvec321", "uvec123")}
    rows, columns = patterns["uvec321"].shape
    count = int(np.count_nonzero(patterns["uvec321"]))
    figures = tuple(_pattern_figure(order, pattern) for order, pattern in patterns.items())
    return Section(
        "sk-fig-3",
        "Fig. 3",
        "Sparsity pattern of D",
        "agrees",
        f"{rows} × {columns} for six nodes, {count} of {rows * columns} entries are not zero",
        (
            Paragraph(
                "D takes node positions to the vectors of all pairs. Each row holds one +1 and one −1, "
                "each column n − 1 entries. The paper's column axis ends at 18 = 3 · 6, so that it shows "
                "six nodes."
            ),
            *figures,
        ),
    )


def storage_section(nodes: Sequence[int]) -> Section:
    """Return the section that counts stored numbers for structures of these numbers of nodes."""
    data = compare_stored_numbers(nodes)
    ways = ("sorted_scalars", "sorted_blocks", "node_position_sparse", "node_position_dense")
    reference, blocks, sparse, dense = (int(data[way][-1]) for way in ways)
    series = [
        Series(name, data["n_nodes"], data[way], color=color, marker="osD^v"[color])
        for color, (way, (name, _)) in enumerate(WAYS.items())
    ]
    return Section(
        "sk-fig-4",
        "Fig. 4",
        "Numbers to store for a linear model, at each time point",
        "differs",
        f"non-zeros at n = {nodes[-1]}: {blocks} in sorted node distances, {sparse} in node positions; "
        f"{reference} as scalars and vectors of blocks, {dense} in dense node positions",
        (
            Paragraph(
                "Structures with 2n members, 3n/2 of them actuated cables, as the three-bar prism has "
                "them; n nodes, k members, a actuated members. In control-sorted node distances only 3 × "
                "3 blocks change along a trajectory; two scalars and the member vector make up a block. "
                "Node positions are stored full, or as the non-zeros of their sparse Jacobians."
            ),
            diagram_figure(
                "sk-fig-4-counts",
                Diagram("number of nodes", "stored numbers", series, log_y=True, legend_columns=2),
                "Stored numbers a time point. The paper's axis ends above 1,500.",
                "Stored numbers against the number of nodes: dense node positions grow with the square, "
                "sparse and sorted ones linearly.",
            ),
            _counts_table(data),
            Remark(
                "differs",
                "The paper does not say how many members and inputs its structures have, and its count "
                "takes the n nodes for the number of coordinates, which is 3n; its own formula for "
                "sorted node distances is damaged in the text that we have. The gain over dense node "
                "positions is larger than printed, the gain over sparse ones is a factor of "
                f"{sparse / blocks:.1f} as non-zeros, of "
                f"{sparse / reference:.1f} as scalars and vectors of blocks.",
                ("sk-count",),
            ),
        ),
        "paper_wrong",
    )


def _pattern_figure(order: str, pattern: NDArray[np.int8]) -> Figure:
    """Return the entries of D as points."""
    figure = new_figure(3.4, 5.0)
    axes = figure.add_subplot()
    for sign, name, color, marker in ((1, "+1", 0, "s"), (-1, "−1", 1, "o")):
        row, column = np.nonzero(pattern == sign)
        axes.plot(
            column + 1, row + 1, marker, color=SEQUENCE[color], markersize=3.6, label=name, clip_on=False
        )
    dress_axes(axes, "component of the node positions", "component of the node distances")
    axes.set(xlim=(0.3, pattern.shape[1] + 0.7), ylim=(pattern.shape[0] + 0.7, 0.3))
    axes.set_xticks([1, 6, 12, 18])
    axes.set_yticks([1, 15, 30, 45])
    figure.legend(loc="outside upper center", ncols=2, frameon=False, fontsize=9.0, labelcolor=INK)
    arrangement = "pair by pair" if order == "uvec321" else "all x, all y, all z"
    return Figure(
        draw_picture(figure, f"sk-fig-3-{order}"),
        f"D of six nodes, {order}: {arrangement}.",
        f"Pattern of D in the order {order}: in each row one entry +1 and one entry −1.",
        {"order": order, "rows": pattern.tolist()},
    )


def _counts_table(data: dict[str, Any]) -> Table:
    heads = (
        "nodes [n]",
        "members [k]",
        "actuated [a]",
        *(f"{name} [{unit}]" for name, unit in WAYS.values()),
    )
    keys = ("n_nodes", "n_members", "n_actuated", *WAYS)
    rows = (tuple(int(data[key][index]) for key in keys) for index in range(len(data["n_nodes"])))
    return make_table("Stored numbers a time point.", dict.fromkeys(heads, ",d"), rows)


@dataclass(frozen=True)
class SkSizes:
    """How large the studies are: numbers of nodes in Figs. 2 and 4, and simulated times [s]."""

    inverse_nodes: tuple[int, ...]
    storage_nodes: tuple[int, ...]
    motion_time: float
    drift_time: float


FULL = SkSizes(tuple(range(6, 25, 2)), tuple(range(6, 31, 2)), 2.0, 1000.0)
QUICK = SkSizes((6, 8, 10), (6, 8, 10), 0.2, 10.0)


def build_sk_chapter(
    quick: bool = False, progress: ProgressFunction | None = None, journal: Journal | None = None
) -> Chapter:
    """Return the chapter, in full or in small sizes; raises what the studies raise, with the study's name."""
    sizes = QUICK if quick else FULL
    steps = (
        ("S&K Fig. 2", 6.0, partial(inverse_section, sizes.inverse_nodes)),
        ("S&K Fig. 3", 0.2, pattern_section),
        ("S&K Fig. 4", 1.0, partial(storage_section, sizes.storage_nodes)),
        ("S&K Fig. 5", 3.0, partial(trajectory_section, sizes.motion_time)),
        ("S&K invariant", 1.0, partial(drift_section, sizes.drift_time)),
        ("S&K offsets", 2.0, offset_section),
    )
    return Chapter(
        "sk",
        "S&K",
        "node distances as coordinates",
        "S. I. Savin, R. R. Khusainov: Sparse Node-Distance Coordinate Representation for Tensegrity "
        "Structures. Russian Journal of Nonlinear Dynamics 18 (2022) 5, 885–898.",
        build_sections(steps, progress, journal),
    )
