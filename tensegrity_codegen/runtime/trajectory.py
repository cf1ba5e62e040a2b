"""The result of a simulation: states at sample times, tensions, energies, and how it went."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import NonFiniteError, SceneSyntaxError, StructureError
from tensegrity_codegen.files import replaced
from tensegrity_codegen.runtime.balance import balance_energy
from tensegrity_codegen.runtime.charts import NEAR_POLE, name_charts
from tensegrity_codegen.runtime.event_log import EMPTY_LOG, EventLog
from tensegrity_codegen.runtime.interface import Model
from tensegrity_codegen.runtime.motion import Schedule
from tensegrity_codegen.runtime.own_tension import put_own_tensions
from tensegrity_codegen.runtime.placement import NODE_QUANTITIES, place_motion
from tensegrity_codegen.structure import Structure

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.motion_events import MotionEvent

__all__ = [
    "SIMULATION_QUANTITIES",
    "UNREADABLE",
    "RawTrajectory",
    "Trajectory",
    "evaluate_trajectory",
    "judge_charts",
    "read_arrays",
    "read_trajectory",
    "simulation_quantities",
    "write_arrays",
]

FloatArray = NDArray[np.float64]

# What a simulation needs of a model, and the integrators it may use.
SIMULATION_QUANTITIES = ("acceleration", "member_tension", "kinetic_energy", "total_energy")

# Formulations whose coordinates are node coordinates.
IN_NODE_COORDINATES = ("node_position", "rigid_bar")

# Bytes of the arrays of a result file that are compressed: zlib takes about 1 s for 20 MB of them.
MOST_COMPRESSED = 64 * 2**20

# The numeric arrays of a result file.
RESULT_ARRAYS = (
    "time",
    "node_position",
    "node_velocity",
    "member_tension",
    "kinetic_energy",
    "total_energy",
)

# What NumPy and zipfile raise for damaged files: bad headers, lengths, checksums, methods, single arrays.
UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    EOFError,
    AttributeError,
    TypeError,
    RuntimeError,
    MemoryError,
    BadZipFile,
    zlib.error,
)


@dataclass(frozen=True)
class RawTrajectory:
    """What an integrator returns: samples (n_t, n_states) that it reached, and how it ended.

    tension (n_t, len(tension_member)) [N]: of members whose tension is an unknown of its own; evidence: what
    the method counted; why: why this method, where it was chosen.
    """

    time: FloatArray
    state: FloatArray
    status: str
    message: str
    method: str
    n_steps: int
    n_evaluations: int
    step: float | None = None
    error_estimate: float | None = None
    log: EventLog = EMPTY_LOG
    tension: FloatArray | None = None
    tension_member: tuple[int, ...] = ()
    evidence: Mapping[str, float] = field(default_factory=dict)
    why: str = ""


@dataclass(frozen=True)
class Trajectory:
    """A simulated motion; arrays run over the sample times that were reached.

    time (n_t,) [s]; coordinate, velocity (n_t, n_coordinates); node_position, node_velocity
    (n_t, n_nodes, 3); member_tension (n_t, n_members) [N]; kinetic_energy, total_energy (n_t,) [J];
    energy_drift: largest change of the total energy over the largest kinetic energy, None with damping or a
    schedule, which change energy rightly. status: "ok", "unstable", "inaccurate", "not_converged",
    "too_many_events" or "at_pole" (a body of which the angles lost their meaning); message says why.
    events: what ended the motion before its time, at the last sample; log: events at which steps were cut,
    such as cables that went slack or taut; evidence: what the method counted and found out; why_method: why
    `auto` took this method; none of them is read back from a file.
    """

    time: FloatArray
    coordinate: FloatArray
    velocity: FloatArray
    node_position: FloatArray
    node_velocity: FloatArray
    member_tension: FloatArray
    kinetic_energy: FloatArray
    total_energy: FloatArray
    status: str
    message: str
    method: str
    node_name: tuple[str, ...]
    member_name: tuple[str, ...]
    energy_drift: float | None = None
    n_steps: int = 0
    n_evaluations: int = 0
    step: float | None = None
    error_estimate: float | None = None
    events: tuple[MotionEvent, ...] = ()
    log: EventLog = EMPTY_LOG
    evidence: Mapping[str, float] = field(default_factory=dict)
    why_method: str = ""

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
            "events": [event.as_dict() for event in self.events],
            "n_events": self.log.count,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a result file holds, name -> array; event_*: a row for each name of each event."""
        rows = [(event.time, event.kind, name) for event in self.events for name in event.names]
        return {
            "time": self.time,
            "node_position": self.node_position,
            "node_velocity": self.node_velocity,
            "member_tension": self.member_tension,
            "kinetic_energy": self.kinetic_energy,
            "total_energy": self.total_energy,
            "node_name": np.array(self.node_name),
            "member_name": np.array(self.member_name),
            "status": np.array(self.status),
            "message": np.array(self.message),
            "method": np.array(self.method),
            "event_time": np.array([row[0] for row in rows], dtype=np.float64),
            "event_kind": np.array([row[1] for row in rows], dtype=np.str_),
            "event_name": np.array([row[2] for row in rows], dtype=np.str_),
            **self.log.arrays(),
        }

    def write(self, path: str | Path) -> None:
        """Write the arrays to an .npz file, whole or not at all; OutputError if it cannot be written."""
        write_arrays(path, self.arrays())


def write_arrays(path: str | Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to an .npz file, whole or not at all; raises OutputError if it cannot be written.

    Above MOST_COMPRESSED bytes they are not compressed, which would take longer than the simulation.
    """
    given: dict[str, Any] = dict(arrays)
    size = sum(np.asarray(array).nbytes for array in given.values())
    save = np.savez_compressed if size <= MOST_COMPRESSED else np.savez
    with replaced(path) as temporary, temporary.open("wb") as file:
        save(file, **given)


def simulation_quantities(formulation: str) -> tuple[str, ...]:
    """Return what a simulation needs of a model in this formulation."""
    more = () if formulation in IN_NODE_COORDINATES else NODE_QUANTITIES
    own = {"bodies": ("chart_margin", "energy_rate"), "rigid_bar": ("energy_rate", "rigidity_error")}
    return (*SIMULATION_QUANTITIES, *more, *own.get(formulation, ()))


def evaluate_trajectory(
    model: Model, raw: RawTrajectory, arguments: Mapping[str, Any], schedule: Schedule | None = None
) -> Trajectory:
    """Return the trajectory with tensions and energies, its status corrected by the energy balance.

    schedule: arguments that change with time; these do work, so the energy balance says nothing then.
    """
    raw, columns = _evaluate_samples(model, raw, arguments, schedule)
    n = raw.state.shape[1] // 2
    q, v = raw.state[:, :n], raw.state[:, n:]
    drift, status, message = None, raw.status, raw.message
    if schedule is None:
        drift, status, message = _judge_energy(
            model, raw, columns["kinetic_energy"], columns["total_energy"], arguments
        )
    if model.has("chart_margin"):
        status, message = judge_charts(model, raw.time, q, status, message)
    manifest = model.manifest
    position, rate = place_motion(model, q, v, arguments)
    return Trajectory(
        time=raw.time,
        coordinate=q,
        velocity=v,
        node_position=position,
        node_velocity=rate,
        member_tension=columns["member_tension"],
        kinetic_energy=columns["kinetic_energy"],
        total_energy=columns["total_energy"],
        energy_drift=drift,
        status=status,
        message=message,
        method=raw.method,
        n_steps=raw.n_steps,
        n_evaluations=raw.n_evaluations,
        step=raw.step,
        error_estimate=raw.error_estimate,
        log=raw.log,
        evidence=raw.evidence,
        why_method=raw.why,
        node_name=manifest.node_name,
        member_name=manifest.member_name,
    )


def _evaluate_samples(
    model: Model, raw: RawTrajectory, arguments: Mapping[str, Any], schedule: Schedule | None
) -> tuple[RawTrajectory, dict[str, FloatArray]]:
    """Return the samples with finite tensions and energies, and these; raises NonFiniteError if none has.

    A run that blows up overflows in the square of its velocities before it does in the velocities.
    """
    names = ("member_tension", "kinetic_energy", "total_energy")
    n = raw.state.shape[1] // 2
    rows: list[list[Any]] = []
    for time, state in zip(raw.time, raw.state, strict=True):
        given = {"coordinate": state[:n], "velocity": state[n:], **arguments}
        given |= schedule(float(time)) if schedule else {}
        try:
            row = [model.compute(name, **given) for name in names]
        except NonFiniteError:
            if not rows:
                raise
            raw = replace(raw, time=raw.time[: len(rows)], state=raw.state[: len(rows)])
            if raw.status == "ok":
                message = f"the energy is not finite after t = {raw.time[-1]:.6g} s: take a smaller step"
                raw = replace(raw, status="unstable", message=message)
            break
        rows.append(row)
    found = dict(zip(names, (np.array(column) for column in zip(*rows, strict=True)), strict=True))
    if raw.tension is not None:
        found = put_own_tensions(model, raw.state, raw.tension, raw.tension_member, found, arguments)
    return raw, found


def read_trajectory(path: str | Path, structure: Structure) -> Trajectory:
    """Read a result file of the verb simulate back, for the structure that it was made from.

    Raises SceneSyntaxError for a file that is no such result, StructureError if it belongs to other nodes or
    members.
    """
    try:
        data = read_arrays(Path(path))
        names = tuple(data["node_name"].tolist()), tuple(data["member_name"].tolist())
        places = structure.coordinate_node_axis
        fields: dict[str, Any] = {name: data[name] for name in RESULT_ARRAYS}
        status, message, method = (str(data[name]) for name in ("status", "message", "method"))
    except UNREADABLE as error:
        raise SceneSyntaxError(
            "not a result file",
            where=str(path),
            given=str(error),
            allowed="an .npz file that the verb simulate wrote",
        ) from error
    if names != (structure.node_name, structure.member_name):
        raise StructureError(
            "the result belongs to another structure",
            where=str(path),
            given=f"{len(names[0])} nodes, {len(names[1])} members",
            allowed=f"the {structure.n_nodes} nodes and {structure.n_members} members of {structure.name}",
        )
    _check_shapes(fields, structure, str(path))
    position, velocity = fields["node_position"], fields["node_velocity"]
    return Trajectory(
        coordinate=position[:, places[:, 0], places[:, 1]],
        velocity=velocity[:, places[:, 0], places[:, 1]],
        node_name=names[0],
        member_name=names[1],
        status=status,
        message=message,
        method=method,
        **fields,
    )


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file by name; raises one of UNREADABLE for what is none."""
    # Opened here, since NumPy leaves a file open that turns out to be no archive.
    with path.open("rb") as file:
        if file.read(2) != b"PK":  # else NumPy speaks of pickled data
            raise BadZipFile("the file is no archive of arrays")
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}


def _check_shapes(fields: Mapping[str, NDArray[Any]], structure: Structure, where: str) -> None:
    """Raise SceneSyntaxError unless all arrays are finite numbers of one count of samples."""
    n_t = fields["time"].size
    nodes, members = (n_t, structure.n_nodes, 3), (n_t, structure.n_members)
    shapes = {"node_position": nodes, "node_velocity": nodes, "member_tension": members}
    for name, array in fields.items():
        shape = shapes.get(name, (n_t,))
        if n_t == 0 or array.shape != shape or array.dtype.kind != "f" or not np.isfinite(array).all():
            raise SceneSyntaxError(
                "an array of the result file is not what it must be",
                where=where,
                given=f"{name}: {array.dtype} {array.shape}",
                allowed=f"{name}: finite float64 {shape}, one row a sample",
                hint="simulate again",
            )


def _judge_energy(
    model: Model,
    raw: RawTrajectory,
    kinetic: FloatArray,
    total: FloatArray,
    arguments: Mapping[str, Any],
) -> tuple[float | None, str, str]:
    """Return the drift and the status: energy must not grow, and without damping must not shrink.

    Torques and turning forces may bring energy in; then neither is asked.
    """
    balance = balance_energy(kinetic, total)
    conservative, is_driven = _find_energy_flow(model, raw, arguments)
    drift = float(balance.drift) if conservative else None
    if raw.status != "ok":
        return drift, raw.status, raw.message
    return drift, *balance.judge((), raw.time, conservative, is_driven, raw.message)


def judge_charts(
    model: Model, time: FloatArray, coordinate: FloatArray, status: str, message: str
) -> tuple[str, str]:
    """Return status "at_pole" where a body comes near the pole of its angles or passes it between samples.

    time (n_t,) [s], coordinate (n_t, n_coordinates): the samples; status, message: what is returned else.
    """
    margin = np.array([model.compute("chart_margin", coordinate=row) for row in coordinate])
    bad = (np.abs(margin) < NEAR_POLE) | (np.sign(margin) != np.sign(margin[0]))
    if not bad.any():
        return status, message
    row = int(np.argmax(bad.any(axis=1)))
    chart = int(np.argmax(bad[row]))
    angles = name_charts(model.manifest)[chart]
    where = f"by t = {time[row]:.6g} s the body {angles!r} has come to the pole of its angles"
    return "at_pole", f"{where} (margin {margin[row, chart]:.3g}): give it another polar_axis"


def _find_energy_flow(model: Model, raw: RawTrajectory, arguments: Mapping[str, Any]) -> tuple[bool, bool]:
    """Return whether the motion keeps its energy, and whether something drives it.

    A model without `energy_rate` keeps its energy if its accelerations depend on no velocity.
    """
    needed = {spec.quantity: spec.arguments for spec in model.manifest.functions}
    if "energy_rate" not in needed:
        return "velocity" not in needed["acceleration"], False
    if not needed["energy_rate"]:
        return True, False
    n = raw.state.shape[1] // 2
    power = [
        model.compute("energy_rate", coordinate=state[:n], velocity=state[n:], **arguments)
        for state in raw.state
    ]
    return not any(power), max(power) > 0.0
