"""What lengths and times a structure has, for weights with consistent units."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

STEP = 1e-6  # of an angle [rad], of a central difference
ZERO = 1e-9  # of the largest squared frequency: below it a motion has no stiffness


@dataclass(frozen=True, eq=False)
class Scales:
    """Lengths and times of a structure.

    Attributes
    ----------
    size : float [m]
        Longest side of the box around the nodes.
    lever : ndarray, shape (n_coordinates,) [m/rad or 1]
        The most that a unit of each coordinate moves a node.
    is_angle : ndarray of bool, shape (n_coordinates,)
        Which coordinates are angles.
    frequency : float [rad/s]
        Lowest natural frequency, without damping; 0 where no motion has stiffness.
    static_gain : ndarray, shape (n_coordinates, n_actuators) [m/m]
        By how much a unit of each actuator's input moves each coordinate at rest, times its lever.
    """

    size: float
    lever: FloatArray
    is_angle: BoolArray
    frequency: float
    static_gain: FloatArray

    def __post_init__(self) -> None:
        freeze_fields(self)


def find_scales(model: CompiledModel, motion: Motion, arguments: Mapping[str, Any]) -> Scales:
    """Return lengths at the start of a motion, and times at its end.

    Parameters
    ----------
    model : CompiledModel
        With `state_jacobian` and `input_jacobian`.
    motion : Motion
        The motion.
    arguments : mapping
        Run-time parameters where they differ from the scene; inputs as one array.

    Returns
    -------
    Scales
        Size, levers, angles, lowest natural frequency, static gain.
    """
    q = motion.coordinate[0]
    n = len(q)
    position = place_nodes(model, q, arguments=_without_input(arguments))
    size = float(np.ptp(position, axis=0).max(initial=0.0))
    is_angle = find_angles(model)
    lever = np.array([_find_lever(model, q, k, arguments) if is_angle[k] else 1.0 for k in range(n)])
    lever[lever < ZERO * size] = size  # a coordinate that moves no node
    end = motion.at(motion.duration)
    at = {**arguments, "coordinate": end.coordinate, "velocity": np.zeros(n), INPUT: end.input}
    stiffness = -model.compute("state_jacobian", **at).toarray()[n:, :n]
    place = [model.manifest.input_name.index(name) for name in motion.actuators]
    push = model.compute("input_jacobian", **at).toarray()[n:, place]
    gain = lever[:, None] * np.linalg.lstsq(stiffness, push, rcond=ZERO)[0]
    return Scales(size, lever, is_angle, _find_frequency(stiffness), gain)


def find_angles(model: CompiledModel) -> BoolArray:
    """Return which coordinates are angles, (n_coordinates,): those of bodies whose name ends in no axis."""
    manifest = model.manifest
    if manifest.coordinate_node_axis:
        return np.zeros(len(manifest.coordinate_name), dtype=bool)
    return np.array([name.rpartition("_")[2] not in ("x", "y", "z") for name in manifest.coordinate_name])


def _find_lever(model: CompiledModel, q: FloatArray, k: int, arguments: Mapping[str, Any]) -> float:
    ends = []
    for step in (STEP, -STEP):
        moved = q.copy()
        moved[k] += step
        ends.append(place_nodes(model, moved, arguments=_without_input(arguments)))
    return float(np.linalg.norm(ends[0] - ends[1], axis=1).max(initial=0.0)) / (2 * STEP)


def _find_frequency(stiffness: FloatArray) -> float:
    """Return the lowest frequency of q'' = -stiffness q [rad/s]."""
    squares = np.linalg.eigvals(stiffness).real
    positive = squares[squares > ZERO * np.abs(squares).max(initial=0.0)]
    return float(np.sqrt(positive.min())) if len(positive) else 0.0


def _without_input(arguments: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in arguments.items() if name != INPUT}
