"""S&K Figs. 3 and 4: where D is not zero, and how many numbers a linear model needs a time point."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.pages.diagram import Diagram, Series, dress_axes
from tensegrity_codegen.report.pages.page import Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.canvas import new_figure
from tensegrity_codegen.report.pictures.palette import INK, SEQUENCE
from tensegrity_codegen.studies.papers.sk.stored_numbers import (
    compare_stored_numbers,
    find_difference_pattern,
)

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
    dense, least = int(data["node_position_dense"][-1]), int(data["sorted_scalars"][-1])
    return Section(
        "sk-fig-4",
        "Fig. 4",
        "Numbers to store for a linear model, at each time point",
        "differs",
        f"at n = {nodes[-1]}: {least} in sorted node distances, {dense} in dense node positions",
        (
            Paragraph(
                "Structures with 2n members, 3n/2 of them actuated cables, as the three-bar prism has "
                "them; n nodes, k members, a actuated members. In control-sorted node distances only 3 × "
                "3 blocks change along a trajectory; two scalars and the member vector make up a block. "
                "Node positions are stored full, or as the non-zeros of their sparse Jacobians."
            ),
            diagram_figure(
                "sk-fig-4-counts",
                _counts_diagram(data),
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
                f"{data['node_position_sparse'][-1] / least:.1f} at every size.",
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
    what = "pair by pair" if order == "uvec321" else "all x, all y, all z"
    return Figure(
        draw_picture(figure, f"sk-fig-3-{order}"),
        f"D of six nodes, {order}: {what}.",
        f"Pattern of D in the order {order}: in each row one entry +1 and one entry −1.",
        {"order": order, "rows": pattern.tolist()},
    )


def _counts_diagram(data: dict[str, Any]) -> Diagram:
    series = [
        Series(name, data["n_nodes"], data[way], color=color, marker="osD^v"[color])
        for color, (way, (name, _)) in enumerate(WAYS.items())
    ]
    return Diagram("number of nodes", "stored numbers", series, log_y=True, legend_columns=2)


def _counts_table(data: dict[str, Any]) -> Table:
    columns = (
        *(Column("nodes", "n"), Column("members", "k"), Column("actuated", "a")),
        *(Column(name, unit) for name, unit in WAYS.values()),
    )
    keys = ("n_nodes", "n_members", "n_actuated", *WAYS)
    rows = tuple(
        tuple(number_cell(int(data[key][index]), ",d") for key in keys)
        for index in range(len(data["n_nodes"]))
    )
    return Table("Stored numbers a time point.", columns, rows)
