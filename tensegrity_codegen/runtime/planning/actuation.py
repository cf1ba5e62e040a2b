"""The actuators of a plan: which inputs of the model they are, and how far and how fast they move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import InvalidValueError, StructureError, UnknownNameError, suggest
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.actuators import Actuator

__all__ = ["Actuation", "find_actuation"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Actuation:
    """The actuators that a plan moves.

    Attributes
    ----------
    actuators : tuple of Actuator
        With names, members, rates and ranges.
    place : ndarray of int, shape (n_actuators,)
        Indices of their inputs.
    rest_length : ndarray, shape (n_actuators,) [m]
        Rest length of the first member of each in the scene.
    least_change, most_change : ndarray, shape (n_actuators,) [m]
        Bounds of their inputs, from the ranges of rest lengths.
    rate : ndarray, shape (n_actuators,) [m/s]
        Largest rates.
    """

    actuators: tuple[Actuator, ...]
    place: NDArray[np.int64]
    rest_length: FloatArray
    least_change: FloatArray
    most_change: FloatArray
    rate: FloatArray

    @property
    def members(self) -> dict[str, tuple[int, ...]]:
        """Indices of the members of each actuator."""
        return {actuator.name: actuator.members for actuator in self.actuators}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the actuators."""
        return tuple(actuator.name for actuator in self.actuators)


def find_actuation(model: CompiledModel, names: Sequence[str] | None = None) -> Actuation:
    """Return the actuators of a model that a plan moves.

    Parameters
    ----------
    model : CompiledModel
        With its structure.
    names : sequence of str, optional
        Names of some of its actuators; by default all.

    Returns
    -------
    Actuation
        Their inputs, ranges and rates.

    Raises
    ------
    StructureError
        The structure has no actuators.
    UnknownNameError, InvalidValueError
        An unknown actuator, or one named twice.
    """
    structure, scene = model.structure, model.manifest.name
    known = () if structure is None else structure.actuators
    if structure is None or not known:
        raise StructureError(
            "no actuators",
            where=f"{scene}: actuators",
            given="none",
            allowed="at least one table [[actuators]] with a name and members",
            hint="add [[actuators]] to the scene, or let each cable have one: `actuate=cables`",
        )
    by_name = {actuator.name: actuator for actuator in known}
    wanted = list(by_name) if names is None else list(names)
    for name in wanted:
        if name not in by_name:
            raise UnknownNameError(
                "unknown actuator",
                where="actuators",
                given=name,
                allowed=", ".join(by_name),
                hint=suggest(name, by_name),
            )
        if wanted.count(name) > 1:
            raise InvalidValueError(
                "an actuator is named twice", where="actuators", given=name, allowed="each actuator once"
            )
    chosen = tuple(by_name[name] for name in wanted)
    rest = [np.array([structure.rest_length[e] for e in item.members]) for item in chosen]
    return Actuation(
        chosen,
        np.array([model.manifest.input_name.index(item.name) for item in chosen], dtype=np.int64),
        np.array([lengths[0] for lengths in rest]),
        np.array([item.range[0] - lengths.min() for item, lengths in zip(chosen, rest, strict=True)]),
        np.array([item.range[1] - lengths.max() for item, lengths in zip(chosen, rest, strict=True)]),
        np.array([item.rate for item in chosen]),
    )
