"""The result of simulating a batch: motions of one structure from many starts or with many parameters."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.trajectory.sampled import SAMPLED, STATE, Sampled
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BatchTrajectory(Sampled):
    """Motions over the same sample times; rows that a motion did not reach are NAN.

    ``batch[k]`` is motion k as a Trajectory, ``len(batch)`` the number of motions.

    Attributes
    ----------
    time : ndarray, shape (n_t,) [s]
        Sample times.
    coordinate, velocity : ndarray, shape (n_batch, n_t, n_coordinates) [m, m/s]
        Free coordinates and their rates.
    node_position, node_velocity : ndarray, shape (n_batch, n_t, n_nodes, 3) [m, m/s]
        Positions and velocities of all nodes.
    member_tension : ndarray, shape (n_batch, n_t, n_members) [N]
        Tensions.
    kinetic_energy, total_energy : ndarray, shape (n_batch, n_t) [J]
        Energies.
    energy_drift : ndarray, shape (n_batch,)
        As of a Trajectory; NAN with damping or a schedule.
    error_estimate : ndarray, shape (n_batch,)
        Estimated error over the tolerance; NAN where the method makes none.
    status, message : tuple of str
        Of each motion: words as of a Trajectory, and ``"non_finite_input"``.
    n_reached, n_steps, n_rejected, n_evaluations : ndarray of int, shape (n_batch,)
        Samples that each motion reached; steps, rejected steps (-1: not known), evaluations.
    step : float or None
        Fixed step [s].
    method : str
        The method.
    node_name, member_name : tuple of str
        Names.
    structure : Structure, BodySystem or None
        What moves; None with a library that was loaded alone.
    internal : ndarray or None, shape (n_batch, n_t, n_internal) [m]
        Internal states, as of a Trajectory.
    internal_name : tuple of str
        Their names.
    """

    energy_drift: FloatArray
    error_estimate: FloatArray
    status: tuple[str, ...]
    message: tuple[str, ...]
    n_reached: NDArray[np.int64]
    n_steps: NDArray[np.int64]
    n_rejected: NDArray[np.int64]
    n_evaluations: NDArray[np.int64]
    step: float | None

    @property
    def is_ok(self) -> NDArray[np.bool_]:
        """Whether each motion came to its end with the status "ok", (n_batch,)."""
        return np.array([status == "ok" for status in self.status])

    def __len__(self) -> int:
        return len(self.status)

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Trajectory:
        reached = slice(0, int(self.n_reached[k]))
        drift, estimate = float(self.energy_drift[k]), float(self.error_estimate[k])
        return Trajectory(
            time=self.time[reached],
            **{name: getattr(self, name)[k, reached] for name in (*STATE, *SAMPLED)},
            energy_drift=None if np.isnan(drift) else drift,
            error_estimate=None if np.isnan(estimate) else estimate,
            status=self.status[k],
            message=self.message[k],
            method=self.method,
            n_steps=int(self.n_steps[k]),
            n_evaluations=int(self.n_evaluations[k]),
            step=self.step,
            node_name=self.node_name,
            member_name=self.member_name,
            structure=self.structure,
            internal=None if self.internal is None else self.internal[k, reached],
            internal_name=self.internal_name,
        )

    def headline(self) -> str:
        """Return how many motions there are, how many reached their end, and whether their error is known."""
        return f"{len(self)} motions, {int(self.is_ok.sum())} ok{self.say_unestimated()}"

    def say_unestimated(self) -> str:
        """Return the words for good motions whose error is not estimated, none where all errors are."""
        unknown = int((self.is_ok & np.isnan(self.error_estimate)).sum())
        return f"; the error of {unknown} is not estimated" if unknown else ""

    def summary(self) -> dict[str, Any]:
        """Return the facts about the runs as one JSON-ready object."""
        return {
            "method": self.method,
            "t_end": float(self.time[-1]),
            "n_samples": len(self.time),
            "n_motions": len(self),
            "n_ok": int(self.is_ok.sum()),
            "statuses": dict(Counter(self.status)),
            "step": self.step,
            "n_steps": int(self.n_steps.sum()),
            "n_evaluations": int(self.n_evaluations.sum()),
            "largest_energy_drift": _largest(self.energy_drift),
            "largest_error_estimate": _largest(self.error_estimate),
            **self.extremes(),
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a result file holds, name -> array, of single motions with one more, leading axis."""
        return {**super().arrays(), "energy_drift": self.energy_drift, "n_reached": self.n_reached}


def _largest(values: FloatArray) -> float | None:
    """Return the largest number, None if all are NAN."""
    largest = float(np.fmax.reduce(values))
    return None if np.isnan(largest) else largest
