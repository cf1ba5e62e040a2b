"""One whole run: floor, sizes, many states, the largest scene, other scripts, report."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil
from rich.console import Console
from rich.table import Table

from harness.acceptance import Evidence, judge, measure_floor
from harness.ensemble import list_ensembles, run_ensemble
from harness.machine import all_cores, describe_machine
from harness.ours import AUTO, Ours
from harness.report import Report, write_report
from harness.session import Kept, Session, name_comparison
from harness.sizes import STRUCTURES, list_comparisons, run_sizes
from harness.tables import acceptance_cells
from harness.tools import Tools, find_tools
from tensegrity_codegen.cli.streams import ProgressBar
from tensegrity_codegen.codegen.compilation.fingerprint import hash_package
from tensegrity_codegen.studies.study import hash_run
from tensegrity_codegen.system.journal import Journal, Resumption

INTERVAL = 0.03  # s from one look to the next


class Watched(subprocess.CompletedProcess[str]):
    """How a command ended; peak: of all its processes together [byte], None where unknown."""

    peak: int | None = None


def run_watched(command: Sequence[str], timeout: float) -> Watched:
    """Run a command as subprocess.run does with captured text; raises TimeoutExpired.

    Resident sets are added up, so memory that processes share counts for each of them: an upper bound. The
    peak that a child reports of itself would not do: it starts at what its parent held.
    """
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        peaks, ended = [0], threading.Event()
        watcher = threading.Thread(target=_watch, args=(process.pid, ended, peaks))
        watcher.start()
        try:
            output, errors = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        finally:
            ended.set()
            watcher.join()
    done = Watched(command, process.returncode, output, errors)
    done.peak = peaks[0] or None
    return done


def _watch(pid: int, ended: threading.Event, peaks: list[int]) -> None:
    process = psutil.Process(pid)
    while not ended.wait(INTERVAL):
        started = time.perf_counter()
        peaks[0] = max(peaks[0], _measure_memory(process))
        time.sleep(min(1.0, 5 * (time.perf_counter() - started)))  # where there are many processes


def _measure_memory(process: psutil.Process) -> int:
    """Return the resident sets of a process and its descendants [byte]; 0 for those that have ended."""
    size = 0
    with suppress(psutil.NoSuchProcess):
        for member in (process, *process.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):
                size += member.memory_info().rss
    return size


SCRIPTS = Path(__file__).resolve().parent.parent
STAGES = (56, 5556)  # of the shipped shape `tower`: 1,002 and 100,002 members
LARGE_LIMIT = 240.0  # s
QUICK = ("prism", "tower10", "tower100")
TITLE = "comparing"
FAILED = "failed:"  # begins the text of a script that did not end well


@dataclass(frozen=True)
class Plan:
    """What to run: output folder, small or everything, the other scripts, and what was done about cores."""

    out: Path
    quick: bool = False
    full: bool = False
    scripts: bool = False
    pinned: str = ""
    fresh: bool = False
    only: tuple[str, ...] = ()

    @property
    def structures(self) -> tuple[str, ...]:
        """Names of the structures."""
        return self.only or (QUICK if self.quick else STRUCTURES)

    @property
    def is_small(self) -> bool:
        """Whether the largest scenes are left out."""
        return self.quick or bool(self.only)

    @property
    def count(self) -> int:
        """Number of states of one structure."""
        return 1000 if self.quick else 10_000

    @property
    def parts(self) -> list[str]:
        """Names of all parts that take long, in their order."""
        compared = [*list_comparisons(self.structures, self.full), *list_ensembles(self.count)]
        large = [] if self.is_small else [_name_large(stages) for stages in STAGES]
        return [
            *(name_comparison(*item) for item in compared),
            *large,
            *(list_scripts() if self.scripts else []),
        ]


def run_all(plan: Plan, console: Console | None = None) -> Report:
    """Run the plan, print the acceptance table, write the report and return it.

    Finished parts are kept in FOLDER/journal; after an interruption the same plan goes on from there.
    """
    console = console or Console()
    bar = ProgressBar(lambda: Console(stderr=True))
    bar.title = "compilers"
    bar.start()
    try:
        tools = find_tools(plan.out / "libraries", 180.0)
        session = Session(rounds=5 if plan.quick else 15)
        session.say = _say_plainly(console, bar)
        kept = Kept(_open_journal(plan, tools, console), bar.begin(TITLE))
        kept.announce(plan.parts)
        ours = Ours(tools.compilation, tools.runner)
        session.say("floor of this core")
        floor = measure_floor(tools)
        run_sizes(session, tools, ours, plan.structures, plan.full, kept)
        run_ensemble(session, tools, ours, plan.count, kept)
        large, scripts = _run_others(plan, session, kept)
    except KeyboardInterrupt:
        bar.stop()
        console.print(
            f"{plan.out} keeps what is finished; the same command goes on from there", highlight=False
        )
        raise
    finally:
        bar.stop()
    lines = judge(Evidence(session, floor, large))
    machine = describe_machine(tools.compilers, plan.pinned)
    report = Report(machine, session.rows, lines, floor, large, scripts)
    _print(console, report, write_report(report, plan.out))
    return report


def _open_journal(plan: Plan, tools: Tools, console: Console) -> Journal:
    """Return where finished parts are kept: of the same code, benchmarks, machine and compilers."""
    words = [str(plan.quick), *(f"{item.name} {item.version}" for item in tools.compilers)]
    key = hash_run("bench", hash_package(SCRIPTS), *words)

    def notice(taken: Resumption) -> None:
        text = taken.describe(time.time()).replace("`fresh=True`", "--fresh")
        console.print(text, highlight=False, markup=False)

    return Journal(plan.out / "journal" / "bench.jsonl", key, fresh=plan.fresh, notice=notice)


def _run_others(
    plan: Plan, session: Session, kept: Kept
) -> tuple[dict[int, Mapping[str, Any]], dict[str, str]]:
    """Return what was measured of the largest scenes, and the texts of the other scripts."""
    session.say("the largest scenes, in a process of their own")
    large = {
        stages: kept.find(_name_large(stages), partial(measure_large, stages), lambda row: "error" not in row)
        for stages in (() if plan.is_small else STAGES)
    }
    session.say("the other scripts")
    scripts = {
        name: kept.find(name, partial(_run_script, name), lambda text: not text.startswith(FAILED))
        for name in (list_scripts() if plan.scripts else ())
    }
    return large, scripts


def _name_large(stages: int) -> str:
    return f"tower of {stages} stages"


def measure_large(stages: int) -> Mapping[str, Any]:
    """Return what large_scene.py printed and the peak of its processes, or {"error": why there is none}."""
    command = [sys.executable, str(SCRIPTS / "large_scene.py"), str(stages), AUTO]
    try:
        with all_cores():
            done = run_watched(command, LARGE_LIMIT)
    except subprocess.TimeoutExpired:
        return {"error": f"not ready within {LARGE_LIMIT:.0f} s"}
    if done.returncode:
        return {"error": (done.stderr.strip().splitlines() or ["no message"])[-1][:200]}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer | {"peak": done.peak}


def list_scripts() -> list[str]:
    """Return the other scripts of the folder that measure something."""
    own = ("bench.py", "large_scene.py")
    files = sorted(path for path in SCRIPTS.glob("*.py") if path.name not in own)
    return [path.name for path in files if "\nif __name__" in path.read_text(encoding="utf-8")]


def _run_script(name: str) -> str:
    done = subprocess.run([sys.executable, str(SCRIPTS / name)], capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else f"{FAILED}\n{done.stderr}"


def _say_plainly(console: Console, bar: ProgressBar) -> Any:
    """Return what titles the bar, and prints one line a comparison where the output is no terminal."""

    def say(text: str) -> None:
        bar.title = text
        if "making" not in text and not console.is_terminal:
            console.print(text, highlight=False)

    return say


def _print(console: Console, report: Report, paths: list[Path]) -> None:
    heading, *rows = acceptance_cells(report.lines)
    table = Table(*heading, title="asked, measured, holds")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    console.print(f"report: {next(path for path in paths if path.suffix == '.html')}", highlight=False)
