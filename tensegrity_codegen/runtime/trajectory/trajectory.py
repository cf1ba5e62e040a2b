"""The result of a simulation: states at sample times, tensions, energies, and how it went."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.contacts.rest_memory import name_plastic
from tensegrity_codegen.runtime.integrate.event_log import EMPTY_LOG, EventLog
from tensegrity_codegen.runtime.trajectory.sampled import SAMPLED, STATE, Sampled
from tensegrity_codegen.structure.ground import ENERGY_STATES, Ground
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import Fact, count_names, describe_number
from tensegrity_codegen.tables.manifest import VISCOUS_WORK


@dataclass(frozen=True)
class Foot:
    """A node that touched the ground; forces and penetration are those of the samples."""

    node: str  # its name
    first_touch: float  # [s]
    touches: int  # how often it touched, that at the start included
    slide: float  # [m], way of its lowest point along the ground between samples at which it touched
    largest_force: float  # [N], normal
    largest_use: float  # largest friction over friction that is possible, F / (mu N); 0 without friction
    penetration: float  # [m], the largest

    def as_dict(self) -> dict[str, Any]:
        """Return all by name, JSON-ready."""
        return asdict(self)


@dataclass(frozen=True)
class ContactSamples:
    """Contacts with the ground at the samples of a motion."""

    time: FloatArray  # (n_t,) [s]
    node: tuple[str, ...]  # names of the contacts
    position: FloatArray  # (n_t, n_contacts, 3) [m]
    force: FloatArray  # (n_t, n_contacts, 3) [N]
    penetration: FloatArray  # (n_t, n_contacts) [m]
    friction: FloatArray | None = None  # coefficients (n_t,), None: that of the ground


def find_feet(
    samples: ContactSamples, ground: Ground, log: EventLog, turning: FloatArray
) -> tuple[Foot, ...]:
    """Return the contacts that touched, by events or else samples, those with the largest force first.

    turning (n_t, n_contacts, 3) [m/s]: velocity of the lowest point of each ball relative to its centre.
    """
    # Forces, their use of friction, and ways along the ground relative to a belt.
    normal = samples.force @ ground.normal
    tangential = np.linalg.norm(samples.force - normal[..., None] * ground.normal, axis=2)
    limit = (ground.friction if samples.friction is None else samples.friction[:, None]) * normal
    use = np.divide(tangential, limit, out=np.zeros_like(limit), where=limit > 0)
    mean = (turning[1:] + turning[:-1]) / 2.0 - ground.velocity
    moved = np.diff(samples.position, axis=0) + np.diff(samples.time)[:, None, None] * mean
    along = np.linalg.norm(moved - (moved @ ground.normal)[..., None] * ground.normal, axis=2)
    closed = samples.penetration > 0
    slide = np.where(closed[1:] & closed[:-1], along, 0.0).sum(axis=0)
    # First touch and number of touches, by events or by samples.
    feet = []
    for k, node in enumerate(samples.node):
        begun = [0.0] if closed[0, k] else []
        begun += [
            float(time)
            for time, kind, name, sign in zip(log.time, log.kind, log.name, log.direction, strict=True)
            if (kind, name, sign) == ("ground", node, 1)
        ]
        if not begun and closed[:, k].any():
            begun = samples.time[1:][closed[1:, k] & ~closed[:-1, k]].tolist()
        if begun:
            feet.append(
                Foot(
                    node=node,
                    first_touch=begun[0],
                    touches=len(begun),
                    slide=float(slide[k]),
                    largest_force=float(normal[:, k].max()),
                    largest_use=float(use[:, k].max()),
                    penetration=float(max(samples.penetration[:, k].max(), 0.0)),
                )
            )
    return tuple(sorted(feet, key=lambda foot: -foot.largest_force))


@dataclass(frozen=True)
class MotionEvent:
    """The event that has ended a motion."""

    kind: str  # "contact" or "condition"
    names: tuple[str, ...]  # pairs of bars that touch at once, as by symmetry, or the condition
    time: float  # [s]
    margin: float  # distance of these bars [m], negative where the motion started with an overlap
    coordinate: FloatArray  # (n_coordinates,), the state there
    velocity: FloatArray  # (n_coordinates,)

    def as_dict(self) -> dict[str, Any]:
        """Return the event as one JSON-ready object, without the state."""
        return {"kind": self.kind, "names": self.names, "time": self.time, "margin": self.margin}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Trajectory(Sampled):
    """A simulated motion; arrays run over the sample times that were reached.

    Attributes
    ----------
    time : ndarray, shape (n_t,) [s]
        Sample times.
    coordinate, velocity : ndarray, shape (n_t, n_coordinates) [m, m/s]
        Free coordinates and their rates.
    node_position, node_velocity : ndarray, shape (n_t, n_nodes, 3) [m, m/s]
        Positions and velocities of all nodes.
    member_tension : ndarray, shape (n_t, n_members) [N]
        Tensions.
    kinetic_energy, total_energy : ndarray, shape (n_t,) [J]
        Energies.
    status : str
        ``"ok"``, ``"unstable"``, ``"inaccurate"``, ``"not_converged"``, ``"too_many_events"`` or
        ``"at_pole"``.
    message : str
        A sentence with the reason.
    method, why_method : str
        The method, and why `auto` chose it.
    energy_drift : float or None
        Largest change of total energy over the largest kinetic energy; None with damping or a schedule.
    n_steps, n_evaluations : int
        Numbers of steps and of evaluations of the equations of motion.
    step : float or None
        Fixed step [s].
    error_estimate : float or None
        Estimated error over the tolerance; with contacts, or members and rings with memory, of adaptive
        methods in C, at least 0.05.
    events : tuple of MotionEvent
        The event that ended the motion, at the last sample.
    log : EventLog
        Events at which steps ended, such as cables that went slack or taut.
    evidence : mapping of str to float
        Counts and error bounds of the method; `stopped_at` [s]: where a run stopped short of its end; `atol`
        [m], `atol_speed` [m/s]: the absolute tolerances that the estimated error keeps to.
    node_name, member_name : tuple of str
        Names.
    input : ndarray or None, shape (n_t, n_inputs) [m, N or N m]
        Values of the inputs; None without inputs, and for motions of a batch.
    input_name : tuple of str
        Their names.
    node_load : ndarray or None, shape (n_t, n_nodes, 3) [N]
        Loads on nodes, without inputs, where they can change at run time; None: those of the scene.
    internal : ndarray or None, shape (n_t, n_internal) [m]
        Internal states, such as the deflections of contacts with friction; None without any.
    internal_name : tuple of str
        Their names.
    contacts : ContactSamples or None
        Forces of the ground and penetrations at the samples; None without contacts, or where the library does
        not compute them.
    columns : ndarray or None, shape (n_t, n_states + n_internal, n_columns)
        Derivatives of coordinates, velocities and internal states, through events, to the numbers that the
        library was built to differentiate to (`ModelRequest.columns`); None without any. The evidence
        `column_error` estimates their largest error over the largest derivative to the same number.
    column_name : tuple of str
        Names of these numbers, such as ``"ground.friction"``.
    structure : Structure, BodySystem or None
        What moves, for pictures and units; None in motions of a library that was loaded alone.
    bodies : tuple of BodyPlace
        Rigid bodies by the nodes that carry them.

    Notes
    -----
    With rigid bodies `body_name`, `body_position` (n_t, n_bodies, 3) [m], `body_axes` (n_t, n_bodies, 3, 3)
    with the axes of each frame as columns, `body_angular_velocity` (n_t, n_bodies, 3) [rad/s] in the frame.
    `position`, `velocity_of` and `tension` take the name of a node or member.
    """

    status: str
    message: str
    energy_drift: float | None = None
    n_steps: int = 0
    n_evaluations: int = 0
    step: float | None = None
    error_estimate: float | None = None
    events: tuple[MotionEvent, ...] = ()
    log: EventLog = EMPTY_LOG
    evidence: Mapping[str, float] = field(default_factory=dict)
    why_method: str = ""
    input: FloatArray | None = None
    input_name: tuple[str, ...] = ()
    node_load: FloatArray | None = None
    contacts: ContactSamples | None = None
    columns: FloatArray | None = None
    column_name: tuple[str, ...] = ()

    @property
    def feet(self) -> tuple[Foot, ...]:
        """Contacts with the ground that touched, those with the largest force first."""
        ground = None if self.structure is None else self.structure.ground
        if self.contacts is None or ground is None:
            return ()
        turning, axes, spin = (
            np.zeros_like(self.contacts.position),
            self.body_axes,
            self.body_angular_velocity,
        )
        for k, body in enumerate(self.bodies):
            if axes is not None and spin is not None:
                rows = np.flatnonzero(np.isin(ground.node, body.point))
                rate = np.cross(np.einsum("tij,tj->ti", axes[:, k], spin[:, k]), -ground.normal)
                turning[:, rows] = ground.radius[rows, None] * rate[:, None]
        return find_feet(self.contacts, ground, self.log, turning)

    @property
    def work(self) -> dict[str, float]:
        """What has changed the total energy, by ENERGY_STATES and of viscous members [J]; empty without."""
        if self.internal is None:
            return {}
        change = (self.internal[-1] - self.internal[0]).tolist()
        named = zip(self.internal_name, change, strict=True)
        return {name: value for name, value in named if name in (*ENERGY_STATES, VISCOUS_WORK)}

    @property
    def plastic_elongation(self) -> dict[str, float]:
        """Plastic elongations of members at the last sample, by name [m]; empty if none is plastic."""
        return name_plastic(self.internal_name, None if self.internal is None else self.internal[-1])

    def headline(self) -> str:
        """Return status and reason."""
        return f"{self.status}, {self.message}" if self.message else self.status

    def facts(self) -> list[Fact]:
        """Return samples, sizes and ranges, for `repr` and notebooks."""
        inputs = [("inputs", count_names(self.input_name))] if self.input_name else []
        drift = [("energy drift", describe_number(self.energy_drift))]
        return [*super().facts(), ("steps", str(self.n_steps)), *drift, *inputs]

    def summary(self) -> dict[str, Any]:
        """Return the facts about the run as one JSON-ready object."""
        return {
            "status": self.status,
            "message": self.message,
            "method": self.method,
            "why_method": self.why_method,
            "t_end": float(self.time[-1]),
            "n_samples": len(self.time),
            "n_steps": self.n_steps,
            "n_evaluations": self.n_evaluations,
            "step": self.step,
            "error_estimate": self.error_estimate,
            "evidence": dict(self.evidence),
            "total_energy_start": float(self.total_energy[0]),
            "total_energy_end": float(self.total_energy[-1]),
            "energy_drift": self.energy_drift,
            "largest_kinetic_energy": float(np.max(self.kinetic_energy)),
            **self.work,
            "events": [event.as_dict() for event in self.events],
            "n_events": self.log.count,
            **({} if self.contacts is None else {"feet": [foot.as_dict() for foot in self.feet]}),
            **({"plastic_elongation": self.plastic_elongation} if self.plastic_elongation else {}),
            **self.extremes(),
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of a result file by name; event_*: a row for each name of each event."""
        inputs = {} if self.input is None else {"input": self.input, "input_name": np.array(self.input_name)}
        loads = {} if self.node_load is None else {"node_load": self.node_load}
        contacts = {}
        if self.contacts is not None:
            contacts = {
                "contact_name": np.array(self.contacts.node),
                "contact_force": self.contacts.force,
                "penetration": self.contacts.penetration,
            }
        columns = {}
        if self.columns is not None:
            columns = {"columns": self.columns, "column_name": np.array(self.column_name)}
        rows = [(event.time, event.kind, name) for event in self.events for name in event.names]
        return {
            **super().arrays(),
            "event_time": np.array([row[0] for row in rows], dtype=np.float64),
            "event_kind": np.array([row[1] for row in rows], dtype=np.str_),
            "event_name": np.array([row[2] for row in rows], dtype=np.str_),
            **self.log.arrays(),
            **inputs,
            **loads,
            **contacts,
            **columns,
        }


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
        Estimated error over the tolerance; NAN if the method makes none.
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
    bodies : tuple of BodyPlace
        Rigid bodies, as of a Trajectory.
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
        estimate = float(self.error_estimate[k])
        return self.motion(k, error_estimate=None if np.isnan(estimate) else estimate)

    def motion(self, k: int, **besides: Any) -> Trajectory:
        """Return motion k with what a batch does not have of it."""
        reached = slice(0, int(self.n_reached[k]))
        drift = float(self.energy_drift[k])
        return Trajectory(
            time=self.time[reached],
            **{name: getattr(self, name)[k, reached] for name in (*STATE, *SAMPLED)},
            energy_drift=None if np.isnan(drift) else drift,
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
            bodies=self.bodies,
            **besides,
        )

    def headline(self) -> str:
        """Return how many motions there are, how many reached their end, and whether their error is known."""
        return f"{len(self)} motions, {int(self.is_ok.sum())} ok{self.say_unestimated()}"

    def say_unestimated(self) -> str:
        """Return the words for good motions whose error is not estimated, none if all errors are."""
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
        """Return the arrays of a result file by name, of single motions with one more, leading axis."""
        return {**super().arrays(), "energy_drift": self.energy_drift, "n_reached": self.n_reached}


def _largest(values: FloatArray) -> float | None:
    """Return the largest number, None if all are NAN."""
    largest = float(np.fmax.reduce(values))
    return None if np.isnan(largest) else largest
