"""One scene measured: reference, rows, absent contenders, the front; the finding as a ratio of times."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.studies.study import hash_study
from tensegrity_codegen.studies.work_precision.library_contenders import (
    describe_simulation,
    list_library_contenders,
)
from tensegrity_codegen.studies.work_precision.measure import (
    EQUATIONS,
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
from tensegrity_codegen.studies.work_precision.peers import peer_contenders
from tensegrity_codegen.system.journal import Journal, Resumption
from tensegrity_codegen.system.progress import part_of
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

Progress = Callable[[float], None]
ERROR_LEVELS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
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
        return {max_error: find_fastest(self.rows, max_error, "own") for max_error in ERROR_LEVELS}

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
                    "error": max_error,
                    "row": None if row is None else row.as_dict(),
                    "simulate": self.describe_simulation(row),
                    "peer": None if peer is None else peer.as_dict(),
                    "alike": None if alike is None else alike.as_dict(),
                }
                for max_error, row in self.recommendations.items()
                for peer in [find_fastest(self.rows, max_error, "peer")]
                for alike in [peer and find_fastest(self.rows, max_error, "own", peer.replaces_bars)]
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
    parts_of_key = (",".join(float(t).hex() for t in times[[0, -1]]), str(len(times)))
    key = hash_study(problem.structure, options.compiler, options.flags, *parts_of_key)
    return Journal(path, key, fresh=fresh, notice=notice)


def report_scene(
    problem: MotionProblem, options: Options, journal: Journal, progress: Progress | None = None
) -> SceneReport:
    """Measure every contender at every setting, unless the journal has it."""
    contenders, absent = _gather(problem, options, part_of(progress, 0.0, BUILDING))
    reference = _find_reference(problem, contenders, journal, part_of(progress, BUILDING, CERTIFYING))
    move = part_of(progress, BEFORE, 1.0 - BEFORE) or (lambda fraction: None)
    measured = _Measured(problem, options, reference, journal, move)
    return SceneReport(problem, reference, measured.measure_all(contenders), absent, options.flags)


class _Measured:
    """The rows of a scene as they are measured, or taken from the journal.

    Rows of the journal count as done from the start, so that they say nothing of the speed.
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
        selected: list[Row] = []
        remaining: list[int] = []
        for contender in contenders:
            rows, missing = self._follow(contender, selected, self._take)
            selected += rows
            remaining.append(missing)
        total = sum(len(contender.settings) for contender in contenders)
        done = total - sum(remaining)
        self.journal.announce(
            self.problem.structure.name, "measurements", len(selected), len(selected) + sum(remaining)
        )
        found: list[Row] = []
        for contender, missing in zip(contenders, remaining, strict=True):
            self.progress(done / max(total, 1))
            found += self._follow(contender, found, self._measure)[0]
            done += missing
        return tuple(found)

    def _follow(
        self, contender: Contender, rivals: Sequence[Row], get: Callable[[Contender, float], Row | None]
    ) -> tuple[list[Row], int]:
        """Return the rows of a contender up to that which ends it, and how many are left after a missing one.

        rivals: rows of contenders before it. Of the settings of another program those that are clearly slower
        than another one are not tightened further.
        """
        rows: list[Row] = []
        for number, setting in enumerate(sorted(contender.settings, reverse=True)):
            row = get(contender, setting)
            if row is None:
                return rows, len(contender.settings) - number
            rows.append(row)
            is_slower = contender.group == "peer" and len(rows) >= TRIED and is_clearly_slower(row, rivals)
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
    makers = list(list_library_contenders(problem, flags=options.flags, compiler=options.compiler))
    makers += list(peer_contenders(problem, compiler=options.compiler)) if options.peers else []
    contenders: list[Contender] = []
    absent: dict[str, str] = {}
    for number, (name, make) in enumerate(makers):
        if progress is not None:
            progress(number / len(makers))
        try:
            contenders.append(make())
        except Unavailable as error:
            absent[name] = str(error)
    return contenders, absent


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


HEADLINE_ERROR = 1e-6  # the error of the headline [m], where methods reach it
MAX_SCENES = 2  # that a headline names one by one


@dataclass(frozen=True)
class Comparison:
    """The fastest of our rows and of the peers' with an error of at most `wanted` [m], None without one.

    alike: the fastest of ours with the equations of the peer.
    """

    scene: str
    wanted: float
    own: Row | None
    peer: Row | None
    t_end: float
    has_peers: bool
    alike: Row | None

    @property
    def ratio(self) -> float | None:
        """Time of the peer over ours, at equal equations where there is such a row; None without rows."""
        return self._ratio(self.alike or self.own)

    @property
    def other_ratio(self) -> float | None:
        """Time of the peer over that of the fastest of ours, None where its equations are the same."""
        return None if self.own is self.alike else self._ratio(self.own)

    def _ratio(self, own_row: Row | None) -> float | None:
        return None if own_row is None or self.peer is None else self.peer.seconds / own_row.seconds


def compare_scene(report: SceneReport, max_error: float = HEADLINE_ERROR) -> Comparison:
    """Return the comparison at the error next to `max_error` [m] that both reach, or else ours alone."""
    recommendations = report.recommendations
    nearest = sorted(recommendations, key=lambda error: abs(math.log(error / max_error)))
    reached = [error for error in nearest if recommendations[error] is not None]
    shared = [error for error in reached if find_fastest(report.rows, error, "peer") is not None]
    error = next(iter((*shared, *reached)), max(recommendations))
    peer = find_fastest(report.rows, error, "peer")
    return Comparison(
        report.problem.structure.name,
        error,
        recommendations[error],
        peer,
        report.problem.t_end,
        any(row.group == "peer" for row in report.rows),
        peer and find_fastest(report.rows, error, "own", peer.replaces_bars),
    )


def describe_finding(comparisons: Sequence[Comparison]) -> str:
    """Return how much faster or slower than the fastest other program, scene by scene or as a range."""
    if len(comparisons) == 1:
        return _describe(comparisons[0])
    ratios = [comparison.ratio for comparison in comparisons if comparison.ratio is not None]
    if len(ratios) < len(comparisons) or (len(ratios) <= MAX_SCENES and not _is_alike(comparisons)):
        shown = [f"{comparison.scene}: {_describe(comparison)}" for comparison in comparisons[:MAX_SCENES]]
        n_unnamed = len(comparisons) - len(shown)
        return "; ".join([*shown, *([f"and {n_unnamed} more scenes"] if n_unnamed > 0 else [])])
    if len(ratios) <= MAX_SCENES:
        relation = "faster" if ratios[0] >= 1.0 else "slower"
        factors = [
            f"{_factor(max(r, 1.0 / r))} ({comparison.scene})"
            for r, comparison in zip(ratios, comparisons, strict=True)
        ]
        at = _error(comparisons[0].wanted)
        peers = dict.fromkeys(
            comparison.peer.contender for comparison in comparisons if comparison.peer is not None
        )
        text = f"{' and '.join(factors)} times {relation} than the fastest other program"
        return f"{text}, {' and '.join(peers)}, at an error of {at}{_at_equal(comparisons)}"
    faster = [ratio for ratio in ratios if ratio >= 1.0]
    slower = [1.0 / ratio for ratio in ratios if ratio < 1.0]
    errors = sorted({comparison.wanted for comparison in comparisons})
    text = "; ".join(
        f"{_range(values)} times {relation} in {len(values)} of {len(ratios)} scenes"
        for relation, values in (("faster", faster), ("slower", slower))
        if values
    )
    at = _error(errors[0]) if len(errors) == 1 else f"{_error(errors[0])} to {_error(errors[-1])}"
    programs = sorted({comparison.peer.program for comparison in comparisons if comparison.peer is not None})
    return (
        f"{text}: the fastest of our methods against the fastest other program ({', '.join(programs)}) at an "
        f"error of {at}{_at_equal(comparisons)}"
    )


def describe_rows(reports: Sequence[SceneReport]) -> str:
    """Return how much was measured, as a sentence."""
    rows = [row for report in reports for row in report.rows]
    own_methods = {row.contender for row in rows if row.group == "own"}
    peers = {row.program for row in rows if row.group == "peer"}
    failed = sum(not row.is_good for row in rows)
    peer_phrase = f" and {describe_count(len(peers), 'other program')}" if peers else ", and no other program"
    return (
        f"{describe_count(len(rows), 'run')} of {describe_count(len(own_methods), 'method')} of ours"
        f"{peer_phrase}, on {describe_count(len(reports), 'scene')}; {failed:,} did not reach the end."
    )


def _describe(comparison: Comparison) -> str:
    error = _error(comparison.wanted)
    if comparison.own is None:
        return f"no method reaches an error of {error}"
    ratio = comparison.ratio
    if ratio is None:
        own_phrase = f"{comparison.own.method} ({comparison.own.formulation}) reaches an error of {error} in "
        own_phrase += f"{1e3 * comparison.own.seconds / comparison.t_end:.2g} ms a simulated second"
        return f"{own_phrase}, no other program reaches it" if comparison.has_peers else own_phrase
    peer = comparison.peer.contender if comparison.peer is not None else ""
    text = f"{_times(ratio)} than the fastest other program, {peer}, at an error of {error}"
    if comparison.other_ratio is None:
        return text
    own_phrase = f"with {EQUATIONS[comparison.own.replaces_bars]} ({comparison.own.formulation})"
    if comparison.alike is None:
        return f"{text}, ours {own_phrase}"
    return f"{text}{_at_equal([comparison])}; {_times(comparison.other_ratio)} {own_phrase}"


def _times(ratio: float) -> str:
    return f"{_factor(max(ratio, 1.0 / ratio))} times {'faster' if ratio >= 1.0 else 'slower'}"


def _at_equal(comparisons: Sequence[Comparison]) -> str:
    """Return that equations are equal, where ours would be faster by others."""
    return (
        " and equal equations"
        if any(comparison.other_ratio and comparison.alike for comparison in comparisons)
        else ""
    )


def _is_alike(comparisons: Sequence[Comparison]) -> bool:
    """Return whether all are at the same error, and all faster or all slower."""
    sides = {
        (comparison.wanted, comparison.ratio is not None and comparison.ratio >= 1.0)
        for comparison in comparisons
    }
    return len(sides) == 1


def _error(value: float) -> str:
    """Return an error [m] in short: 1e-6 m."""
    mantissa, _, exponent = f"{value:.0e}".partition("e")
    return f"{mantissa}e{int(exponent)} m"


def _range(values: Sequence[float]) -> str:
    low, high = _factor(min(values)), _factor(max(values))
    return low if low == high else f"{low} to {high}"


def _factor(value: float) -> str:
    """Return a factor in two digits, whole from 10 on."""
    return f"{value:.1f}" if value < 9.95 else f"{value:,.0f}"
