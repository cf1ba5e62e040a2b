"""What was found wrong or unclear in print, as entries that a page's remarks point to.

The names are those of the headings in docs/errata.md, where each is derived.
"""

from __future__ import annotations

from tensegrity_codegen.report.page import Entry

__all__ = ["ERRATA", "ERRATA_TITLE"]

ERRATA_TITLE = "Errata: what was found in print"

ERRATA = {
    "sk": (
        Entry(
            "sk-pseudo-inverse",
            "S&K 1: the pseudo-inverse of the inertia matrix is not what the accelerations need",
            "Fig. 2, Theorem 3",
            "Hδ is diagonal and regular, so that its pseudo-inverse is its inverse; the accelerations "
            "need D H⁻¹ Dᵀ, the upper left block of the inverse of the saddle matrix. The curve “pinv” "
            "times another matrix than the two “conjugation” curves.",
        ),
        Entry(
            "sk-count",
            "S&K 2: the count n (n + m) of node positions",
            "Section 6, Fig. 4",
            "With n nodes there are 3n coordinates: the linear model in second-order form holds 3n (3n + "
            "m) numbers where it is stored full. The print counts nodes where coordinates belong; m is "
            "not stated.",
        ),
        Entry(
            "sk-discrepancy",
            "S&K 3: the discrepancy of 10⁻⁵ is one of step sizes",
            "Fig. 5",
            "Node distances are a linear function of node positions, and Runge-Kutta methods commute "
            "with linear maps. At equal steps the two models differ by rounding alone.",
        ),
    ),
}
