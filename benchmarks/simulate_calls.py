"""The call that README shows, `simulate` from Python by its defaults, over seven structures and tolerances.

python benchmarks/simulate_calls.py --references DIR [--only NAME ...] [--rtol 1e-3 ...] [--quick]
                                    [--patience 3] [--ours-only] [--json FILE] [--write]

Ours is `simulate(model, t_end, samples=11, rtol=rtol)`, all else by default, on a model that
`compile_scene(scene, for_=("simulate",), rtol=rtol)` made before. Times are medians of processor time over
rounds that take turns. The true error is the largest of all node coordinates at the eleven times, against a
motion of the elastic structure that two methods certify and that `--references` keeps. Told over true
compares `error_estimate` with the true error in the norm of the tolerance, of positions and velocities of
nodes, without what the evidence states apart (`vibration_speed_error`); told over tolerance is
`error_estimate` itself.

The others are called from Python too, each at the fastest of its settings, four a decade, that has no larger
error: MuJoCo's integrators, bars as springs and as rigid bodies, one `mj_step` for all steps between two
samples (`mujoco.rollout` takes as long), and CVODE by scikit-sundae with both methods and its dense, sparse
and iterative solvers, over our compiled accelerations and Jacobians. They are compared at the error that our
call has, and at the one that was asked for, rtol times the largest extent of the structure. The mass of bars
is at their ends, since springs have no mass in MuJoCo. A setting that takes longer than the patience and
twelve times our longest call of a structure counts as one that does not reach the error. MuJoCo's law of
contacts is another one, so that it has no part on the ground.
"""

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from harness.cvode_calls import Rates
from harness.simulate_cases import CASES, SAMPLES, Case, Truth, find_truth, place_file
from harness.turns import (
    draw_bars,
    find_about,
    measure_call,
    publish,
    table_text,
    take_turns,
)
from stiff_bars import run_within

from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_motion, tolerance_of_options
from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance
from tensegrity_codegen.runtime.integrate.options import read_stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.motion_input import read_motion
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import as_springs
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Unavailable
from tensegrity_codegen.studies.work_precision.peers import mujoco_tendons

RTOLS = (1e-3, 1e-5, 1e-7)
ROUNDS, QUICK_ROUNDS = 9, 3
ENOUGH = 0.02  # seconds over which short calls are repeated in a round
PATIENCE = 12.0  # times our longest call of a structure that a run of a peer may take at least
LONG = 1.0  # seconds of a run of a peer from which on it is not repeated
A_DECADE = 4  # settings of a peer that are tried
FASTER = 3.0  # times, by which others are no more rivals of a peer
CANDIDATES = 2  # of them that reach the least error, of which the fastest counts
PROGRAMS = ("MuJoCo", "CVODE")
KINDS = {"own": "at the error that ours has", "asked": "at the error asked for"}
PAGE = "simulate_calls.md"


@dataclass
class Row:
    """Our call for a structure and a tolerance.

    told: its error estimate over the tolerance; true: its error over the tolerance; size: of the structure
    [m]; peers: by error ("own" or "asked") and program the fastest setting that reaches it.
    """

    case: str
    rtol: float
    seconds: float
    error: float
    told: float
    true: float
    size: float
    uncertainty: float
    n_steps: int
    n_rejected: int
    method: str
    status: str
    peers: dict[tuple[str, str], Any] = field(default_factory=dict)

    @property
    def asked(self) -> float:
        """The error that was asked for [m]."""
        return self.rtol * self.size

    @property
    def told_over_true(self) -> float:
        """The error estimate over the true error, both over the tolerance."""
        return self.told / self.true

    def ratio(self, kind: str, program: str) -> float:
        """Return the time of a program over ours, infinite where it does not reach the error."""
        trial = self.peers[kind, program]
        return float("inf") if trial is None else float(trial.seconds / self.seconds)

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        near = "" if self.error > 10 * self.uncertainty else f" (reference to {self.uncertainty:.0e})"
        return (
            self.case,
            f"{self.rtol:.0e}",
            f"{1e3 * self.seconds:.2f}",
            f"{self.error:.1e}{near}",
            f"{self.told_over_true:.2g}",
            f"{self.told:.1e}",
            f"{self.n_steps} ({self.n_rejected})",
            self.method if self.status == "ok" else f"{self.method}: {self.status}",
        )


HEADS = (
    "structure",
    "rtol",
    "CPU [ms]",
    "true error [m]",
    "told/true",
    "told/tolerance",
    "steps (rejected)",
    "method",
)


def prepare(case: Case, rtol: float, truth: Truth) -> tuple[Row, Callable[[], Trajectory]]:
    """Return the row of a call, its time measured once, and the call."""
    model = compile_scene(case.scene(), for_=("simulate",), rtol=rtol)
    call = partial(simulate, model, t_end=case.t_end, samples=SAMPLES, rtol=rtol)
    motion = call()
    rejected = re.search(r"([\d,]+) rejected", motion.message)
    row = Row(
        case.name,
        rtol,
        measure_call(call),
        truth.reference.error(motion.node_position),
        float("nan") if motion.error_estimate is None else motion.error_estimate,
        truth.error(motion, find_tolerance(model, case, rtol, motion.evidence)),
        float(np.ptp(truth.reference.node_position[0], axis=0).max()),
        truth.reference.uncertainty,
        motion.n_steps,
        int(rejected[1].replace(",", "")) if rejected else 0,
        motion.method,
        motion.status,
    )
    return row, call


def find_tolerance(model: CompiledModel, case: Case, rtol: float, told: Mapping[str, float]) -> Tolerance:
    """Return the tolerance that the call of a case keeps to by default; told: its evidence."""
    options = read_stepping(None).with_method("auto", rtol)
    motion = read_motion(model, options, case.t_end, SAMPLES, None, None, None, None)
    usual = tolerance_of_options(model.manifest, set_atol_by_motion(motion, options))
    return replace(usual, atol=told["atol"], atol_speed=told["atol_speed"])


def time_in_turns(calls: Sequence[tuple[Any, Callable[[], object]]], rounds: int) -> None:
    """Put the medians over rounds that take turns in `seconds` of what belongs to each call."""
    runs = {}
    for number, (_, call) in enumerate(calls):
        once = measure_call(call)
        runs[str(number)] = partial(measure_call, call, max(1, min(100, int(ENOUGH / once))))
    for (item, _), seconds in zip(calls, take_turns(runs, rounds).values(), strict=True):
        item.seconds = float(np.median(seconds))


# Peers


def list_peers(case: Case, truth: Truth) -> Iterator[tuple[str, Contender]]:
    """Yield program and contender: MuJoCo, where it has the same physics, and CVODE."""
    structure, _ = load_scene(case.scene())
    assert isinstance(structure, Structure)
    if structure.ground is None:
        springs = as_springs(structure)
        if not truth.goes_slack:  # MuJoCo's tendons keep their damping when slack: here none is
            springs = springs.with_changes(tension_only=np.zeros(structure.n_members, dtype=bool))
        for _, make in mujoco_tendons.contenders(MotionProblem(springs, case.times, False)):
            with suppress(Unavailable):
                yield "MuJoCo", make()
    rates = Rates(structure)
    for method, solver in product(("Adams", "BDF"), rates.solvers):
        yield "CVODE", rates.contender(case.times, method, solver)


@dataclass
class Trial:
    """A setting of a peer, its CPU seconds and its error [m]."""

    program: str
    contender: Contender
    setting: float
    seconds: float
    error: float

    def words(self) -> str:
        """Return the time and the setting that takes it, for a table."""
        kind = "step" if self.contender.kind == "step" else "rtol"
        name = self.contender.name.removeprefix(self.program).strip()
        return f"{1e3 * self.seconds:.2f} ({name}, {kind} {self.setting:.0e})"


def scan(case: Case, truth: Truth, least: float, patience: float, folder: Path) -> list[Trial]:
    """Return trials of all peers from loose settings to tight ones, until the least error is reached.

    They are kept in the folder, and made again where they do not go so far.
    """
    path = place_file(case, folder, "-peers.json")
    peers = {contender.name: (program, contender) for program, contender in list_peers(case, truth)}
    kept: Any = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"least": np.inf}
    if kept["least"] <= least:
        return [Trial(*peers[name], *numbers) for name, numbers in kept["trials"]]
    trials: list[Trial] = []
    for program, contender in peers.values():
        trials += scan_peer(
            program, contender, [t for t in trials if t.program == program], truth, least, patience
        )
    numbers = [[trial.contender.name, [trial.setting, trial.seconds, trial.error]] for trial in trials]
    path.write_text(json.dumps({"least": least, "trials": numbers}), encoding="utf-8")
    return trials


def scan_peer(
    program: str, contender: Contender, rivals: Sequence[Trial], truth: Truth, least: float, patience: float
) -> Iterator[Trial]:
    """Yield the trials of a peer; it ends where it has no hope to be the fastest of its program.

    That is beyond the patience, where it gains nothing any more, and where others have been three times as
    fast at no larger error for more than a decade of settings.
    """
    errors: list[float] = []
    behind = 0
    decades, window = (7, A_DECADE) if contender.kind == "step" else (14, 2 * A_DECADE)
    for k in range(A_DECADE, decades * A_DECADE):
        setting = 10.0 ** (-k / A_DECADE)
        contender.prepare(setting)
        seconds, run = run_within(contender, setting, patience)
        if run is None:
            return
        errors.append(truth.reference.error(run.node_position) if run.status == "ok" else np.inf)
        if np.isfinite(errors[-1]):
            yield Trial(program, contender, setting, seconds, errors[-1])
        is_behind = any(rival.error <= errors[-1] and FASTER * rival.seconds < seconds for rival in rivals)
        behind = behind + 1 if is_behind and np.isfinite(errors[-1]) else 0
        if behind > A_DECADE or seconds > patience or sum(e <= least for e in errors) >= CANDIDATES:
            return
        if len(errors) > window and 0.9 * errors[-1 - window] < errors[-1] < np.inf:
            return


def compare(case: Case, rows: Sequence[Row], truth: Truth, patience: float, folder: Path) -> Iterator[Trial]:
    """Give the rows of a case the fastest settings of the peers at both errors; yield those settings."""
    least = min(min(row.error, row.asked) for row in rows)
    longest = max(patience, PATIENCE * max(row.seconds for row in rows))
    trials = scan(case, truth, least, longest, folder)
    for row, kind, program in product(rows, KINDS, PROGRAMS):
        error = row.error if kind == "own" else row.asked
        good = [trial for trial in trials if trial.program == program and trial.error <= error]
        row.peers[kind, program] = min(good, key=lambda trial: trial.seconds, default=None)
    chosen = {id(trial): trial for row in rows for trial in row.peers.values() if trial is not None}
    yield from chosen.values()


def repeat(trial: Trial) -> Callable[[], object]:
    """Return the call of a trial."""
    trial.contender.prepare(trial.setting)
    return lambda: trial.contender.run(trial.setting)()


def peer_cells(row: Row, kind: str) -> Iterator[str]:
    """Yield the cells of each program: its time with what it is, and its time over ours."""
    for program in PROGRAMS:
        trial = row.peers[kind, program]
        missing = "its law is another" if "ground" in row.case and program == "MuJoCo" else "not reached"
        yield missing if trial is None else trial.words()
        yield "" if trial is None else f"{row.ratio(kind, program):.2f}"


def summarise(rows: Sequence[Row]) -> Iterator[str]:
    """Yield sentences on the ratios: of each program at each error, and of the smaller one of a row."""
    for program, kinds in product(PROGRAMS, (*((kind,) for kind in KINDS), tuple(KINDS))):
        ratios = np.array([min(row.ratio(kind, program) for kind in kinds) for row in rows])
        reached = np.isfinite(ratios)
        title = KINDS[kinds[0]] if len(kinds) == 1 else "the smaller of both"
        if reached.any():
            middle, least = np.median(ratios[reached]), ratios.min()
            yield (
                f"- {program} {title}: {middle:.2f} times our time at the median, {least:.2f} times in the "
                f"worst row, of {reached.sum()} rows of {len(rows)} that it reaches."
            )


def write_rows(rows: Sequence[Row], file: Path) -> None:
    """Write the rows, of peers the names, settings, times and errors of the chosen trials."""

    def plain(trial: Trial | None) -> Any:
        return trial and [trial.contender.name, trial.setting, trial.seconds, trial.error]

    peers = [{" ".join(key): plain(trial) for key, trial in row.peers.items()} for row in rows]
    data = [{**vars(row), "peers": found} for row, found in zip(rows, peers, strict=True)]
    file.write_text(json.dumps(data, indent=1), encoding="utf-8")


def describe_finding(rows: Sequence[Row]) -> str:
    """Return the median and the least ratio of each program at the error asked for."""
    ratios = {name: np.array([row.ratio("asked", name) for row in rows if row.peers]) for name in PROGRAMS}
    reached = {name: found[np.isfinite(found)] for name, found in ratios.items()}
    if not all(len(found) for found in reached.values()):
        return f"{len(rows)} calls, at most {max(1e3 * row.seconds for row in rows):.0f} ms"
    middle = [f"{np.median(reached[name]):.2g} times" for name in PROGRAMS]
    worst = [f"{reached[name].min():.2g}" for name in PROGRAMS]
    return (
        f"At the error asked for {middle[0]} as fast as {PROGRAMS[0]} and {middle[1]} as {PROGRAMS[1]} "
        "at the "
        f"median, {' and '.join(worst)} at worst"
    )


def write_parts(rows: Sequence[Row], has_peers: bool) -> tuple[str, ...]:
    """Return a chart, tables and summary."""
    if not has_peers:
        return (draw_bars("structure, rtol", "CPU [ms]"), table_text(HEADS, [row.cells() for row in rows]))
    others = [head for program in PROGRAMS for head in (f"{program} [ms]", f"{program} over ours")]
    own = [(*row.cells(), *peer_cells(row, "own")) for row in rows]
    asked = [(*row.cells()[:3], f"{row.asked:.1e}", *peer_cells(row, "asked")) for row in rows]
    return (
        "At the error asked for:",
        draw_bars("structure, rtol", "CVODE over ours"),
        table_text((*HEADS[:3], "error asked for [m]", *others), asked),
        "At the error that ours has:",
        table_text((*HEADS, *others), own),
        "\n".join(summarise(rows)),
    )


def main() -> None:
    """Print the tables, and write them into the page if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "--references", type=Path, required=True, help="folder of certified motions, and trials of peers"
    )
    parser.add_argument("--only", nargs="*", default=[], help="words of the names of structures")
    parser.add_argument("--rtol", nargs="*", type=float, default=RTOLS, help="relative tolerances")
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    parser.add_argument("--ours-only", action="store_true", help="without other programs")
    parser.add_argument("--patience", type=float, default=3.0, help="seconds that a run of a peer may take")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--write", action="store_true", help="write docs/simulate_calls.md")
    words = parser.parse_args()
    rows: list[Row] = []
    for case in CASES:
        if words.only and not any(word in case.name for word in words.only):
            continue
        truth = find_truth(case, words.references)
        calls: list[tuple[Any, Callable[[], object]]] = [prepare(case, r, truth) for r in words.rtol]
        found = [row for row, _ in calls]
        if not words.ours_only:
            chosen = compare(case, found, truth, words.patience, words.references)
            calls += [(trial, repeat(trial)) for trial in chosen if trial.seconds < LONG]
        time_in_turns(calls, QUICK_ROUNDS if words.quick else ROUNDS)
        rows += found
        print(f"{case.name}: done", file=sys.stderr, flush=True)
    if words.json:
        write_rows(rows, words.json)
    parts = write_parts(rows, not words.ours_only)
    publish(PAGE, describe_finding(rows), *parts, find_about(__doc__), write=words.write)


if __name__ == "__main__":
    main()
