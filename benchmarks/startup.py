"""How long the command line takes to start, beside Python alone and the packages that it imports.

    python benchmarks/startup.py [--runs 9]

Process time (user and system, of all processes that a command starts) [s]: median and least of several runs.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from harness.turns import ROOT, take_turns

PROGRAM = (sys.executable, "-m", "tensegrity_codegen")
SIMULATE = (*PROGRAM, "simulate", "prism.toml", "--t-end", "2", "--out", "prism.npz", "--overwrite")
# what: (command, most process time that is wanted [s])
COMMANDS = {
    "python": ((sys.executable, "-c", "pass"), None),
    "import numpy": ((sys.executable, "-c", "import numpy"), None),
    "import typer": ((sys.executable, "-c", "import typer"), None),
    "import pydantic.types": ((sys.executable, "-c", "import pydantic.types"), None),
    "import casadi": ((sys.executable, "-c", "import casadi"), None),
    "--help": ((*PROGRAM, "--help"), 0.25),
    "simulate --help": ((*PROGRAM, "simulate", "--help"), None),
    "check prism": ((*PROGRAM, "check", "prism.toml"), None),
    "build prism, cached": ((*PROGRAM, "build", "prism.toml"), None),
    "simulate prism, 2 s, cached": (SIMULATE, 0.6),
    "the same, --json": ((*SIMULATE, "--json"), 0.6),
}


def measure(command: tuple[str, ...], folder: Path) -> float:
    """Return the process time of one run [s], of the command and of what it starts."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main() -> None:
    """Measure all commands in turns, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=9, help="runs of each command")
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        measure((*PROGRAM, "examples", "prism", "--out", "prism.toml"), folder)
        for command in (SIMULATE, COMMANDS["build prism, cached"][0]):
            measure(command, folder)  # the library gets into the cache
        commands = {name: partial(measure, command, folder) for name, (command, _) in COMMANDS.items()}
        found = take_turns(commands, runs)
    print(f"{'process time [s]':<30} {'median':>7} {'least':>7} {'wanted':>7}")
    for name, (_command, most) in COMMANDS.items():
        wanted = "" if most is None else f"{most:7.2f}"
        print(f"{name:<30} {np.median(found[name]):7.3f} {found[name].min():7.3f} {wanted:>7}")


if __name__ == "__main__":
    main()
