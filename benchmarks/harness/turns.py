"""Times of calls that take turns, so that a slow moment of the machine falls on all; rows of tables."""

import os
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.provenance import name_processor

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "tensegrity_codegen" / "scene" / "examples"
Clock = Callable[[], float]


def measure_call(call: Callable[[], object], count: int = 1, clock: Clock = time.process_time) -> float:
    """Return the mean time of so many calls [s], by default of this process's processor time."""
    started = clock()
    for _ in range(count):
        call()
    return (clock() - started) / count


def take_turns(runs: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, NDArray[np.float64]]:
    """Return what each run returned, round by round (rounds,); every round makes all of them once."""
    found = [[run() for run in runs.values()] for _ in range(rounds)]
    return dict(zip(runs, np.array(found, dtype=np.float64).reshape(rounds, len(runs)).T, strict=True))


def time_in_turns(
    calls: Mapping[str, Callable[[], object]], rounds: int, clock: Clock = time.process_time
) -> dict[str, float]:
    """Return the median time of each call [s] over rounds."""
    runs = {name: partial(measure_call, call, clock=clock) for name, call in calls.items()}
    return {name: float(np.median(seconds)) for name, seconds in take_turns(runs, rounds).items()}


def describe_origin() -> str:
    """Return the commit, the day and the machine of what is measured now, as a sentence."""

    def ask(*words: str) -> str:
        done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
        return done.stdout.strip()

    commit = ask("rev-parse", "--short=8", "HEAD") or "unknown"
    changed = " with changes" if ask("status", "--porcelain", "*.py", "templates") else ""
    machine = f"{name_processor()}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}"
    return f"Measured at commit {commit}{changed} on {datetime.now(UTC):%Y-%m-%d}; {machine}."


def markdown_row(*cells: object) -> str:
    """Return one row of a Markdown table."""
    return f"| {' | '.join(map(str, cells))} |"


def markdown_head(*names: str) -> str:
    """Return the first two lines of a Markdown table."""
    return f"{markdown_row(*names)}\n{'|---' * len(names)}|"


def table_text(names: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a Markdown table."""
    return "\n".join((markdown_head(*names), *(markdown_row(*row) for row in rows)))


def print_table(names: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a Markdown table."""
    print(table_text(names, rows))


def replace_figures(document: Path, begin: str, end: str, text: str) -> None:
    """Write text between two marks of a document; ends the program where the marks are not there."""
    before, _, rest = document.read_text(encoding="utf-8").partition(begin)
    _, mark, after = rest.partition(end)
    if not mark:
        raise SystemExit(f"{document}: the marks {begin} and {end} are not there")
    document.write_text(f"{before}{begin}\n{text.rstrip()}\n{end}{after}", encoding="utf-8")
