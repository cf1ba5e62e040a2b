"""One scene measured: reference, rows, those who do not take part, the front."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.studies.study import hash_study
from tensegrity_codegen.studies.work_precision.measure import (
    Contender,
    MotionProblem,
    Reference,
    Row,
    Unavailable,
    certify,
    find_fastest,
    find_front,
    find_length_error,
    is_clearly_slower,
    measure,
)
from tensegrity_codegen.studies.work_precision.own import describe_simulation, own_contenders
from tensegrity_codegen.studies.work_precision.peers import peer_contenders
from tensegrity_codegen.system.journal import Journal, Resumption
from tensegrity_codegen.system.progress import part_of
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

Progress = Callable[[float], None]
WANTED = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
# A setting is skipped when looser ones of the same contender came to errors this close to the floor, or took
# this long: tighter ones would only take longer.
LONGEST = 3.0
FLOOR = 10.0
TRIED = 3  # settings of another program before a slower variant of it is given up
# Fractions of the work, about.
BUILDING, CERTIFYING = 0.2, 0.2
BEFORE = BUILDING + CERTIFYING
REFERENCE = "reference"  # its name in the journal
# Contenders that may certify: of the physics of the scene, without approximation.
EXACT = ("node_position, ", "rigid_bar, rk", f"rigid_bar, {STIFF_INTEGRATOR}")


@dataclass(frozen=True)
class Options:
    """How to measure: compiler and flags of our own code, peers or not, longest run [s]."""

    flags: str = "native"
    compiler: str | None = None
    peers: bool = True
    longest: float = LONGEST


@dataclass(frozen=True)
class SceneReport:
    """All that was measured of one scene; absent: name of a contender -> why it does not take part.

    flags: with which our code was compiled.
    """

    problem: MotionProblem
    reference: Reference
    rows: tuple[Row, ...]
    absent: dict[str, str]
    flags: str = "native"

    @property
    def front(self) -> list[Row]:
        """The rows that no other beats in both error and time."""
        return find_front(list(self.rows))

    @property
    def recommendations(self) -> dict[float, Row | None]:
        """Wanted error [m] -> the fastest of our own methods that reaches it."""
        return {wanted: find_fastest(self.rows, wanted, "own") for wanted in WANTED}

    def describe_simulation(self, row: Row | None) -> str:
        """Return how the verb simulate repeats one of our runs, nothing without one."""
        return "" if row is None else describe_simulation(row, self.problem.t_end, self.flags)

    def as_dict(self) -> dict[str, Any]:
        """Return everything in JSON's types."""
        return {
            "scene": self.problem.structure.name,
            "t_end": self.problem.t_end,
            "is_kicked": self.problem.is_kicked,
            "reference": {
                "first": self.reference.first,
                "second": self.reference.second,
                "uncertainty": self.reference.uncertainty,
            },
            "rows": [row.as_dict() for row in self.rows],
            "front": [row.as_dict() for row in self.front],
            "recommendations": [
                {
                    "error": wanted,
                    "row": None if row is None else row.as_dict(),
                    "simulate": self.describe_simulation(row),
                    "peer": None if peer is None else peer.as_dict(),
                    "alike": None if alike is None else alike.as_dict(),
                }
                for wanted, row in self.recommendations.items()
                for peer in [find_fastest(self.rows, wanted, "peer")]
                for alike in [peer and find_fastest(self.rows, wanted, "own", peer.replaces_bars)]
            ],
            "absent": self.absent,
        }


def open_journal(
    problem: MotionProblem,
    options: Options,
    folder: Path,
    *,
    fresh: bool = False,
    notice: Callable[[Resumption], None] | None = None,
) -> Journal:
    """Return the journal of the measurements of one scene, see Journal; raises OutputError."""
    path, times = folder / f"{problem.structure.name}.jsonl", problem.sample_time
    words = (",".join(float(t).hex() for t in times[[0, -1]]), str(len(times)))
    key = hash_study(problem.structure, options.compiler, options.flags, *words)
    return Journal(path, key, fresh=fresh, notice=notice)


def report_scene(
    problem: MotionProblem, options: Options, journal: Journal, progress: Progress | None = None
) -> SceneReport:
    """Measure every contender at every setting, unless the journal has it.

    Raises ConvergenceError where no reference can be certified.
    """
    contenders, absent = _gather(problem, options, part_of(progress, 0.0, BUILDING))
    reference = _find_reference(problem, contenders, journal, part_of(progress, BUILDING, CERTIFYING))
    move = part_of(progress, BEFORE, 1.0 - BEFORE) or (lambda fraction: None)
    measured = _Measured(problem, options, reference, journal, move)
    return SceneReport(problem, reference, measured.measure_all(contenders), absent, options.flags)


class _Measured:
    """The rows of a scene as they are measured, or taken from the journal.

    What the journal has counts as done from the start, so that it says nothing of the speed.
    """

    def __init__(
        self,
        problem: MotionProblem,
        options: Options,
        reference: Reference,
        journal: Journal,
        progress: Progress,
    ) -> None:
        self.problem, self.options, self.reference = problem, options, reference
        self.journal, self.progress = journal, progress

    def measure_all(self, contenders: Sequence[Contender]) -> tuple[Row, ...]:
        """Return the rows of all contenders, from loose settings to tight ones while these add something."""
        kept: list[Row] = []
        left: list[int] = []
        for contender in contenders:
            rows, missing = self._follow(contender, kept, self._take)
            kept += rows
            left.append(missing)
        total = sum(len(contender.settings) for contender in contenders)
        done = total - sum(left)
        self.journal.announce(self.problem.structure.name, "measurements", len(kept), len(kept) + sum(left))
        found: list[Row] = []
        for contender, missing in zip(contenders, left, strict=True):
            self.progress(done / max(total, 1))
            found += self._follow(contender, found, self._measure)[0]
            done += missing
        return tuple(found)

    def _follow(
        self,
        contender: Contender,
        others: Sequence[Row],
        get: Callable[[Contender, float], Row | None],
    ) -> tuple[list[Row], int]:
        """Return the rows of a contender up to that which ends it, and how many are left after a missing one.

        others: rows of contenders before it. Of the settings of another program those that are clearly slower
        than another one are not tightened further.
        """
        rows: list[Row] = []
        for number, setting in enumerate(sorted(contender.settings, reverse=True)):
            row = get(contender, setting)
            if row is None:
                return rows, len(contender.settings) - number
            rows.append(row)
            is_slower = contender.group == "peer" and len(rows) >= TRIED and is_clearly_slower(row, others)
            if is_slower or _is_enough(row, self.reference, self.options):
                break
        return rows, 0

    def _take(self, contender: Contender, setting: float) -> Row | None:
        """Return the row that the journal has, None if it has none."""
        row = Row.from_dict(self.journal.find(_name(contender, setting)))
        if row is None or (row.contender, row.setting) != (contender.name, setting):
            return None
        return row

    def _measure(self, contender: Contender, setting: float) -> Row:
        """Return the row that the journal has, or a new one."""
        row = self._take(contender, setting)
        if row is None:
            row = _measure(self.problem, contender, setting, self.reference)
            self.journal.store(_name(contender, setting), row.as_dict())
        return row


def _name(contender: Contender, setting: float) -> str:
    return f"{contender.name} at {setting!r}"


def _find_reference(
    problem: MotionProblem, contenders: list[Contender], journal: Journal, progress: Progress | None
) -> Reference:
    """Return the reference, from the journal or certified."""
    shape = (len(problem.sample_time), *problem.structure.node_position.shape)
    reference = Reference.from_dict(journal.find(REFERENCE), shape)
    if reference is None:
        exact = [c for c in contenders if c.name.startswith(EXACT) and c.kind == "tolerance"]
        reference = certify(exact, progress)
        journal.store(REFERENCE, reference.as_dict())
    return reference


def _gather(
    problem: MotionProblem, options: Options, progress: Progress | None
) -> tuple[list[Contender], dict[str, str]]:
    makers = list(own_contenders(problem, flags=options.flags, compiler=options.compiler))
    makers += list(peer_contenders(problem, compiler=options.compiler)) if options.peers else []
    found: list[Contender] = []
    absent: dict[str, str] = {}
    for number, (name, make) in enumerate(makers):
        if progress is not None:
            progress(number / len(makers))
        try:
            found.append(make())
        except Unavailable as error:
            absent[name] = str(error)
    return found, absent


def _measure(problem: MotionProblem, contender: Contender, setting: float, reference: Reference) -> Row:
    measured = measure(contender, setting)
    run = measured.run
    return Row(
        contender=contender.name,
        group=contender.group,
        formulation=contender.formulation,
        method=contender.method,
        kind=contender.kind,
        setting=float(setting),
        error=reference.error(run.node_position),
        seconds=measured.seconds,
        status=run.status,
        message=run.message,
        n_steps=run.n_steps,
        n_evaluations=run.n_evaluations,
        energy_drift=run.energy_drift,
        length_error=find_length_error(problem.structure, run.node_position),
    )


def _is_enough(row: Row, reference: Reference, options: Options) -> bool:
    """Return whether tighter settings of this contender would only take longer."""
    return row.seconds > options.longest or row.error <= FLOOR * max(
        reference.uncertainty, np.finfo(np.float64).eps
    )
