"""What was found wrong or unclear in print, as entries that a page's remarks point to.

The names are those of the headings in docs/errata.md, where each is derived.
"""

from __future__ import annotations

from tensegrity_codegen.report.page import Entry

__all__ = ["ERRATA", "ERRATA_TITLE"]

ERRATA_TITLE = "Errata: what was found in print"

SK = (
    Entry(
        "sk-pseudo-inverse",
        "S&K 1: the pseudo-inverse of the inertia matrix is not what the accelerations need",
        "Fig. 2, Theorem 3",
        "H_δ is diagonal and regular, so that its pseudo-inverse is its inverse; the accelerations need D "
        "H⁻¹ Dᵀ, the upper left block of the inverse of the saddle matrix. The curve “pinv” times "
        "another matrix than the two “conjugation” curves.",
    ),
    Entry(
        "sk-count",
        "S&K 2: the count n (n + m) of node positions",
        "Section 6, Fig. 4",
        "With n nodes there are 3n coordinates: the linear model in second-order form holds 3n (3n + a) "
        "numbers where it is stored full, a being the number of inputs.",
    ),
    Entry(
        "sk-discrepancy",
        "S&K 3: the discrepancy of 10⁻⁵ is one of step sizes",
        "Fig. 5",
        "Node distances are a linear function of node positions, and Runge-Kutta methods commute with "
        "linear maps. At equal steps the two models differ by rounding alone.",
    ),
    Entry(
        "sk-lemma",
        "S&K 4: Lemma 1 holds for equal masses only",
        "Lemma 1",
        "The null space of D is spanned by [I … I]ᵀ, the rows of J_c by [m₁I … mₙI]. Theorem 3 uses only "
        "J_c H⁻¹ Dᵀ = 0, which holds for any masses.",
    ),
    Entry(
        "sk-blocks",
        "S&K 5: the blocks of the sorted linear model are not diagonal, and B* is not invertible",
        "Section 6",
        "A* consists of full symmetric 3 × 3 blocks, B* of one 3 × 1 block for each input; it has a left "
        "inverse.",
    ),
    Entry(
        "sk-inertia",
        "S&K 6: the inertia has a closed form, which is diagonal",
        "Eq. (4.1)",
        "For point masses H_δ = diag(mᵢ mⱼ / Σm) over all pairs, by Lagrange's identity; the paper does "
        "not solve for it.",
    ),
    Entry(
        "sk-basis",
        "S&K 7: the freedom of the basis",
        "after Eq. (4.1)",
        "The cycles of a spanning tree give a basis with entries −1, 0, +1, three numbers a cycle; the "
        "paper's is orthonormal and dense.",
    ),
    Entry(
        "sk-loads",
        "S&K 8: external forces that act on single nodes",
        "Eq. (3.8)",
        "A load on one node moves the centre of mass and the differences; the print allows for the first "
        "alone.",
    ),
    Entry(
        "sk-rounding",
        "S&K 9: the constraints are kept to rounding, and rounding adds up twice",
        "Eq. (4.2)",
        "Rounding leaves an error in Lᵀδ′ at every step, which time turns into a distance; setting the "
        "closing pairs from the spanning tree after each step removes it.",
    ),
)

LIN = (
    Entry(
        "lin-columns",
        "LIN 1: the columns of the tables hold the top springs first",
        "Tables 1 to 3",
        "ΔL₁ to ΔL₆ are the springs B₁B₂, B₃B₁, B₂B₃, A₁B₂, A₃B₁, A₂B₃; the text puts the side springs "
        "A₁B₂, A₂B₃, A₃B₁ first.",
    ),
    Entry(
        "lin-parameters",
        "LIN 2: Table 2 does not follow from the printed parameters",
        "Table 2",
        "Its lengths without load are reached by no symmetrical configuration at all with the printed a "
        "and L. A side of 0.4129 m or bars of 0.5768 m, within the last printed digits or little more, "
        "reach them.",
    ),
    Entry(
        "lin-forces",
        "LIN 3: the generalised forces (8) to (13) hold for vertical loads only",
        "Eqs. (8) to (13)",
        "αᵢ is measured from the outward radius of Aᵢ, as the lengths of Appendix A need it; the printed "
        "forces leave out that angle, so that their horizontal parts point elsewhere.",
    ),
    Entry(
        "lin-maximum",
        "LIN 4: the maximum load is announced and not given",
        "Sections 1 and 3.2",
        "The interference of bars is to “determine the maximum of the applied force”; no value follows. "
        "The measurements end at 10 N.",
    ),
)

SCS = (
    Entry(
        "scs-centrifugal",
        "SCS 1: (23) and (34) lack the centrifugal term",
        "Eqs. (23), (34)",
        "The equation of the declination has a further term −J̃ sin δ cos δ α′², as the full Lagrangian "
        "of 18 coordinates gives it.",
    ),
    Entry(
        "scs-matrix",
        "SCS 2: the second row of A_r has cos δ in place of sin δ",
        "Eqs. (A.4) to (A.6)",
        "The derivatives of the lengths by the azimuth are proportional to sin δ.",
    ),
    Entry(
        "scs-data",
        "SCS 3: the data of the examples are rounded",
        "Eqs. (43), (44), (52)",
        "b = 2/3 m (printed 0.67), Z = 1.11066 m (printed 1.11) and Z = 1.60504 m (printed 1.6). With "
        "the printed digits the tensions are off by up to 11 %, with these each is met.",
    ),
    Entry(
        "scs-height",
        "SCS 4: (21) holds for the acceleration of the top, not for the derivative of a product",
        "Eqs. (21), (28)",
        "What the full model leaves over is Z″ sin δ = 0; the print has d/dt(Z′ sin δ) = 0. Both give a "
        "constant height from rest.",
    ),
)

ERRATA = {"sk": SK, "lin": LIN, "scs": SCS}
