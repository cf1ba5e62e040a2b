"""Arrays of one step of an environment, of which rewards and terminations are functions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.system.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class EnvironmentStep:
    """One step of all copies of an environment, of which rewards and terminations are functions.

    Attributes
    ----------
    time : ndarray, shape (n,) [s]
        Since the reset of each copy, at the end of the step.
    sample : float [s]
        Length of the step.
    start, before, after : ndarray, shape (n, 3) [m]
        Centre of mass at the reset, before the step, and after it.
    observation, action : ndarray, shape (n, n_observation), (n, n_actions)
        What is seen after the step; the actions, as given.
    command, last_command : ndarray, shape (n, n_actions)
        Commands of this step and of the one before: values of inputs.
    work : ndarray, shape (n,) [J]
        Work of all inputs that change rest lengths, positive where they pull.
    values : mapping of str to ndarray, shape (n, ...)
        Quantities after the step, ``"node_position"``, ``"node_velocity"`` and ``"member_tension"`` among
        them; the next step overwrites these arrays.
    """

    time: FloatArray
    sample: float
    start: FloatArray
    before: FloatArray
    after: FloatArray
    observation: FloatArray
    action: FloatArray
    command: FloatArray
    last_command: FloatArray
    work: FloatArray
    values: Mapping[str, FloatArray]

    def progress(self, direction: ArrayLike = (1.0, 0.0, 0.0)) -> FloatArray:
        """Return the way of the centre of mass along a direction (3,), times its length, (n,) [m]."""
        return np.asarray((self.after - self.before) @ to_sized(direction, (3,), "direction"))

    def effort(self) -> FloatArray:
        """Return the work of inputs where they pull, else 0, (n,) [J]."""
        return np.maximum(self.work, 0.0)

    def is_outside(
        self, height: float = -np.inf, distance: float = np.inf, tension: float = np.inf
    ) -> BoolArray:
        """Return which copies have left a limit, (n,).

        height [m]: least z of the centre of mass, as of what has not fallen; distance [m]: largest horizontal
        way of it from the start; tension [N]: largest tension or compression of a member.
        """
        way = np.linalg.norm((self.after - self.start)[:, :2], axis=1)
        load = np.abs(self.values["member_tension"]).max(axis=1, initial=0.0)
        return np.asarray((self.after[:, 2] < height) | (way > distance) | (load > tension))
