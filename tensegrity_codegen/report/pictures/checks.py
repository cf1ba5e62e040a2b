"""What a picture demands of the arrays that it draws."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError

LARGEST = 1e30  # whose squares and cubes are far from overflow, in single precision too


def check_array(name: str, value: ArrayLike, shape: tuple[int, ...], over: str) -> NDArray[np.float64]:
    """Return `value` as numbers of `shape` up to LARGEST; `over` says what it runs over.

    Raises InvalidValueError for another shape, NonFiniteError for larger numbers, NaN or an infinity.
    """
    array: NDArray[Any] = np.array(value, dtype=float)
    if array.shape != shape:
        raise InvalidValueError(
            f"{name} has the wrong shape", where=name, given=array.shape, allowed=f"{shape}: {over}"
        )
    is_good = np.abs(array) <= LARGEST
    if not is_good.all():
        wrong = np.argwhere(~is_good)[0]
        inside = f" in sample {wrong[0]}" if over.startswith("samples") else ""
        problem = "too large for a picture" if np.isfinite(array[tuple(wrong)]) else "not finite"
        raise NonFiniteError(
            f"{name} is {problem}{inside}",
            where=name,
            allowed=f"finite numbers of at most {LARGEST:g}",
            hint="see where it was computed",
        )
    return array


def check_tension(
    value: ArrayLike,
    shape: tuple[int, ...],
    structure: Structure,
    over: str,
    name: str = "member_tension",
) -> NDArray[np.float64]:
    """Return member tensions [N] of `shape`, members last; NaN, unknown, in bars and rigid members alone.

    Raises what check_array raises.
    """
    array: NDArray[np.float64] = np.array(value, dtype=float)
    unknown = (
        np.isnan(array) & (structure.is_rigid | structure.is_bar)
        if array.shape == shape
        else np.zeros(1, dtype=bool)
    )
    known = np.where(unknown, 0.0, array) if unknown.any() else array
    check_array(name, known, shape, over)
    return array


def check_trajectory(structure: Structure, trajectory: Trajectory) -> None:
    """Raise InvalidValueError for the trajectory of another structure, NonFiniteError for NaN or Inf."""
    if (trajectory.node_name, trajectory.member_name) != (structure.node_name, structure.member_name):
        raise InvalidValueError(
            "the trajectory belongs to another structure",
            where=structure.name,
            given=f"{len(trajectory.node_name)} nodes and {len(trajectory.member_name)} members",
            allowed=f"the {structure.n_nodes} nodes and {structure.n_members} members of this structure",
            hint="simulate the structure that is shown",
        )
    samples = len(trajectory.time)
    check_array("time", trajectory.time, (samples,), "samples")
    of_nodes = (samples, structure.n_nodes, 3)
    for name in ("node_position", "node_velocity", "node_load"):
        if getattr(trajectory, name) is not None:
            check_array(name, getattr(trajectory, name), of_nodes, "samples, nodes, axes")
    shape = (samples, structure.n_members)
    check_tension(trajectory.member_tension, shape, structure, "samples, members")
    for name in ("kinetic_energy", "total_energy"):
        check_array(name, getattr(trajectory, name), (samples,), "samples")
