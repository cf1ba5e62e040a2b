"""Time to form the matrix from forces of pairs to accelerations (S&K Fig. 2), and to apply it.

pseudo_inverse  pinv of H_delta by singular values, all pairs, (3k, 3k), k = n (n - 1) / 2
dense           D H^-1 D^T as a product of dense arrays
sparse          D H^-1 D^T as a product of sparse arrays
factored        nothing is formed but the n inverse masses: D (H^-1 (D^T f)) when it is applied
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from tensegrity_codegen.codegen.compilation.child import run_limited
from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Table, make_table
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.files import plain

# Method of the study -> its name here, its name in the paper's legend.
METHODS = {
    "pseudo_inverse": ("pseudo-inverse", "pinv"),
    "dense": ("dense product", "conjugation (dence)"),
    "sparse": ("sparse product", "conjugation (sparce)"),
    "factored": ("factored, ours", "–"),
}
MIN_SECONDS, MIN_TIMES = 0.05, 9  # of repetitions of one measurement
ASYMPTOTIC = 12  # growth exponents are fitted from this number of nodes on, if three sizes are left


def compare_inverse_times(nodes: Iterable[int] = range(6, 25, 2)) -> dict[str, Any]:
    """Return seconds to form and to apply each method for each number of nodes, and growth exponents.

    n_nodes (n_n,); form, apply: method -> seconds (n_n,); form_exponent, apply_exponent: method -> p of
    seconds ~ n^p, fitted over the larger sizes; largest_difference: of the accelerations of the last three
    methods, relative. The pseudo-inverse of H_delta alone is no substitute (docs/errata.md).
    """
    counts = list(nodes)
    form: dict[str, list[float]] = {method: [] for method in METHODS}
    apply: dict[str, list[float]] = {method: [] for method in METHODS}
    differences = []
    for n in counts:
        problem = _Problem(n)
        results = {}
        for method in METHODS:
            make, use = problem.methods()[method]
            made = make()
            form[method].append(_seconds(make))
            apply[method].append(_seconds(partial(use, made)))
            results[method] = use(made)
        solutions = [results[method] for method in tuple(METHODS)[1:]]
        differences.append(
            max(np.abs(a - solutions[0]).max() for a in solutions) / np.abs(solutions[0]).max()
        )
    size = np.array(counts)
    return {
        "n_nodes": size,
        "form": {method: np.array(values) for method, values in form.items()},
        "apply": {method: np.array(values) for method, values in apply.items()},
        "form_exponent": {method: _exponent(size, values) for method, values in form.items()},
        "apply_exponent": {method: _exponent(size, values) for method, values in apply.items()},
        "largest_difference": float(max(differences)),
    }


class _Problem:
    """All pairs of n random masses, in the order uvec321."""

    def __init__(self, n: int) -> None:
        rng = np.random.default_rng(0)
        self.first, self.second = np.triu_indices(n, 1)
        self.mass, self.force = rng.uniform(0.2, 2.0, n), rng.normal(size=(len(self.first), 3))
        rows = np.arange(len(self.first))
        entries = np.concatenate([np.ones(len(rows)), -np.ones(len(rows))])
        places = (np.concatenate([rows, rows]), np.concatenate([self.first, self.second]))
        self.incidence = sparse.csr_array((entries, places), shape=(len(rows), n))
        self.difference = sparse.csr_array(sparse.kron(self.incidence, sparse.eye_array(3)))
        self.dense_difference = self.difference.toarray()
        coupling = self.mass[self.first] * self.mass[self.second] / self.mass.sum()
        self.inertia = np.diag(np.repeat(coupling, 3))

    def methods(self) -> dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]]:
        """Return method -> (what forms it, what applies it to the forces)."""
        flat = self.force.ravel()
        inverse = np.repeat(1.0 / self.mass, 3)
        dense, sparsely = self.dense_difference, self.difference
        diagonal = sparse.csr_array(sparse.diags_array(inverse))
        return {
            "pseudo_inverse": (lambda: np.linalg.pinv(self.inertia), lambda made: made @ flat),
            "dense": (lambda: dense @ np.diag(inverse) @ dense.T, lambda made: made @ flat),
            "sparse": (lambda: sparsely @ diagonal @ sparsely.T, lambda made: made @ flat),
            "factored": (lambda: 1.0 / self.mass, self._apply_factors),
        }

    def _apply_factors(self, inverse_mass: np.ndarray) -> np.ndarray:
        node = (self.incidence.T @ self.force) * inverse_mass[:, None]
        return np.asarray(node[self.first] - node[self.second]).ravel()


def _seconds(call: Callable[[], Any]) -> float:
    """Return the least time of one call, repeated for MIN_SECONDS and MIN_TIMES at least."""
    fastest, total, count = float("inf"), 0.0, 0
    while count < MIN_TIMES or total < MIN_SECONDS:
        started = time.perf_counter()
        call()
        seconds = time.perf_counter() - started
        fastest, total, count = min(fastest, seconds), total + seconds, count + 1
    return fastest


def _exponent(size: np.ndarray, seconds: list[float]) -> float:
    chosen = size >= ASYMPTOTIC
    if chosen.sum() < 3:
        chosen = np.ones(len(size), dtype=bool)
    if chosen.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(size[chosen]), np.log(np.array(seconds)[chosen]), 1)[0])


# Times of forming inverses, measured in a process of its own in which linear algebra has one thread.
#
# Libraries of linear algebra read their number of threads when they are loaded; on small matrices and busy
# machines several threads spoil every measurement. Run as `python -m` with the numbers of nodes as arguments,
# this module prints the times as one line of JSON.


THREAD_VARIABLES = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"),
    *("MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
)
TIME_LIMIT = 600.0  # [s]


class StudyError(TensegrityError):
    """A study of the papers that cannot be carried out."""


def measure_inverse_times(nodes: Iterable[int]) -> dict[str, Any]:
    """Return what `compare_inverse_times` returns, lists for arrays; raises StudyError with the log."""
    command = [sys.executable, "-m", __name__, *(str(int(n)) for n in nodes)]
    done = run_limited(
        command,
        folder=Path.cwd(),
        environment=os.environ | dict.fromkeys(THREAD_VARIABLES, "1"),
        timeout=TIME_LIMIT,
    )
    if not done.ok:
        raise StudyError(
            f"the times of inverses could not be measured: {done.ended} {done.number}\n{done.log.strip()}",
            hint="free the machine of other work, or choose another paper",
        )
    result: dict[str, Any] = json.loads(done.log.strip().splitlines()[-1])
    return result


def inverse_section(nodes: Sequence[int]) -> Section:
    """Return the section with the times of all methods for these numbers of nodes."""
    data = measure_inverse_times(nodes)
    largest = {method: data["form"][method][-1] for method in METHODS}
    ordered = largest["pseudo_inverse"] > largest["dense"] > largest["sparse"]
    same = "the order of the three curves is that of the paper" if ordered else "the curves cross"
    ratio = largest["sparse"] / largest["factored"]
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
    rows = (
        (
            *(name, printed, 1e6 * data["form"][method][-1], data["form_exponent"][method]),
            *(1e6 * data["apply"][method][-1], data["apply_exponent"][method]),
        )
        for method, (name, printed) in METHODS.items()
    )
    return make_table(
        f"Times at n = {largest} and growth: time ~ nᵖ, p fitted from n = 12 on where there are three sizes.",
        {"method": "", "in the paper's legend": ""}
        | dict.fromkeys(("form [µs]", "p [form]", "apply [µs]", "p [apply]"), ".1f"),
        rows,
    )


if __name__ == "__main__":
    sys.stdout.write(json.dumps(compare_inverse_times(map(int, sys.argv[1:])), default=plain) + "\n")
