"""How near other parameters come to Table 2, and why the printed ones cannot reach its first row.

Without load the configuration is symmetrical: all azimuths alpha and all elevations beta are equal, and the
lengths of the two kinds of springs are functions of these two angles. The first row of Table 2 asks for a
pair of lengths that no alpha, beta have with the printed a and L.
"""

from typing import Any

import numpy as np
from scipy import optimize

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.studies.papers.lin.model import (
    LOADS,
    PRINTED_LENGTH,
    PRINTED_SIDE,
    SPRINGS,
    compile_prism,
)
from tensegrity_codegen.studies.papers.lin.tables import compute_extensions, read_tables, relative_error
from tensegrity_codegen.system.arrays import FloatArray

MM = 1e3
CHANGES: dict[str, dict[str, float]] = {
    "printed": {},
    "a = 0.4129 m": {"side": 0.4129},
    "L = 0.5768 m": {"bar_length": 0.5768},
}


def compare_sensitivity() -> list[dict[str, Any]]:
    """Return, for the printed parameters and two changed ones, how far we are from Tables 1 and 2.

    Rows: name, side a [m], bar_length L [m], largest_difference to Table 2 [mm], mean_error against the
    measurements, and nearest: the least difference [mm] of any symmetrical configuration to the first row.
    """
    printed = read_tables()
    rows = []
    for name, change in CHANGES.items():
        side = change.get("side", PRINTED_SIDE)
        bar_length = change.get("bar_length", PRINTED_LENGTH)
        model = compile_prism(side, bar_length)
        ours = compute_extensions(LOADS, model)
        rows.append(
            {
                "name": name,
                "side": side,
                "bar_length": bar_length,
                "largest_difference": float(np.abs(ours - printed["computed"]).max()),
                "mean_error": float(relative_error(ours, printed["measured"]).mean()),
                "nearest": find_nearest_symmetrical(model)["distance"],
            }
        )
    return rows


def find_nearest_symmetrical(model: CompiledModel | None = None) -> dict[str, float]:
    """Return the symmetrical configuration whose springs are nearest to the first row of Table 2.

    azimuth, elevation [deg]; side, top: extensions there [mm]; distance: the root of the sum of the squares
    of both differences [mm].
    """
    model = model or compile_prism()
    first = read_tables()["computed"][0]
    wanted = np.array([first[3:].mean(), first[:3].mean()])
    kinds = [model.manifest.member_name.index(name) for name in (SPRINGS[3], SPRINGS[0])]

    def difference(angles: FloatArray) -> FloatArray:
        extension = model.compute("member_extension", coordinate=_spread(model, angles))
        return np.asarray(MM * extension[kinds] - wanted)

    starts = [np.array([a, e]) for a in np.linspace(-3, 3, 9) for e in (0.3, 0.8, 1.3)]
    found = min((optimize.least_squares(difference, start, xtol=1e-15) for start in starts), key=_cost)
    side, top = difference(found.x) + wanted
    return {
        "azimuth": float(np.degrees(found.x[0])),
        "elevation": float(np.degrees(found.x[1])),
        "side": float(side),
        "top": float(top),
        "distance": float(np.linalg.norm(difference(found.x))),
    }


def _cost(result: Any) -> float:
    return float(result.cost)


def _spread(model: CompiledModel, angles: FloatArray) -> FloatArray:
    """Return coordinates (6,) in which all bars have these azimuth and elevation [rad]."""
    azimuth, elevation = (float(angle) for angle in angles)
    names = model.manifest.coordinate_name
    return np.array([azimuth if name.endswith("azimuth") else elevation for name in names])
