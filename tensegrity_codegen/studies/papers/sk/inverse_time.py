"""Time to form what turns forces of pairs into accelerations (S&K Fig. 2), and to apply it.

pseudo_inverse  pinv of H_delta by singular values, all pairs, (3k, 3k), k = n (n - 1) / 2
dense           D H^-1 D^T as a product of dense arrays
sparse          D H^-1 D^T as a product of sparse arrays
factored        nothing is formed but the n inverse masses: D (H^-1 (D^T f)) when it is applied
"""

import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
from scipy import sparse

METHODS = ("pseudo_inverse", "dense", "sparse", "factored")
LEAST_SECONDS, LEAST_TIMES = 0.05, 9  # of repetitions of one measurement
ASYMPTOTIC = 12  # growth exponents are fitted from this number of nodes on, if three sizes are left


def compare_inverse_times(nodes: Iterable[int] = range(6, 25, 2), seed: int = 0) -> dict[str, Any]:
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
        problem = _Problem(n, seed)
        results = {}
        for method in METHODS:
            make, use = problem.methods()[method]
            made = make()
            form[method].append(_seconds(make))
            apply[method].append(_seconds(partial(use, made)))
            results[method] = use(made)
        found = [results[method] for method in METHODS[1:]]
        differences.append(max(np.abs(a - found[0]).max() for a in found) / np.abs(found[0]).max())
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

    def __init__(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.first, self.second = np.triu_indices(n, 1)
        self.mass, self.force = rng.uniform(0.2, 2.0, n), rng.normal(size=(len(self.first), 3))
        rows = np.arange(len(self.first))
        entries = np.concatenate([np.ones(len(rows)), -np.ones(len(rows))])
        places = (np.concatenate([rows, rows]), np.concatenate([self.first, self.second]))
        self.incidence = sparse.csr_array((entries, places), shape=(len(rows), n))
        self.difference = sparse.csr_array(sparse.kron(self.incidence, sparse.eye_array(3)))
        self.dense_difference = self.difference.toarray()
        share = self.mass[self.first] * self.mass[self.second] / self.mass.sum()
        self.inertia = np.diag(np.repeat(share, 3))

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
    """Return the least time of one call, repeated for LEAST_SECONDS and LEAST_TIMES at least."""
    least, total, count = float("inf"), 0.0, 0
    while count < LEAST_TIMES or total < LEAST_SECONDS:
        started = time.perf_counter()
        call()
        seconds = time.perf_counter() - started
        least, total, count = min(least, seconds), total + seconds, count + 1
    return least


def _exponent(size: np.ndarray, seconds: list[float]) -> float:
    chosen = size >= ASYMPTOTIC
    if chosen.sum() < 3:
        chosen = np.ones(len(size), dtype=bool)
    if chosen.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(size[chosen]), np.log(np.array(seconds)[chosen]), 1)[0])
