"""Each formula of SCS that is wrong in print, measured against the full model of 18 coordinates.

The difference of the printed and of the corrected formula from the equations obtained from the full model,
largest over random symmetrical motions: the first is of the size of the terms, the second is rounding.
"""

import math
from typing import Any

import numpy as np

from tensegrity_codegen.studies.papers.scs.figures import compare_equilibria
from tensegrity_codegen.studies.papers.scs.paper_values import PAPER_POSES
from tensegrity_codegen.studies.papers.scs.printed import PrintedTower
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricTower
from tensegrity_codegen.system.arrays import FloatArray


def check_errata(tower: SymmetricTower, *, samples: int = 50, seed: int = 1) -> list[dict[str, Any]]:
    """Return one row an erratum: name, equation, unit, error_as_printed, error_as_corrected."""
    generator = np.random.default_rng(seed)
    motions = [_draw(generator) for _ in range(samples)]
    checks = (
        ("centrifugal term", "(23), (34)", "N m", _centrifugal),
        ("sin(delta) in the second row of A_r", "(A.4) to (A.6)", "m", _matrix),
        ("height", "(21), (28)", "N m", _height),
    )
    rows = []
    for name, equation, unit, check in checks:
        errors = np.abs([check(tower, *motion) for motion in motions]).max(axis=0)
        rows.append(_row(name, equation, unit, errors[0], errors[1]))
    return [*rows, _rounded_data(tower)]


def _draw(generator: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s, s', s'' with s inside the bounds of SCS 4, and Z' and Z'' too."""
    s = np.array([generator.uniform(0, 6.28), generator.uniform(0.1, 1.4), generator.uniform(1.1, 2.0)])
    return s, generator.normal(size=3), generator.normal(size=3)


def _centrifugal(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return the first entry of e, printed and corrected, less that of the full model, at constant Z."""
    rate, change = rate * (1, 1, 0), change * (1, 1, 0)
    reduced = tower.restricted.balance(s, rate, change).reduced()
    printed = PrintedTower.of(tower)
    entries = [printed.own_force(s, rate, change, 0.0, as_printed=flag)[0] for flag in (True, False)]
    return np.asarray(np.array(entries) - reduced.own_force[1] / 6.0)


def _matrix(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return the largest difference of A_r from that of the full model, printed and corrected."""
    matrix, printed, place = tower.matrix(s[None])[0], PrintedTower.of(tower), [float(x) for x in s]
    both = [printed.matrix(*place, as_printed=flag) - matrix for flag in (True, False)]
    return np.array([np.abs(difference).max() for difference in both])


def _height(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return d/dt(Z' sin(delta)) and Z'' sin(delta), times m l / 2, less what the full model leaves over.

    What is left over is the difference of the equations of delta between the upper and the lower stage.
    """
    own = tower.restricted.balance(s, rate, change).own_force
    names = tower.system.coordinate_name
    lower, upper = (own[names.index(f"bar{stage}_declination")] for stage in ("11", "12"))
    arm, sine = 0.5 * tower.bar.mass * tower.bar.length, math.sin(s[1])
    corrected = arm * sine * change[2]
    printed = corrected + arm * math.cos(s[1]) * rate[1] * rate[2]
    return np.asarray(np.array([printed, corrected]) - (upper - lower))


def _rounded_data(tower: SymmetricTower) -> dict[str, Any]:
    """Return the largest error of the tensions in (44), (45), (52) with printed and with exact data."""
    rows = [row for row in compare_equilibria(tower) if row["unit"] == "N"]
    rows = [row for row in rows if row["equation"] != PAPER_POSES["53"].equation]
    rounded = max(abs(row["with_printed_data"] - row["paper"]) for row in rows)
    return _row(
        "rounded b and Z", "(43) to (45), (52)", "N", rounded, max(abs(r["difference"]) for r in rows)
    )


def _row(name: str, equation: str, unit: str, printed: float, corrected: float) -> dict[str, Any]:
    return {
        "name": name,
        "equation": equation,
        "unit": unit,
        "error_as_printed": float(printed),
        "error_as_corrected": float(corrected),
    }
