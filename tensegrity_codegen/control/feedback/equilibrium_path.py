"""Paths through equilibria, as arrays."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from tensegrity_codegen.system.summaries import Summarised


@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumPath(Summarised):
    """Equilibria one after the other, from the start to the end of a motion, for `time_motion`.

    Attributes
    ----------
    change : array_like, shape (n_points, n_actuators) [m]
        Values of the actuators' inputs at two points or more, as `simulate` takes them.
    coordinate : array_like, shape (n_points, n_coordinates), optional
        Coordinates of the model at these points; by default they are found, from those of the scene on.
    progress : array_like, shape (n_points,), optional
        From 0 to 1, rising; by default the distance that nodes (without coordinates: inputs) have moved.
    actuators : tuple of str, optional
        Names of the actuators; by default all of the scene.
    """

    change: ArrayLike
    coordinate: ArrayLike | None = None
    progress: ArrayLike | None = None
    actuators: tuple[str, ...] | None = None
