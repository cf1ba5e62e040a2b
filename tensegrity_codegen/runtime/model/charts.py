"""Angles of bodies and their poles, where the angles lose their meaning."""

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import Manifest

# Sine of the angle to the pole of its chart below which a body's angles are not to be trusted.
NEAR_POLE = 1e-3

# The same, below which a configuration is not looked at.
NEAREST_POLE = 1e-6


def name_charts(manifest: Manifest) -> list[str]:
    """Return the names of the bodies that have angles, in the order of `chart_margin`."""
    names = (name.rpartition("_") for name in manifest.coordinate_name)
    return list(dict.fromkeys(body for body, _, _ in names))


def judge_charts(
    model: Model, time: FloatArray, coordinate: FloatArray, status: str, message: str
) -> tuple[str, str]:
    """Return status "at_pole" where a body comes near the pole of its angles or passes it between samples.

    time (n_t,) [s], coordinate (n_t, n_coordinates): the samples; status, message: what is returned else.
    """
    margin = np.array([model.compute("chart_margin", coordinate=row) for row in coordinate])
    bad = (np.abs(margin) < NEAR_POLE) | (np.sign(margin) != np.sign(margin[0]))
    if not bad.any():
        return status, message
    row = int(np.argmax(bad.any(axis=1)))
    chart = int(np.argmax(bad[row]))
    angles = name_charts(model.manifest)[chart]
    where = f"by t = {time[row]:.6g} s the body {angles!r} has reached the pole of its angles"
    return "at_pole", f"{where} (margin {margin[row, chart]:.3g}): give it another polar_axis"
