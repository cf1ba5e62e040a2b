"""Hostile files and conditions: none may end in a traceback, need 20 s, or more than 1 GB.

    python benchmarks/hostile.py [--examples 500] [--conditions 200] [--seed 1]

Files are given to the command line in a process of their own each, forked from a helper that draws no
cases and so stays small; largest resident memory, time and exit code of each are measured. Ends with 1 where
one of them fails.
"""

import argparse
import os
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import seed as seeded

import tensegrity_codegen.cli.app as app
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.simulate.condition import build_condition
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.request import ModelRequest
from tests.hostile import Case, conditions, scenes, structures, tables
from tests.runtime.build import make_structure, spring

SECONDS = 20.0
MEMORY = 2**30  # bytes
CODES = (0, 2, 3)


def run_case(words: list[str], folder: Path) -> tuple[str, float, int]:
    """Return what is wrong with how a case ends ("" for nothing), its seconds and its memory [bytes]."""
    start, log = time.perf_counter(), folder / "log"
    child = os.fork()
    if child == 0:
        _run_child(folder, words, log)
    status, usage = 0, None
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.perf_counter() - start > SECONDS:
            os.kill(child, 9)
            os.wait4(child, 0)
            return f"longer than {SECONDS:g} s", time.perf_counter() - start, 0
        time.sleep(0.005)
    text = log.read_text(encoding="utf-8", errors="replace")
    code, memory = os.waitstatus_to_exitcode(status), usage.ru_maxrss * 1024
    wrong = "traceback" if "Traceback" in text else "" if code in CODES else f"exit code {code}"
    return wrong or ("memory" if memory > MEMORY else ""), time.perf_counter() - start, memory


def _run_child(folder: Path, words: list[str], log: Path) -> None:
    """Run the command line with stdout and stderr in a file; does not return."""
    os.chdir(folder)
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    resource.setrlimit(resource.RLIMIT_AS, (6 * MEMORY, 6 * MEMORY))
    code = 70
    try:
        app.main([*words, "--json"])
    except SystemExit as end:
        code = 0 if end.code is None else end.code if isinstance(end.code, int) else 71
    except BaseException:
        import traceback

        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


class Helper:
    """A process forked early, which runs cases and draws none."""

    def __init__(self) -> None:
        self.here, there = Pipe()
        if os.fork() == 0:
            while (asked := there.recv()) is not None:
                there.send(run_case(*asked))
            os._exit(0)

    def run(self, case: Case, folder: Path) -> tuple[str, float, int]:
        """Write the files of a case and return what `run_case` says of it."""
        files, words = case
        for name, content in files:
            (folder / name).write_bytes(content)
        self.here.send((words, folder))
        answer: tuple[str, float, int] = self.here.recv()
        return answer

    def close(self) -> None:
        """End the process."""
        self.here.send(None)


def run_files(examples: int, seed: int, helper: Helper) -> list[str]:
    """Run so many cases, a third of each kind; print the counts and return the failures."""
    failures: list[str] = []
    for name, cases in (("scenes", scenes()), ("tables", tables()), ("structures", structures())):
        found: Counter[str] = Counter()
        worst = [0.0, 0]
        run = seeded(seed)(
            _settings(-(-examples // 3))(given(case=cases)(_runner(name, found, worst, failures, helper)))
        )
        run()
        print(f"{name}: {dict(found)}, at most {worst[0]:.1f} s and {worst[1] / 2**20:.0f} MB", flush=True)
    return failures


def _settings(examples: int) -> Any:
    checks = list(HealthCheck)
    return settings(max_examples=examples, deadline=None, database=None, suppress_health_check=checks)


def _runner(
    name: str, found: Counter[str], worst: list[float], failures: list[str], helper: Helper
) -> Callable[..., None]:
    def run(case: Case) -> None:
        with tempfile.TemporaryDirectory() as folder:
            wrong, seconds, memory = helper.run(case, Path(folder))
            if wrong:
                log = (Path(folder) / "log").read_text(encoding="utf-8", errors="replace")[-600:]
                failures.append(f"{name}: {wrong}: {case[0][0][1][:300]!r}\n{log}")
        found[wrong or "ok"] += 1
        worst[:] = [max(worst[0], seconds), max(worst[1], memory)]

    return run


def run_conditions(examples: int, seed: int) -> list[str]:
    """Build and evaluate so many conditions; print the counts and return the failures."""
    nodes = [[0, 0, 0], [1.2, 0, 0]]
    structure = make_structure(nodes, [spring(0, 1, 1.0, 40.0)], anchored={0: "xyz"}, mass=0.1, axes="x")
    model = build_library(structure, ModelRequest((*SIMULATION_QUANTITIES, "member_length"))).load()
    failures: list[str] = []
    found: Counter[str] = Counter()

    @seeded(seed)
    @_settings(examples)
    @given(text=conditions())
    def run(text: str) -> None:
        try:
            build_condition(text, model)(0.0, model.nominal("coordinate"), model.nominal("velocity"))
            found["a value"] += 1
        except TensegrityError:
            found["refused"] += 1
        except Exception as error:
            found["failed"] += 1
            failures.append(f"condition {text!r}: {error!r}")

    run()
    print(f"conditions: {dict(found)}", flush=True)
    return failures


def main() -> None:
    """Run both, print counts and failures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--examples", type=int, default=500)
    parser.add_argument("--conditions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    words = parser.parse_args()
    helper = Helper()
    failures = run_files(words.examples, words.seed, helper)
    helper.close()
    failures += run_conditions(words.conditions, words.seed)
    for failure in failures[:20]:
        print(failure)
    print(f"{len(failures)} failures")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
