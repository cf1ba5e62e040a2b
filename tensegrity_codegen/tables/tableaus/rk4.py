"""Kutta's classical method of order 4, with fixed steps."""

from tensegrity_codegen.tables.tableaus.tableau import Tableau

TABLEAU = Tableau(
    title="classical Runge-Kutta 4",
    source="W. Kutta, Zeitschrift fuer Mathematik und Physik 46 (1901)",
    order=4,
    rows=({0: 1 / 2}, {1: 1 / 2}, {2: 1.0}, {0: 1 / 6, 1: 1 / 3, 2: 1 / 3, 3: 1 / 6}),
)
