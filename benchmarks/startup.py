"""How long the command line takes to start, beside Python alone and the packages that it imports.

Verbs run with their library in the cache, the first simulation of a scene without.

    python benchmarks/startup.py [--runs 9]

Process time (user and system, of all processes that a command starts) [s]: median and least of several runs.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from harness.turns import ROOT, describe_origin, take_turns

PROGRAM = (sys.executable, "-m", "tensegrity_codegen")
PACKAGES = {
    f"import {name}": (sys.executable, "-c", f"import {name}") for name in ("numpy", "typer", "casadi")
}
ALONE = {"python": (sys.executable, "-c", "pass"), **PACKAGES}
MOST = 3.5  # process time of a verb over that of `import numpy` that is wanted
EXAMPLES = ("prism", "prism12", "two_nodes")
# Verbs whose own work on so small a scene takes little, and the words after them.
VERBS = {
    "--help": "", "schema": "", "examples": "--json", "cache": "--json",
    "check": "prism.toml --json", "equilibrium": "prism.toml --json", "reactions": "prism.toml --json",
    "analyse": "prism.toml --json", "load-path": "prism.toml --json", "sensitivity": "prism.toml --json",
    "stand": "standing.toml --json", "linearize": "prism.toml --json", "build": "prism.toml --json",
    "simulate": "prism.toml --t-end 2 --out prism.npz --overwrite --json",
    "show": "prism.toml --out prism.svg --overwrite --json",
    "play": "prism.toml --out prism.html --overwrite --json",
    "export": "csv prism.toml --out tables --overwrite --json",
    "plan": "prism12.toml --to twist=157 --json",
}  # fmt: skip
STANDING = """
name = "standing"
gravity = [0, 0, -9.81]
nodes = { a = { position = [0, 0, 0] }, b = { position = [1, 0, 0] }, c = { position = [0, 1, 0] } }
classes = { bar = { kind = "bar", axial_stiffness = 1e5, mass = 0.1, radius = 0.01 } }
ground = { stiffness = 2e4, friction = 0.5 }
[members]
ab = { class = "bar", nodes = ["a", "b"] }
bc = { class = "bar", nodes = ["b", "c"] }
ca = { class = "bar", nodes = ["c", "a"] }
"""


def measure(command: tuple[str, ...], folder: Path) -> float:
    """Return the process time of one run [s], of the command and of what it starts."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "TENSEGRITY_CODEGEN_CACHE": str(folder / "cache")}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def measure_first(scene: str, folder: Path) -> float:
    """Return the wall time of a simulation whose library is not in the cache [s]."""
    shutil.rmtree(folder / "cache", ignore_errors=True)
    started = time.perf_counter()
    measure((*PROGRAM, "simulate", f"{scene}.toml", "--t-end", "2", "--json"), folder)
    return time.perf_counter() - started


def main() -> None:
    """Measure all commands in turns, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=9, help="runs of each command")
    runs = parser.parse_args().runs
    commands = ALONE | {verb: (*PROGRAM, verb, *words.split()) for verb, words in VERBS.items()}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for example in EXAMPLES:
            measure((*PROGRAM, "examples", example, "--out", f"{example}.toml"), folder)
        (folder / "standing.toml").write_text(STANDING, encoding="utf-8")
        first = {name: partial(measure_first, name, folder) for name in ("prism", "two_nodes")}
        first_times = take_turns(first, 3)
        for command in commands.values():
            measure(command, folder)  # the library gets into the cache
        times = take_turns(
            {name: partial(measure, command, folder) for name, command in commands.items()}, runs
        )
    numpy_time = float(np.median(times["import numpy"]))
    print(describe_origin())
    print(f"{'process time [s]':<16} {'median':>7} {'least':>7} {'over numpy':>11}   wanted: {MOST}")
    for name, seconds in times.items():
        median = float(np.median(seconds))
        late = "  late" if name in VERBS and median > MOST * numpy_time else ""
        print(f"{name:<16} {median:7.3f} {seconds.min():7.3f} {median / numpy_time:11.2f}{late}")
    for name, seconds in first_times.items():
        print(
            f"first simulation of {name}: wall time {np.median(seconds):.2f} s, least {seconds.min():.2f} s"
        )


if __name__ == "__main__":
    main()
