"""Errors and unclear points in print, as entries that a page's remarks point to.

The names are those of the headings in docs/errata.md, where each is derived.
"""

from tensegrity_codegen.report.pages.page import Entry

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
        "lin-forces",
        "LIN 1: the generalised forces (8) to (13) drop the offset of the azimuth",
        "Eqs. (8) to (13)",
        "Azimuths count from the outward radius of each anchor, as the lengths of Appendix A need it; "
        "the printed forces leave that angle out. For vertical loads both are the same, for others the "
        "print is wrong.",
    ),
    Entry(
        "lin-columns",
        "LIN 2: the columns of Tables 1 and 2 hold the top springs first",
        "Tables 1 to 3",
        "ΔL₁ to ΔL₆ are the springs B₁B₂, B₃B₁, B₂B₃, A₁B₂, A₃B₁, A₂B₃. Of all 720 orders this one fits "
        "best; the text puts the side springs first.",
    ),
    Entry(
        "lin-parameters",
        "LIN 3: Table 2 does not follow from the printed data",
        "Table 2",
        "Its lengths without load are reached by no symmetrical configuration at all with the printed a "
        "and L; the nearest is 1.39 mm away. With a = 0.4129 m or L = 0.5768 m they are reached, but the "
        "differences still grow with the load, to 1.14 and 0.86 mm.",
    ),
    Entry(
        "lin-maximum",
        "LIN 4: the maximum of the applied force is announced and not given",
        "Sections 1 and 3.2",
        "The interference of bars is to “determine the maximum of the applied force”; no value follows, "
        "and the experiments end at 10 N.",
    ),
    Entry(
        "lin-stiffness",
        "LIN 5: the external force against the spring constants is announced and not given",
        "Abstract",
        "“The evolution of the external force has been researched along with the evolution of the "
        "stiffnesses of the springs”: no formula, table or figure shows it.",
    ),
    Entry(
        "lin-cases",
        "LIN 6: the list of cases of section 3.2 is not complete, and its references are off by two",
        "Section 3.2",
        "The foot of the common normal can also lie beyond the lower end of a bar, and parallel bars "
        "have no common normal.",
    ),
)

SCS = (
    Entry(
        "scs-centrifugal",
        "SCS 1: (23) and the first entry of (34) lack the centrifugal term",
        "Eqs. (23), (34)",
        "The equation of the declination has a further term −J̃ sin δ cos δ α′². It vanishes at rest; in "
        "motion it does not.",
    ),
    Entry(
        "scs-matrix",
        "SCS 2: sin(de), not cos(de), in the second row of the appendix",
        "Eqs. (A.4) to (A.6)",
        "The derivatives of the lengths by the azimuth are proportional to sin δ. At rest the factor "
        "cancels.",
    ),
    Entry(
        "scs-data",
        "SCS 3: the data of the examples are rounded",
        "Eqs. (43), (44), (52)",
        "b = 2/3 m (printed 0.67), Z = 1.1106553 m (printed 1.11) and Z = 1.60504 m (printed 1.6). With "
        "the printed digits the tensions are off by up to 11 %, with these by up to 0.006 N. With Z = "
        "1.11066 m, T_D of (45) is 43.0117 N, printed as 43 N; all others are met within 0.006 N.",
    ),
    Entry(
        "scs-height",
        "SCS 4: (21) and (28) hold only if the height is at rest",
        "Eqs. (21), (28)",
        "What the full model leaves over is Z″ sin δ = 0, not d/dt(Z′ sin δ) = 0: the top may move at "
        "any constant speed.",
    ),
    Entry(
        "scs-derivatives",
        "SCS 5: the terms of (51)",
        "Eq. (51)",
        "α′ δ′ stands where α′² belongs, δ″² where δ′² belongs. (48) is linear in sin δ, so that neither "
        "is needed.",
    ),
)

ERRATA = {"sk": SK, "lin": LIN, "scs": SCS}
