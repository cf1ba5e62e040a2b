"""Times of calls that take turns, so that a slow moment of the machine falls on all; rows of tables."""

import csv
import os
import shlex
import subprocess
import sys
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
END = "<!-- end of figures -->"


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


def describe_run() -> str:
    """Return two lines on what is measured now: commit, day and machine; how to repeat it."""
    words = [Path(word).name if word.startswith("/") else word for word in sys.argv[1:] if word != "--write"]
    command = shlex.join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *words, "--write"])
    return f"{describe_origin()}\n\nHow to repeat: `{command}`"


def publish(page: str, finding: str, *parts: str, write: bool) -> None:
    """Print the figures of this program: finding, origin, parts; write them into a page of docs/ if asked to.

    They stand between the mark that names the program and the next mark of an end.
    """
    text = "\n\n".join((f"**{finding}**", describe_run(), *(part.strip() for part in parts)))
    print(text)
    if write:
        mark = f"<!-- figures: benchmarks/{Path(sys.argv[0]).name} -->"
        replace_figures(ROOT / "docs" / page, mark, END, text)


def keep_rows(names: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write all rows of this program to output/figures, of which its page has some."""
    path = ROOT / "output" / "figures" / f"{Path(sys.argv[0]).stem}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([names, *rows])


def read_row(text: str) -> list[str]:
    """Return the cells of one row of a Markdown table."""
    return [cell.strip() for cell in text.strip().strip("|").split("|")]


def draw_bars(names: str, parts: str) -> str:
    """Return the mark at which the site draws the next table as bars: columns that name, and those drawn."""
    return f"<!-- site: bars {names}: {parts} -->"


def find_about(document: str | None) -> str:
    """Return what the rows of a page are: a module's docstring without its first two paragraphs."""
    return "What the rows are:\n\n" + (document or "").split("\n\n", 2)[2].strip()


def replace_figures(document: Path, begin: str, end: str, text: str) -> None:
    """Write text between two marks of a document; ends the program where the marks are not there."""
    before, _, rest = document.read_text(encoding="utf-8").partition(begin)
    _, mark, after = rest.partition(end)
    if not mark:
        raise SystemExit(f"{document}: the marks {begin} and {end} are not there")
    document.write_text(f"{before}{begin}\n{text.rstrip()}\n{end}{after}", encoding="utf-8")
