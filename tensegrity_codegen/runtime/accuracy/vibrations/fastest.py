"""The fastest vibration of a structure about a state, by power iteration on differences of accelerations."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError

ROUNDING = 5e-17  # of positions, in velocities that steps still hold
ROUNDS = 12  # of two evaluations; a few percent from below where frequencies lie close together
NEAR = 1e-6  # of the largest coordinate, by which coordinates are moved


def find_noise(place: FloatArray, frequency: float) -> float:
    """Return what rounding of coordinates that forces depend on makes of velocities [m/s].

    place: these coordinates; frequency: [rad/s].
    """
    return ROUNDING * float(np.abs(place).max(initial=0.0)) * frequency


def find_fastest(motion: Motion) -> float:
    """Return the largest frequency [rad/s] at the start, root of the norm of da/dq; 0 if not finite."""
    n = len(motion.state) // 2
    velocity = motion.state[n:]

    def accelerate(place: FloatArray) -> FloatArray:
        try:
            found = motion.model.compute(
                "acceleration", coordinate=place[0], velocity=velocity, **motion.arguments
            )
        except NonFiniteError:
            return np.full_like(place, np.nan)
        return np.asarray(found)[None, :]

    return float(_iterate(accelerate, motion.state[None, :n], motion.model.manifest.is_centre)[0])


def find_decay(motion: Motion) -> float:
    """Return the largest decay rate [1/s] at the start, the norm of da/dv; 0 if not finite."""
    n = len(motion.state) // 2
    place = motion.state[:n]

    def accelerate(velocity: FloatArray) -> FloatArray:
        try:
            found = motion.model.compute(
                "acceleration", coordinate=place, velocity=velocity[0], **motion.arguments
            )
        except NonFiniteError:
            return np.full_like(velocity, np.nan)
        return np.asarray(found)[None, :]

    none = np.zeros(n, dtype=np.bool_)
    return float(_iterate(accelerate, motion.state[None, n:], none)[0]) ** 2


def find_fastest_of_batch(motion: Motion, threads: int = 1) -> FloatArray:
    """Return what find_fastest says of each motion of a batch, states (n_batch, n_states): (n_batch,)."""
    n = motion.state.shape[1] // 2
    velocity = motion.state[:, n:]

    def accelerate(place: FloatArray) -> FloatArray:
        found, _ = motion.model.compute_batch(
            "acceleration",
            coordinate=place,
            velocity=velocity,
            threads=threads,
            on_error="status",
            **motion.arguments,
        )
        return np.asarray(found)

    return _iterate(accelerate, motion.state[:, :n], motion.model.manifest.is_centre)


def _iterate(
    accelerate: Callable[[FloatArray], FloatArray], place: FloatArray, is_centre: NDArray[np.bool_]
) -> FloatArray:
    """Return roots of the norms of da/dq at places (n_batch, n_coordinates), row by row.

    is_centre (n_coordinates,): those that measure no length of the structure, see Manifest.
    """
    with np.errstate(all="ignore"):  # rows that are not finite come out as 0
        reach = NEAR * np.abs(place[:, ~is_centre]).max(axis=1, initial=0.0, keepdims=True)
        reach[~(reach > 0.0)] = NEAR
        direction = np.tile(np.random.default_rng(0).standard_normal(place.shape[1]), (len(place), 1))
        for _ in range(ROUNDS):
            moved = reach * direction / np.linalg.norm(direction, axis=1, keepdims=True)
            direction = (accelerate(place + moved) - accelerate(place - moved)) / (2.0 * reach)
        square = np.linalg.norm(direction, axis=1)
    return np.sqrt(np.where(np.isfinite(square), square, 0.0))
