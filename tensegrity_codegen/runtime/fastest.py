"""The fastest vibration of a structure about a state, by power iteration on differences of accelerations."""

from __future__ import annotations

import numpy as np

from tensegrity_codegen.errors import NonFiniteError
from tensegrity_codegen.runtime.motion import Motion

__all__ = ["find_fastest"]

ROUNDS = 12  # of two evaluations; a few percent from below where frequencies lie close together
NEAR = 1e-6  # of the largest coordinate, by which coordinates are moved


def find_fastest(motion: Motion) -> float:
    """Return the largest frequency [rad/s] at the start, root of the norm of da/dq; 0 if not finite."""
    n = len(motion.state) // 2
    q, v = motion.state[:n], motion.state[n:]
    reach = NEAR * (float(np.abs(q).max(initial=0.0)) or 1.0)
    direction = np.random.default_rng(0).standard_normal(n)
    square = 0.0
    for _ in range(ROUNDS):
        size = float(np.linalg.norm(direction))
        if not size > 0.0:
            return 0.0
        moved = reach * direction / size
        try:
            one, other = (
                np.asarray(
                    motion.model.compute("acceleration", coordinate=place, velocity=v, **motion.arguments)
                )
                for place in (q + moved, q - moved)
            )
        except NonFiniteError:
            return 0.0
        direction = (one - other) / (2.0 * reach)
        square = float(np.linalg.norm(direction))
    return float(np.sqrt(square))
