"""Steps in trust regions for many small stiffnesses at once, by their eigendecompositions."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.statics.factors import SINGULAR_TOLERANCE
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

MOST_TRIALS = 80  # of the search for a shift, which takes about six
RADIUS_TOLERANCE = 1e-9  # of the radius: how near a step ends to it


@dataclass(frozen=True)
class Steps:
    """Steps (count, n) [m], the energy that each should save [J], whether its radius cut it."""

    vector: FloatArray
    predicted: FloatArray
    at_boundary: BoolArray

    @property
    def length(self) -> FloatArray:
        """Their lengths, (count,) [m]."""
        return np.asarray(np.linalg.norm(self.vector, axis=1))


def find_steps(stiffness: FloatArray, gradient: FloatArray, radius: FloatArray, noise: FloatArray) -> Steps:
    """Return the steps that save most energy within their radii, as `DenseCurvature.find_step` does.

    Parameters
    ----------
    stiffness : (count, n, n) symmetric [N/m].
    gradient : (count, n) [N].
    radius : (count,) [m].
    noise : (count,) [N]: gradients below it along singular directions count as rounding.

    Returns
    -------
    Steps
        One for each case.
    """
    value, vector = np.linalg.eigh(stiffness)
    part = (vector.transpose(0, 2, 1) @ gradient[:, :, None])[:, :, 0]
    threshold = SINGULAR_TOLERANCE * np.abs(value).max(axis=1, initial=0.0)
    part[(np.abs(value) <= threshold[:, None]) & (np.abs(part) <= noise[:, None])] = 0.0
    is_curved = value[:, 0] < -threshold
    is_stiff = ((value > threshold[:, None]) | (part == 0.0)).all(axis=1)
    along = _divide(part, value, value > threshold[:, None])
    inside = ~is_curved & is_stiff & (np.linalg.norm(along, axis=1) <= radius)
    cut = np.flatnonzero(~inside)
    if len(cut):
        along[cut] = _find_cut(value[cut], part[cut], radius[cut], threshold[cut], is_curved[cut])
    predicted = -((part + value * along / 2) * along).sum(axis=1)
    return Steps((vector @ along[:, :, None])[:, :, 0], predicted, ~inside)


def _divide(part: FloatArray, stiff: FloatArray, usable: BoolArray) -> FloatArray:
    """Return -part / stiff, eigenvector by eigenvector; others rest."""
    return np.where(usable, -part / np.where(usable, stiff, 1.0), 0.0)


def _find_cut(
    value: FloatArray, part: FloatArray, radius: FloatArray, threshold: FloatArray, is_curved: BoolArray
) -> FloatArray:
    """Return steps along the eigenvectors that end at the radius, or at the least possible shift."""
    stiff = value + _find_shifts(value, part, radius, threshold)[:, None]
    along = _divide(part, stiff, stiff > 0.0)
    missing = radius**2 - (along**2).sum(axis=1)
    short = is_curved & (missing > 0.01 * radius**2)
    added = np.sqrt(np.where(short, missing, 0.0))
    along[:, 0] += np.copysign(added, -part[:, 0])
    return along


def _find_shifts(
    value: FloatArray, part: FloatArray, radius: FloatArray, threshold: FloatArray
) -> FloatArray:
    """Return the shifts whose steps are as long as the radii, or the least ones where steps are shorter."""
    force = np.linalg.norm(part, axis=1)
    least = np.maximum(0.0, -value[:, 0])
    low = least + np.maximum.reduce([threshold, 1e-12 * least, SINGULAR_TOLERANCE * force / radius])
    high = low + 1.01 * force / radius
    shift: FloatArray = low.copy()
    for trial in range(MOST_TRIALS):
        stiff = value + shift[:, None]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            along = np.where(part != 0.0, part / stiff, 0.0)
            length = np.linalg.norm(along, axis=1)
            slope = (along**2 / stiff).sum(axis=1)
            newton = shift + (length / radius - 1.0) * length**2 / slope
        is_long = length > radius
        is_done = np.abs(length - radius) <= RADIUS_TOLERANCE * radius
        if trial == 0:
            is_least = ~is_long  # the least shift gives a step that is short enough
        if (is_done | is_least).all():
            break
        low, high = np.where(is_long, shift, low), np.where(is_long, high, shift)
        inner = (newton > low) & (newton < high)
        shift = np.asarray(np.where(is_done | is_least, shift, np.where(inner, newton, (low + high) / 2)))
    return shift
