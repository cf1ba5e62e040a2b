"""Dormand and Prince's pair of orders 5 and 4."""

from tensegrity_codegen.tables.tableaus.tableau import Tableau

TABLEAU = Tableau(
    title="Dormand and Prince's Runge-Kutta 5(4)",
    source="J. R. Dormand, P. J. Prince, J. Comp. Appl. Math. 6 (1980)",
    order=5,
    rows=(
        {0: 1 / 5},
        {0: 3 / 40, 1: 9 / 40},
        {0: 44 / 45, 1: -56 / 15, 2: 32 / 9},
        {0: 19372 / 6561, 1: -25360 / 2187, 2: 64448 / 6561, 3: -212 / 729},
        {0: 9017 / 3168, 1: -355 / 33, 2: 46732 / 5247, 3: 49 / 176, 4: -5103 / 18656},
        {0: 35 / 384, 2: 500 / 1113, 3: 125 / 192, 4: -2187 / 6784, 5: 11 / 84},
    ),
    errors=({0: 71 / 57600, 2: -71 / 16695, 3: 71 / 1920, 4: -17253 / 339200, 5: 22 / 525, 6: -1 / 40},),
    error_order=5,
    noise_share=0.05,
    vibration_loss=(4e-4, 6),
)
