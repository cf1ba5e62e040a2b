"""Tsitouras' pair of orders 5 and 4, whose errors are smaller than those of Dormand and Prince's."""

from __future__ import annotations

from tensegrity_codegen.tables.tableaus.tableau import Tableau

TABLEAU = Tableau(
    title="Tsitouras' Runge-Kutta 5(4)",
    source="Ch. Tsitouras, Computers and Mathematics with Applications 62 (2011) 770",
    order=5,
    rows=(
        {0: 0.161},
        {0: -0.008480655492356989, 1: 0.335480655492357},
        {0: 2.8971530571054935, 1: -6.359448489975075, 2: 4.3622954328695815},
        {0: 5.325864828439257, 1: -11.748883564062828, 2: 7.4955393428898365, 3: -0.09249506636175525},
        {
            0: 5.86145544294642,
            1: -12.92096931784711,
            2: 8.159367898576159,
            3: -0.071584973281401,
            4: -0.028269050394068383,
        },
        {
            0: 0.09646076681806523,
            1: 0.01,
            2: 0.4798896504144996,
            3: 1.379008574103742,
            4: -3.290069515436081,
            5: 2.324710524099774,
        },
    ),
    errors=(
        {
            0: -0.00178001105222577714,
            1: -0.0008164344596567469,
            2: 0.007880878010261995,
            3: -0.1447110071732629,
            4: 0.5823571654525552,
            5: -0.45808210592918697,
            6: 1 / 66,
        },
    ),
    error_order=5,
    dense_order=4,
    dense=(  # the coefficients of s^4 in the polynomials b_i(s) of the paper
        {
            0: -1.0530884977290216,
            1: 0.1017,
            2: 2.490627285651252793,
            3: -16.54810288924490272,
            4: 47.37952196281928122,
            5: -34.87065786149660974,
            6: 2.5,
        },
    ),
    noise_share=0.5,
    vibration_loss=(2.5e-4, 6),
)
