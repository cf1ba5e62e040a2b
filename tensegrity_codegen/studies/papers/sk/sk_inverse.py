"""S&K Fig. 2: the time to form the inverse that turns forces into accelerations."""

from collections.abc import Sequence
from typing import Any

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.studies.papers.sk.inverse_time_process import measure_inverse_times

# Method of the study -> its name here, its name in the paper's legend.
METHODS = {
    "pseudo_inverse": ("pseudo-inverse", "pinv"),
    "dense": ("dense product", "conjugation (dence)"),
    "sparse": ("sparse product", "conjugation (sparce)"),
    "factored": ("factored, ours", "–"),
}


def inverse_section(nodes: Sequence[int]) -> Section:
    """Return the section with the times of all methods for these numbers of nodes."""
    data = measure_inverse_times(nodes)
    last = {method: data["form"][method][-1] for method in METHODS}
    ordered = last["pseudo_inverse"] > last["dense"] > last["sparse"]
    same = "the order of the three curves is that of the paper" if ordered else "the curves cross"
    ratio = last["sparse"] / last["factored"]
    applied = {method: 1e6 * data["apply"][method][-1] for method in METHODS}
    return Section(
        "sk-fig-2",
        "Fig. 2",
        "Time to form the inverse",
        "differs",
        f"{same} at n = {nodes[-1]}; the factored form takes {ratio:.0f} times less to form than the sparse "
        f"product, and {applied['factored']:.0f} µs to apply for {applied['sparse']:.0f} µs",
        (
            Paragraph(
                "All pairs of n nodes are coordinates, so that the matrices have 3n (n − 1)/2 rows. The "
                "paper times the pseudo-inverse of the inertia matrix by singular values and the product "
                "D H⁻¹ Dᵀ of dense and of sparse arrays. Ours keeps the factors: only n inverse masses "
                "are formed, and applying them to the forces of all pairs takes one pass over the pairs."
            ),
            diagram_figure(
                "sk-fig-2-form",
                _diagram(data, "form", "time to form [s]"),
                "Time to form the inverse, one thread. The paper's axis runs from 10⁻⁵ to 10⁻² s on the "
                "authors' machine.",
                "Time to form each inverse against the number of nodes, logarithmic: the pseudo-inverse "
                "is the slowest and grows fastest, the factored form is constant.",
            ),
            diagram_figure(
                "sk-fig-2-apply",
                _diagram(data, "apply", "time to apply [s]"),
                "Time to apply it to the forces of all pairs, through NumPy, not in print. Masses are "
                "constant, so that an inverse is formed once and a motion takes the time to apply it. At "
                "these sizes that of the factored form is mostly the overhead of a few NumPy calls; in "
                "generated C there is none.",
                "Time to apply each inverse against the number of nodes, logarithmic.",
            ),
            _table(data, nodes[-1]),
            Remark(
                "differs",
                "Times are those of another machine and another language, so only order and growth can "
                "be compared. The curve of the pseudo-inverse belongs to a different matrix than the "
                "other two: it inverts H_δ, which alone does not give the accelerations. The three "
                "others give the same accelerations within "
                f"{format_number(data['largest_difference'], '.0e')} (relative).",
                ("sk-pseudo-inverse",),
            ),
        ),
        "paper_wrong",
    )


def _diagram(data: dict[str, Any], kind: str, label: str) -> Diagram:
    """Return the diagram of the times to form or to apply."""
    series = [
        Series(name, data["n_nodes"], data[kind][method], color=color, marker="osD^"[color])
        for color, (method, (name, _)) in enumerate(METHODS.items())
    ]
    return Diagram("number of nodes", label, series, log_y=True, legend_columns=2)


def _table(data: dict[str, Any], largest: int) -> Table:
    """Return the table of times at the largest size and of growth exponents."""
    rows = tuple(
        (
            text_cell(name),
            text_cell(printed),
            number_cell(1e6 * data["form"][method][-1], ".1f"),
            number_cell(data["form_exponent"][method], ".1f"),
            number_cell(1e6 * data["apply"][method][-1], ".1f"),
            number_cell(data["apply_exponent"][method], ".1f"),
        )
        for method, (name, printed) in METHODS.items()
    )
    return Table(
        f"Times at n = {largest} and growth: time ~ nᵖ, p fitted from n = 12 on where there are three sizes.",
        (
            Column("method", numeric=False),
            Column("in the paper's legend", numeric=False),
            Column("form", "µs"),
            Column("p", "form"),
            Column("apply", "µs"),
            Column("p", "apply"),
        ),
        rows,
    )
