"""Shared parts of a simulated motion and a batch of them: arrays over samples, and a file of them."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.trajectory.motion_tables import (
    BODY_VARIABLES,
    build_dataset,
    build_frame,
    write_motion,
)
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.member_limits import MemberFlaws, check_motion, summarise_tensions
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import (
    ByName,
    Fact,
    Summarised,
    count_names,
    describe_range,
    find_row,
)
from tensegrity_codegen.tables.body_places import (
    BodyPlace,
    compute_spins,
    place_bodies,
    show_members,
    show_nodes,
)

STATE = ("coordinate", "velocity")
# What result files hold of every sample, besides its time.
SAMPLED = ("node_position", "node_velocity", "member_tension", "kinetic_energy", "total_energy")
WORDS = ("node_name", "member_name", "status", "message", "method")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Sampled(ByName, Summarised):
    """Motions over sample times; `...` is nothing for one motion and n_batch for many.

    time (n_t,) [s]; coordinate, velocity (..., n_t, n_coordinates); node_position, node_velocity
    (..., n_t, n_nodes, 3); member_tension (..., n_t, n_members) [N]; kinetic_energy, total_energy
    (..., n_t) [J]; status, message: how they went; method: by which they were integrated; node_name,
    member_name; structure: what moves, for pictures and units, None if only a library is known; internal
    (..., n_t, n_internal) and internal_name: internal states, None if there are none; bodies: rigid bodies by
    the nodes that carry them.
    """

    time: FloatArray
    coordinate: FloatArray
    velocity: FloatArray
    node_position: FloatArray
    node_velocity: FloatArray
    member_tension: FloatArray
    kinetic_energy: FloatArray
    total_energy: FloatArray
    status: str | tuple[str, ...]
    message: str | tuple[str, ...]
    method: str
    node_name: tuple[str, ...]
    member_name: tuple[str, ...]
    structure: Structure | BodySystem | None = None
    internal: FloatArray | None = None
    internal_name: tuple[str, ...] = ()
    bodies: tuple[BodyPlace, ...] = ()

    @property
    def body_name(self) -> tuple[str, ...]:
        """Names of the rigid bodies."""
        return tuple(body.name for body in self.bodies)

    @cached_property
    def body_position(self) -> FloatArray | None:
        """Centres of mass, (..., n_t, n_bodies, 3) [m]; None without rigid bodies."""
        return place_bodies(self.bodies, self.node_position)[0] if self.bodies else None

    @cached_property
    def body_axes(self) -> FloatArray | None:
        """Rotation matrices, whose columns are the axes of each frame, (..., n_t, n_bodies, 3, 3)."""
        return place_bodies(self.bodies, self.node_position)[1] if self.bodies else None

    @cached_property
    def body_angular_velocity(self) -> FloatArray | None:
        """Angular velocities in the frame of each body, (..., n_t, n_bodies, 3) [rad/s]."""
        return compute_spins(self.bodies, self.node_position, self.node_velocity) if self.bodies else None

    def velocity_of(self, node: str) -> FloatArray:
        """Return the velocity of a node.

        Parameters
        ----------
        node : str
            Name of the node.

        Returns
        -------
        ndarray, shape (..., 3) [m/s]
            Its velocity at every sample.

        Raises
        ------
        UnknownNameError
            No node has that name; the message has similar ones.
        """
        return self.node_velocity[..., find_row(node, self.node_name, "node"), :]

    def facts(self) -> list[Fact]:
        """Return samples, sizes and ranges, for `repr` and notebooks."""
        members = show_members(self.member_name, self.bodies)
        named = [("bodies", count_names(self.body_name))] if self.bodies else []
        return [
            ("samples", f"{len(self.time)}, t = {describe_range(self.time, 's')}"),
            ("nodes", count_names(show_nodes(self.node_name, self.bodies))),
            ("members", count_names(members)),
            *named,
            ("tension", describe_range(self.member_tension[..., : len(members)], "N")),
            ("kinetic energy", describe_range(self.kinetic_energy, "J")),
            ("method", self.method),
        ]

    def extremes(self) -> dict[str, Any]:
        """Return the largest motions and tensions: JSON-ready, over all samples that were reached.

        Returns ``"largest_displacement"`` [m] of a node, or of the centre of a body, from the first sample,
        ``"displaced_node"`` and ``"displaced_time"`` [s]; the least and the largest ``"cable_tension"`` and
        ``"bar_tension"`` [N]; ``"slack_cables"``, slack at some sample; ``"limits"`` that members
        exceed. Without a structure the first three only.
        """
        names, place = self.node_name, self.node_position
        if self.body_position is not None:  # in place of corners
            shown = show_nodes(names, self.bodies)
            names = (*shown, *self.body_name)
            place = np.concatenate([place[..., : len(shown), :], self.body_position], axis=-2)
        with np.errstate(all="ignore"):  # of motions that blow up
            moved = np.linalg.norm(place - place[..., :1, :, :], axis=-1)
        moved = np.where(np.isfinite(moved), moved, 0.0)
        *_, sample, node = np.unravel_index(int(moved.argmax()), moved.shape)
        data: dict[str, Any] = {
            "largest_displacement": float(moved.max()),
            "displaced_node": names[node],
            "displaced_time": float(self.time[sample]),
        }
        if self.structure is not None:
            data |= summarise_tensions(self.structure, self.member_tension)
            data["limits"] = self.find_flaws().as_evidence()
        return data

    def find_flaws(self) -> MemberFlaws:
        """Return the limits that members exceed at some sample; none if only a library is known."""
        if self.structure is None:
            return MemberFlaws((), ())
        return check_motion(self.structure, self.member_tension, self.node_position)

    def to_pandas(self) -> Any:
        """Return the motion as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            A row for each sample, with the time [s] as its index (of a batch: the number of the motion, and
            the time); columns named with their units, such as ``"t1.x [m]"``, ``"t1.vx [m/s]"``,
            ``"bar1.tension [N]"``.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        return build_frame(self)

    def to_xarray(self) -> Any:
        """Return the motion as arrays of xarray with named axes.

        Returns
        -------
        xarray.Dataset
            Over ``time``, ``node``, ``axis`` and ``member``, of a batch over ``motion`` too; units are
            attributes.

        Raises
        ------
        MissingExtraError
            xarray is not installed.
        """
        return build_dataset(self)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of a result file by name."""
        arrays = {"time": self.time, **{name: getattr(self, name) for name in SAMPLED}}
        arrays |= {name: np.array(getattr(self, name)) for name in WORDS}
        if self.internal is not None:
            arrays |= {"internal": self.internal, "internal_name": np.array(self.internal_name)}
        if self.bodies:
            arrays |= {name: np.array(getattr(self, name)) for name in ("body_name", *BODY_VARIABLES)}
        return arrays

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the motion to a file, whole or not at all.

        path: ``.npz`` or ``.mat``: all arrays with their names; ``.csv`` or ``.parquet``: a row for each
            sample, with the columns of `to_pandas`. A name without ending is an ``.npz`` file.
        overwrite: whether a file that exists is replaced.
        Raises OutputError: the file cannot be written, exists already, or has another ending;
        MissingExtraError: the ending is ``.parquet`` and pyarrow is not installed.
        """
        write_motion(self, path, overwrite=overwrite)
