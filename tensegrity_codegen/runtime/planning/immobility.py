"""Why targets do not move though no limit is in the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["describe_immobility"]

FloatArray = NDArray[np.float64]

STILL = 1e-4  # of the way, by inputs as large as the longest member: a target that does not move
RANK = 1e-6  # of the largest singular value


def describe_immobility(
    names: Sequence[str], slope: FloatArray, direction: FloatArray, longest: float
) -> str:
    """Return why no change of the inputs moves targets along a direction, to first order.

    Parameters
    ----------
    names : sequence of str
        Names of the components of the targets.
    slope : ndarray, shape (n_targets, n_actuators)
        Derivatives of the targets with respect to the inputs.
    direction : ndarray, shape (n_targets,)
        Changes of the targets that are wanted.
    longest : float [m]
        The longest member.

    Returns
    -------
    str
        The targets that no actuator changes; or how many components the actuators change independently.
    """
    effect = np.abs(slope).sum(axis=1) * longest
    still = effect <= STILL * np.abs(direction)
    if np.any(still & (direction != 0)):
        who = ", ".join(name for name, is_still in zip(names, still, strict=True) if is_still)
        return f"no actuator changes {who} here, to first order: plan another target, or start elsewhere"
    moving = effect > 0
    scaled = slope[moving] / effect[moving, None]
    values = np.linalg.svd(scaled, compute_uv=False) if scaled.size else np.zeros(0)
    rank = int(np.sum(values > RANK * values.max(initial=0.0)))
    total, count = slope.shape
    if rank < total:
        return (
            f"the targets have {total} components ({', '.join(names)}), and the actuators ({count}) change "
            f"only {rank} of them independently here: no change of the rest lengths moves all targets along "
            "their way; use more actuators or fewer targets"
        )
    return (
        "no change of the rest lengths within a step moves the target along its way: use fewer steps "
        "(`steps`), or a nearer target"
    )
