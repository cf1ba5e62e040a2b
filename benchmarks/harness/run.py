"""One whole run: floor, sizes, many states, the largest scene, other scripts, report."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from harness.acceptance import Evidence, judge
from harness.ensemble import run_ensemble
from harness.floor import measure_floor
from harness.machine import all_cores, describe_machine
from harness.memory import run_watched
from harness.ours import AUTO, Ours
from harness.report import Report, write_report
from harness.session import Session
from harness.sizes import STRUCTURES, run_sizes
from harness.tables import acceptance_cells
from harness.tools import find_tools

__all__ = ["Plan", "run_all"]

SCRIPTS = Path(__file__).resolve().parent.parent
STAGES = (56, 5556)  # of the shipped shape `tower`: 1,002 and 100,002 members
LARGE_LIMIT = 240.0  # s
QUICK = ("prism", "tower10", "tower100")


@dataclass(frozen=True)
class Plan:
    """What to run: output folder, small or everything, the other scripts, and what was done about cores."""

    out: Path
    quick: bool = False
    full: bool = False
    scripts: bool = False
    pinned: str = ""


def run_all(plan: Plan, console: Console | None = None) -> Report:
    """Run the plan, print the acceptance table, write the report and return it."""
    console = console or Console()
    with console.status("compilers") as status:
        tools = find_tools(plan.out / "libraries", 180.0)
        session = Session(say=lambda text: status.update(text), rounds=5 if plan.quick else 15)
        if not console.is_terminal:
            session.say = _say_plainly(console)
        ours = Ours(tools.compilation, tools.runner)
        session.say("floor of this core")
        floor = measure_floor(tools)
        run_sizes(session, tools, ours, QUICK if plan.quick else STRUCTURES, plan.full)
        run_ensemble(session, tools, ours, 1000 if plan.quick else 10_000)
        session.say("the largest scene, in a process of its own")
        large = {} if plan.quick else {stages: measure_large(stages) for stages in STAGES}
        session.say("the other scripts")
        scripts = {name: _run_script(name) for name in list_scripts()} if plan.scripts else {}
    lines = judge(Evidence(session, floor, large))
    machine = describe_machine(tools.compilers, plan.pinned)
    report = Report(machine, session.rows, lines, floor, large, scripts)
    _print(console, report, write_report(report, plan.out))
    return report


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
    return done.stdout if done.returncode == 0 else f"failed:\n{done.stderr}"


def _say_plainly(console: Console) -> Any:
    """Return what prints one line a comparison, for output that is no terminal."""

    def say(text: str) -> None:
        if "making" not in text:
            console.print(text, highlight=False)

    return say


def _print(console: Console, report: Report, paths: list[Path]) -> None:
    heading, *rows = acceptance_cells(report.lines)
    table = Table(*heading, title="asked, measured, holds")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    console.print(f"report: {next(path for path in paths if path.suffix == '.html')}", highlight=False)
