"""Stiff bars: our methods beside MuJoCo, SUNDIALS and SciPy, each at its cheapest setting for one error.

python benchmarks/stiff_bars.py [prism] [icosahedron] [tower] [rosenbrock] [--quick] [--patience 5] [--write]

The example scenes without damping, but for the cases `rosenbrock`, and with the mass of bars at their ends,
since springs have no mass in MuJoCo and slack tendons keep their damping; the tower has 912 members. Bars
are so many times as stiff as the stiffest cable, at the forces that they have. Errors are the largest of
all node coordinates at eleven times, against a reference with elastic bars that two methods certify, also
where bars are taken as rigid. Times are medians of CPU time in rounds that take turns: of compiled code, but
for `simulate, auto`, the call that README shows, by default flags, with Python and the check of its error.

Compared is like with like: *elastic bars* in both, or *rigid bars* in both (ours by `rigid_bar`, exactly
rigid or corrected by their stretch to first order; MuJoCo's as rigid bodies). *Any* is the fastest of ours
against the fastest of the others, whatever their equations. CVODE (C) is SUNDIALS itself in C over our
compiled accelerations; CVODES and IDAS (CasADi) are SUNDIALS behind CasADi over the same; SciPy's
integrators call them from Python. Settings are tried from loose to tight, eight a decade (two with --quick);
of four that reach the error the fastest counts. A peer that needs more than the patience at four settings is
given up, and what is printed is a lower bound. Damping of the cables, where there is some, is so many times
the critical one, 2 sqrt(k m) with the mean mass of the nodes.
"""

import argparse
import math
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from harness.turns import (
    EXAMPLES,
    draw_bars,
    find_about,
    keep_rows,
    markdown_head,
    markdown_row,
    measure_call,
    publish,
    read_row,
    take_turns,
)

from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import as_springs, stiffen_bars
from tensegrity_codegen.studies.work_precision.library_contenders import list_library_contenders
from tensegrity_codegen.studies.work_precision.measure import (
    Contender,
    MotionProblem,
    Reference,
    Run,
    Unavailable,
    find_agreement,
)
from tensegrity_codegen.studies.work_precision.peers import peer_contenders

EXPLICIT = ("node_position, rk54", "node_position, rk853", "node_position, rk4")
RADAU, RODAS, DOOR = "node_position, radau", "node_position, rodas", "simulate, auto"
CORRECTED = tuple(f"rigid_bar, corrected, {m}" for m in ("rk54", "rk853", "rk4"))
ELASTIC, RIGID = (*EXPLICIT, RADAU), (*CORRECTED, "rigid_bar, all bars, rk853", "rigid_bar, all bars, rk4")
BODIES = ("MuJoCo (rigid bars)",)
SPRINGS = ("MuJoCo RK4", "MuJoCo Euler", "MuJoCo implicitfast")
CVODE = ("CVODE (C",)
# The fastest settings of these programs in runs with all of them.
BEHIND_CASADI = (
    "CVODES (CasADi; Adams, functional iteration)",
    "CVODES (CasADi; Adams, Newton, dense LU)",
    "CVODES (CasADi; Adams, Newton, sparse LU)",
    "IDAS (CasADi; sparse LU)",
)
SCIPY = ("SciPy DOP853 (ode)", "SciPy VODE (Adams)", "SciPy Radau")
OTHERS = (*BODIES, *SPRINGS, *CVODE, *BEHIND_CASADI, *SCIPY)
PAGE = "stiffness.md"
REFERENCES = {"node_position, rk853": 1e-12, RADAU: 1e-8, "rigid_bar, corrected, rk853": 1e-11}
LARGE = {"node_position, rk853": 1e-5, RADAU: 1e-7}  # rounding keeps steps of large structures from less
ROUNDS = 9
A_DECADE = 8  # settings tried
CANDIDATES = 4  # settings that reach the error, of which the fastest counts; one where runs are long
TRIALS = 5  # runs of which the fastest counts, to choose among settings
CLOSE = 100.0  # times the error wanted, from where on the least error of shorter steps is estimated
LONG = 1.0  # seconds of a run from which on it is made once


TOWER = """\
name = "tower"
gravity = [0, 0, -9.81]
[classes.bar]
kind = "bar"
axial_stiffness = 2e5
radius = 0.01
[classes.cable]
kind = "cable"
axial_stiffness = 1e4
prestress = 10.0
[shape]
kind = "tower"
stages = 51
radius = 0.5
height = 1.0
node_mass = 0.1
anchor_bottom = true
"""


@dataclass(frozen=True)
class Pair:
    """The fastest of ours beside that of others, whose names begin so; words: how both take bars."""

    words: str
    ours: tuple[str, ...]
    others: tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """A structure, its stiffness ratio, the simulated time [s], the error wanted [m], and what is compared.

    damping: of its cables, over the critical one.
    """

    name: str
    ratio: float
    t_end: float
    error: float
    pairs: tuple[Pair, ...]
    damping: float = 0.0

    @property
    def title(self) -> str:
        """What the case is called in the tables."""
        damped = f", damping {self.damping:g}" if self.damping else ""
        return f"{self.name}, ratio {self.ratio:.0e}{damped}, {self.t_end:g} s, error {self.error:.0e} m"


# Rosenbrock's method beside the other implicit one and the explicit ones.
BESIDE = (Pair("our methods", (RODAS,), (RADAU,)), Pair("our methods", (RODAS,), EXPLICIT[:2]))
PAIRS = (
    Pair("rigid bars", RIGID, BODIES),
    *(Pair("elastic bars", ELASTIC, others) for others in (SPRINGS, CVODE, BEHIND_CASADI, SCIPY)),
    Pair("any", (*ELASTIC, *RIGID), OTHERS),
    Pair("any, ours called from Python", (DOOR,), OTHERS),
)
LARGE_PAIRS = (
    *(Pair("elastic bars", (RADAU,), others) for others in (CVODE[:1], BEHIND_CASADI[-1:])),
    Pair("our methods", (RADAU,), EXPLICIT[:2]),
)
CASES = (
    Case("prism", 1e3, 1.0, 1e-5, PAIRS),
    Case("prism", 1e3, 1.0, 1e-4, PAIRS),
    Case("icosahedron", 1e3, 1.0, 1e-5, PAIRS),
    Case("prism", 1e7, 1.0, 1e-4, tuple(pair for pair in PAIRS if pair.others not in (BEHIND_CASADI, SCIPY))),
    Case("tower", 1e7, 0.1, 1e-4, LARGE_PAIRS),
    *(
        Case(name, ratio, 1.0, error, BESIDE, damping)
        for name, ratio, damping in (
            ("prism", 1.0, 0.1),
            ("prism", 1.0, 10.0),
            ("icosahedron", 1.0, 10.0),
            ("prism", 1e3, 0.0),
        )
        for error in (1e-3, 1e-5, 1e-8)
    ),
)


@dataclass
class Found:
    """The cheapest setting of a contender that reaches the error; seconds: None until timed in turns."""

    contender: Contender
    setting: float
    error: float
    seconds: float
    is_bound: bool = False


def load(case: Case) -> Structure:
    """Return the structure of a case."""
    with tempfile.TemporaryDirectory() as folder:
        path = EXAMPLES / f"{case.name}.toml"
        if case.name == "tower":
            path = Path(folder) / "tower.toml"
            path.write_text(TOWER, encoding="utf-8")
        structure = as_springs(load_nodes(path))
    none = np.zeros(structure.n_members)
    mass = structure.lumped_mass
    critical = 2.0 * np.sqrt(structure.spring_constant * mass.mean())
    damping = np.where(structure.tension_only, case.damping * critical, 0.0)
    structure = structure.with_changes(node_mass=mass, member_mass=none, damping=damping)
    return stiffen_bars(structure, case.ratio * structure.spring_constant[~structure.is_bar].max())


def make_contenders(case: Case) -> dict[str, Contender]:
    """Return the contenders of a case and those that certify its reference, by name."""
    problem = MotionProblem(load(case), np.linspace(0.0, case.t_end, 11), False)
    wanted = {name for pair in case.pairs for name in pair.ours} | set(REFERENCES)
    others = tuple(name for pair in case.pairs for name in pair.others)
    makers = {
        **dict(list_library_contenders(problem, flags="native", compiler=None, extra_methods=("rodas",))),
        **dict(peer_contenders(problem)),
        DOOR: dict(list_library_contenders(problem, flags="reference", compiler=None))[DOOR],
    }
    if case.name == "tower":
        wanted -= {"node_position, rk4", *CORRECTED}
    found = {}
    for name, make in makers.items():
        with suppress(Unavailable):
            found |= {name: make()} if name in wanted or name.startswith(others) else {}
    return found


def certify(case: Case, contenders: dict[str, Contender]) -> Reference:
    """Return the reference: of the certifying methods the two that agree best."""
    runs = {}
    for name, setting in REFERENCES.items():
        if name not in contenders or (case.name != "tower" and case.ratio > 1e5 and name == EXPLICIT[1]):
            continue
        runs[name] = contenders[name].run(LARGE[name] if case.name == "tower" else setting)()
    good = {name: run.node_position for name, run in runs.items() if run.status == "ok"}
    return find_agreement(sorted(good.items()))


def settings_of(contender: Contender) -> Iterator[float]:
    """Yield settings from loose to tight."""
    least, most = (1, 6) if contender.kind == "step" else (1, 11)
    for k in range(least * A_DECADE, most * A_DECADE):
        yield 10.0 ** (-k / A_DECADE)


def find_setting(contender: Contender, reference: Reference, error: float, patience: float) -> Found | None:
    """Return the loosest setting that reaches the error, or one of the next that do if it is faster."""
    best: Found | None = None
    left, late, errors = CANDIDATES, 0, list[float]()
    for setting in settings_of(contender):
        contender.prepare(setting)
        seconds, run = run_within(contender, setting, patience)
        if run is None:
            late += 1
            if late == CANDIDATES:
                return best or Found(contender, setting, float("nan"), patience, True)
            continue
        got = reference.error(run.node_position) if run.status == "ok" else float("inf")
        errors.append(got)
        before = errors[-1 - A_DECADE] if len(errors) > A_DECADE else np.inf
        least = got - (before - got) / 9  # of shorter steps, where the error of steps is of order 1 or more
        if contender.kind == "step" and error < least and got < CLOSE * error:
            return best
        if got <= error:
            left -= 1 if seconds < LONG else CANDIDATES
            if best is None or seconds < best.seconds:
                best = Found(contender, setting, got, seconds)
            if left <= 0:
                return best
    return best


def run_within(contender: Contender, setting: float, patience: float) -> tuple[float, Run | None]:
    """Return CPU seconds and the run; None beyond the patience, which ends a peer's process."""
    if contender.group == "own":
        return _fastest(contender, setting)
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(contender, setting, patience, sender))
    child.start()
    sender.close()
    try:
        found: tuple[float, Run | None] = receiver.recv()
    except EOFError:  # its time was up
        found = (patience, None)
    child.join()
    return found


def _answer(contender: Contender, setting: float, patience: float, sender: Any) -> None:
    seconds = math.ceil(patience)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    sender.send(_fastest(contender, setting))


def _fastest(contender: Contender, setting: float) -> tuple[float, Run]:
    """Return the CPU seconds of the fastest of a few runs, of one where it is long, and what it brings."""
    seconds: list[float] = []
    while len(seconds) < TRIALS and (not seconds or seconds[0] < LONG / 10):
        started = time.process_time()
        look = contender.run(setting)
        seconds.append(time.process_time() - started)
    return min(seconds), look()


def time_in_turns(found: Sequence[Found]) -> None:
    """Put medians over rounds in place of the times of single runs; long runs are made once."""
    short = [item for item in found if item.seconds < LONG and not item.is_bound]
    runs = {}
    for item in short:
        item.contender.prepare(item.setting)
        count = max(1, min(100, int(2e-2 / max(item.seconds, 1e-6))))
        runs[item.contender.name] = partial(measure_call, partial(item.contender.run, item.setting), count)
    taken = take_turns(runs, ROUNDS)
    for item in short:
        item.seconds = float(np.median(taken[item.contender.name]))


def run_case(case: Case, patience: float) -> tuple[list[str], list[str]]:
    """Return rows of the table of comparisons, and of all that was measured."""
    contenders = make_contenders(case)
    reference = certify(case, contenders)
    title = case.title
    print(
        f"{title}: reference {reference.first}, {reference.second} differs by {reference.uncertainty:.1e} m"
    )
    wanted = [
        name
        for name in contenders
        if any(name.startswith(pair.others) or name in pair.ours for pair in case.pairs)
    ]
    found = {}
    for name in wanted:
        item = find_setting(contenders[name], reference, case.error, patience)
        found |= {} if item is None else {name: item}
    time_in_turns(list(found.values()))
    rows = []
    for name in wanted:
        item = found.get(name)
        cells = ("", "", "not reached")
        if item is not None:
            cells = (f"{item.setting:.1e}", _milliseconds(item), f"{item.error:.1e}")
        rows.append(markdown_row(title, name, *cells))
    return [row for pair in case.pairs for row in compare(title, pair, found)], rows


def _milliseconds(item: Found) -> str:
    return f"{'more than ' if item.is_bound else ''}{1e3 * item.seconds:.3f}"


def compare(title: str, pair: Pair, found: dict[str, Found]) -> Iterator[str]:
    """Yield the row of a pair: the fastest of ours, the fastest of the others, its time over ours."""
    ours = min((found[n] for n in pair.ours if n in found), key=lambda item: item.seconds, default=None)
    others = [item for name, item in found.items() if name.startswith(pair.others)]
    other = min(others, key=lambda item: item.seconds, default=None)
    if ours is None or other is None:
        missing = pair.ours[0] if ours is None else pair.others[0]
        yield markdown_row(title, pair.words, f"none of {missing} ... reaches the error", "", "", "", "")
        return
    ratio = other.seconds / ours.seconds
    more = "more than " if other.is_bound else ""
    digits = f"{ratio:.2f}" if ratio < 1.0 else f"{ratio:.1f}"
    sides = (cell for item in (ours, other) for cell in (item.contender.name, _milliseconds(item)))
    yield markdown_row(title, pair.words, *sides, f"{more}{digits}")


def main() -> None:
    """Print both tables, and write them into the page if asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "names", nargs="*", help="prism, icosahedron, tower (these three if none), rosenbrock"
    )
    parser.add_argument("--patience", type=float, default=5.0, help="seconds that one run of a peer may take")
    parser.add_argument("--quick", action="store_true", help="two settings a decade, fewer rounds")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="rounds of the times")
    parser.add_argument("--write", action="store_true", help="write docs/stiffness.md")
    words = parser.parse_args()
    globals().update(ROUNDS=words.rounds)
    if words.quick:
        globals().update(A_DECADE=2, CANDIDATES=2, ROUNDS=5, TRIALS=3)
    compared, rows = [], []
    for case in CASES:
        kind = "rosenbrock" if case.pairs is BESIDE else case.name
        if kind in (words.names or ("prism", "icosahedron", "tower")):
            more, measured = run_case(case, words.patience)
            print("\n".join([*more, *measured]), flush=True)
            compared += more
            rows += measured
    keep_rows(("case", "method", "setting", "CPU time [ms]", "error [m]"), [read_row(row) for row in rows])
    sides = ("fastest of ours", "CPU time [ms]", "fastest of the others", "its time [ms]")
    head = markdown_head("case", "bars", *sides, "its time over ours")
    beside = [row for row in compared if read_row(row)[1] == "our methods"]
    tables = ["\n".join([head, *(row for row in compared if row not in beside)])]
    if beside:
        tables += ["## A Rosenbrock method beside Radau", "\n".join([head, *beside])]
    publish(
        PAGE,
        describe_finding(compared),
        draw_bars("case, bars, fastest of the others", "its time over ours"),
        *tables,
        find_about(__doc__),
        write=words.write,
    )


def describe_finding(rows: Sequence[str]) -> str:
    """Return the ratios of all cases to the fastest other program, in C and of `simulate` from Python."""
    ratios: dict[str, dict[str, float]] = {}
    for cells in map(read_row, rows):
        if cells[-1]:
            ratio = float(cells[-1].removeprefix("more than ").replace(",", ""))
            cases = ratios.setdefault(cells[1], {})
            cases[cells[0]] = min(ratio, cases.get(cells[0], math.inf))
    whatever, python = ratios["any"].values(), ratios["any, ours called from Python"].values()
    alike = min(min(ratios[bars].values()) for bars in ("elastic bars", "rigid bars") if bars in ratios)
    return (
        f"At equal error {min(whatever):.2g} to {max(whatever):.3g} times as fast in C as the fastest other "
        f"program, {alike:.2g} times at least with bars alike, elastic or rigid; `simulate` from Python "
        f"{min(python):.2g} to {max(python):.2g} times"
    )


if __name__ == "__main__":
    main()
