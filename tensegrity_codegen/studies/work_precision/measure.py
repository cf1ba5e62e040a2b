"""The measurement of a motion: problem, contenders, reference and measured rows."""

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError
from tensegrity_codegen.system.journal import read_record

# Where a scene starts at rest in equilibrium nothing would be measured: its nodes are given speeds of this
# part of the mean member length a second, that stretch no bar.
KICK = 0.1
REST_TOLERANCE = 1e-6  # net acceleration times a second, over the mean length, that counts as rest


@dataclass(frozen=True)
class MotionProblem:
    """A structure with its initial state, and the times [s] at which positions are compared.

    is_kicked: whether the initial velocities are not the scene's own.
    """

    structure: Structure
    sample_time: FloatArray
    is_kicked: bool

    @property
    def t_end(self) -> float:
        """End of the motion [s]."""
        return float(self.sample_time[-1])


def set_problem(structure: Structure, t_end: float, samples: int) -> MotionProblem:
    """Return the motion of a structure over t_end [s]; given speeds if it would not move by itself."""
    kicked = bool(_is_at_rest(structure))
    if kicked:
        # (n_nodes, 3) velocities [m/s], always the same, that stretch no bar at first
        rng = np.random.default_rng(0)
        free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
        length = float(structure.member_length().mean())
        velocity = np.where(free, rng.standard_normal(free.shape), 0.0) * KICK * length
        structure = structure.with_changes(
            node_velocity=without_stretch(structure, velocity, np.flatnonzero(structure.is_bar))
        )
    return MotionProblem(structure, np.linspace(0.0, t_end, samples), kicked)


def _is_at_rest(structure: Structure) -> bool:
    """Return whether no node moves and no free node feels a net force, to 1e-6 of the largest tension."""
    if structure.node_velocity.any():
        return False
    if structure.is_rigid.any():
        return False  # the forces of rigid bars are not known beforehand
    tension, strands = structure.static_tension(), structure.strands
    density = strands.spread(tension) / strands.strand_lengths(structure.node_position)
    pull = density[:, None] * strands.vectors(structure.node_position)
    force = structure.node_load + structure.lumped_mass[:, None] * structure.gravity
    np.add.at(force, strands.ends[:, 0], -pull)
    np.add.at(force, strands.ends[:, 1], pull)
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    scale = max(float(np.abs(tension).max()), 1e-300)
    return bool(np.abs(force[free]).max(initial=0.0) <= REST_TOLERANCE * scale)


def without_stretch(structure: Structure, velocity: FloatArray, members: NDArray[np.int64]) -> FloatArray:
    """Return the nearest velocities (n_nodes, 3) [m/s] of free coordinates that stretch none of `members`."""
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    ends = structure.node_position[structure.connectivity[members]]
    vector = ends[:, 0] - ends[:, 1]
    jacobian = np.zeros((len(members), *free.shape))
    jacobian[np.arange(len(members)), structure.connectivity[members, 0]] = vector
    jacobian[np.arange(len(members)), structure.connectivity[members, 1]] = -vector
    stretch = jacobian[:, free]
    change = np.linalg.lstsq(stretch, stretch @ velocity[free], rcond=None)[0]
    result: FloatArray = velocity.copy()
    result[free] -= change
    return result


def find_length_error(structure: Structure, node_position: FloatArray) -> float | None:
    """Return the largest change of length of a rigid bar [m] over the samples, None without rigid bars."""
    rigid = structure.is_rigid
    if not rigid.any() or not len(node_position):
        return None
    ends = structure.connectivity[rigid]
    length = np.linalg.norm(node_position[:, ends[:, 0]] - node_position[:, ends[:, 1]], axis=2)
    return float(np.abs(length - structure.rest_length[rigid]).max())


REPEATS = 5
MIN_SECONDS = 0.02  # seconds over which short runs are repeated
MEASURED_SECONDS = 0.3  # seconds of measuring one setting, unless a single run takes longer


class Unavailable(Exception):
    """Why a contender cannot take part: not installed, or it has no such physics."""


@dataclass(frozen=True)
class Run:
    """The result of one run: positions (n_t, n_nodes, 3) [m] at the sample times, and its status.

    status: "ok" where the method calls its result good; n_evaluations: of forces, 0 where unknown;
    energy_drift: largest change of the total energy [J] at the samples, where the motion keeps it.
    """

    node_position: FloatArray
    status: str
    message: str
    n_steps: int
    n_evaluations: int
    energy_drift: float | None = None


@dataclass(frozen=True)
class Contender:
    """name: unique in a report; group: "own" or "peer"; settings: a tolerance or a step [s] each.

    run: setting -> what makes the Run of it; the call itself integrates and is timed, everything that can be
    prepared being prepared, and what it returns looks at the result.
    """

    name: str
    group: str
    formulation: str
    method: str
    kind: str  # "tolerance" or "step"
    settings: Sequence[float]
    run: Callable[[float], Callable[[], Run]]
    prepare: Callable[[float], object] = float


@dataclass(frozen=True)
class Measurement:
    """One setting of a contender, measured: median seconds of CPU, and the run."""

    seconds: float
    run: Run


def measure(contender: Contender, setting: float, budget: float = MEASURED_SECONDS) -> Measurement:
    """Return the median CPU time of 5 runs or more, fewer where they take longer than `budget` [s] in all."""
    seconds: list[float] = []
    run: Run | None = None
    contender.prepare(setting)
    while True:
        started = time.process_time()
        look = contender.run(setting)
        seconds.append(time.process_time() - started)
        run = run or look()
        enough = len(seconds) >= REPEATS and sum(seconds) > MIN_SECONDS
        if run.status != "ok" or enough or sum(seconds) > budget:
            return Measurement(float(np.median(seconds)), run)


@dataclass(frozen=True)
class Reference:
    """Positions (n_t, n_nodes, 3) [m] taken as true, and the largest difference [m] to the second opinion.

    Errors below ten times `uncertainty` are not told apart from the reference's own.
    """

    node_position: FloatArray
    first: str
    second: str
    uncertainty: float

    def error(self, node_position: FloatArray) -> float:
        """Return the largest error of a node coordinate [m]; infinite where samples are missing."""
        if node_position.shape != self.node_position.shape or not np.isfinite(node_position).all():
            return float("inf")
        return float(np.abs(node_position - self.node_position).max())

    def as_dict(self) -> dict[str, Any]:
        """Return the reference in JSON's types."""
        return dataclasses.asdict(self) | {"node_position": self.node_position.tolist()}

    @classmethod
    def from_dict(cls, data: Any, shape: tuple[int, ...]) -> "Reference | None":
        """Return the reference that `as_dict` wrote, with positions of this shape; None if it is none."""
        try:
            position = np.array(data["node_position"], dtype=np.float64)
            record = read_record(_Agreement, {key: data[key] for key in ("first", "second", "uncertainty")})
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        if record is None or position.shape != shape or not np.isfinite(position).all():
            return None
        return cls(position, record.first, record.second, record.uncertainty)


@dataclass(frozen=True)
class _Agreement:
    """Which two runs agree, and how well [m]."""

    first: str
    second: str
    uncertainty: float


def certify(contenders: list[Contender], progress: Callable[[float], None] | None = None) -> Reference:
    """Return the pair of results of different methods that agree best, found from the tightest setting up.

    Only contenders of the exact physics are asked: bars taken as rigid though they are not are left out.
    """
    runs: list[tuple[str, FloatArray]] = []
    for number, contender in enumerate(contenders):
        if progress is not None:
            progress(number / len(contenders))
        for setting in sorted(contender.settings):
            contender.prepare(setting)
            run = contender.run(setting)()
            if run.status == "ok" and np.isfinite(run.node_position).all():
                runs.append((f"{contender.name} at {setting:.0e}", run.node_position))
                break
    if len(runs) < 2:
        raise ConvergenceError(
            "no two methods come to the end of this motion, so that nothing certifies a reference; "
            f"{', '.join(name for name, _ in runs) or 'none'} did",
            where="report",
            hint="a shorter `t_end`",
        )
    return find_agreement(runs)


def find_agreement(runs: Sequence[tuple[str, FloatArray]]) -> Reference:
    """Return the pair that agrees best of two or more (name, positions), the first one taken as true."""
    pairs = [(float(np.abs(a[1] - b[1]).max()), a, b) for n, a in enumerate(runs) for b in runs[n + 1 :]]
    distance, lower, second = min(pairs, key=lambda pair: pair[0])
    return Reference(lower[1], lower[0], second[0], distance)


CLEARLY = 2.0  # times the time of another setting
EQUATIONS = {False: "bars as in the scene", True: "rigid bars"}  # by whether a row replaces elastic bars


@dataclass(frozen=True)
class Row:
    """One contender at one setting: error [m], CPU seconds of the whole motion, and its own status.

    error: largest error of a node coordinate at the samples; infinite, kept as null, where the run did not
    come to its end. energy_drift: largest change of the total energy [J] at the samples, null where it is
    not kept or not known; length_error: largest change of the length of a rigid bar [m].
    """

    contender: str
    group: str
    formulation: str
    method: str
    kind: str
    setting: float
    error: float
    seconds: float
    status: str
    message: str
    n_steps: int
    n_evaluations: int
    energy_drift: float | None
    length_error: float | None

    @property
    def program(self) -> str:
        """Name of the program, with which that of another program's row begins."""
        return self.contender.split()[0]

    @property
    def replaces_bars(self) -> bool:
        """Whether bars that are elastic in the scene are taken as rigid, or corrected by their stretch."""
        return "rigid" in self.formulation and "," in self.formulation

    @property
    def is_good(self) -> bool:
        """Whether the run came to its end and calls itself good."""
        return self.status == "ok" and math.isfinite(self.error)

    def as_dict(self) -> dict[str, Any]:
        """Return the row in JSON's types."""
        data = dataclasses.asdict(self)
        return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in data.items()}

    @classmethod
    def from_dict(cls, data: Any) -> "Row | None":
        """Return the row that `as_dict` wrote, None if `data` is no such thing."""
        if not isinstance(data, Mapping) or "error" not in data:
            return None
        row = read_record(cls, {**data, "error": 0.0 if data["error"] is None else data["error"]})
        return row if row is None or data["error"] is not None else dataclasses.replace(row, error=math.inf)


def find_front(rows: list[Row]) -> list[Row]:
    """Return the rows that no other row beats in both error and time, the most accurate last."""
    front: list[Row] = []
    for row in sorted((r for r in rows if r.is_good), key=lambda r: (r.seconds, r.error)):
        if not front or row.error < front[-1].error:
            front.append(row)
    return front


def is_clearly_slower(row: Row, rows: Sequence[Row]) -> bool:
    """Return whether another setting of the same program takes half the time for no larger error."""
    rivals = [rival for rival in rows if rival.program == row.program and rival.contender != row.contender]
    return any(r.is_good and CLEARLY * r.seconds < row.seconds and r.error <= row.error for r in rivals)


def find_fastest(
    rows: Sequence[Row], max_error: float, group: str, replaces_bars: bool | None = None
) -> Row | None:
    """Return the fastest row of a group of at most `max_error` [m]; of all equations if None."""
    good = [row for row in rows if row.group == group and row.is_good and row.error <= max_error]
    good = [row for row in good if replaces_bars in (None, row.replaces_bars)]
    return min(good, key=lambda row: row.seconds, default=None)
