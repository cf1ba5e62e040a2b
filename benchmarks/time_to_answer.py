"""What a user waits for: processor time and memory of one command, from its start to the finding.

python benchmarks/time_to_answer.py [--structures prism dome] [--verbs check simulate] [--cold | --warm]
                                    [--limit 60] [--write]

Structures: the example prism (12 members), a Geiger dome of twelve sectors (73), the shipped tower of 50
stages (894), nets that hang at their edge (9,384 and 99,904 cables). Cold is with an empty cache of compiled
libraries, warm the same command once more; Python's own modules are compiled before in both. CPU is user and
system time of all processes that the command starts, memory the largest resident set of one of them, lines
all that it prints; `x numpy` is the CPU over that of `python -c "import numpy"`, measured in the same minute.
"""

import argparse
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.turns import EXAMPLES, ROOT, draw_bars, find_about, publish, table_text
from large_scene import QUANTITIES
from large_scene import SCENE as TOWER
from live_pages import write_net

from tensegrity_codegen.system.cache_root import CACHE_VARIABLE

PAGE = "answers_measured.md"
PROGRAM = (sys.executable, "-m", "tensegrity_codegen")
NUMPY = (sys.executable, "-c", "import numpy")
USUAL = ("prism", "dome", "tower")
HEADS = ("structure", "verb", "cache", "CPU [s]", "x numpy", "memory [MB]", "lines", "ended")
PAUSE = 0.005  # s from one look to the next
MINUTE = 60.0  # s that a measured `import numpy` counts
RUNS, SHORT = 3, 3.0  # runs of a warm command, where one takes at most so much CPU [s]

# Verb: words after the scene; {out} is a path that does not exist.
VERBS = {
    "check": (),
    "equilibrium": (),
    "analyse": (),
    "sensitivity": (),
    "linearize": (),
    "load-path": (),
    "simulate": ("--t-end", "0.1"),
    "build": ("--out", "{out}"),
    "show png": ("--out", "{out}.png"),
    "show html": ("--out", "{out}.html"),
    "play": ("--out", "{out}.html"),
}

DOME = """\
name = "dome"
gravity = [0, 0, -9.81]
[model]
quantities = ["member_tension"]
{classes}
[nodes]
{nodes}
[members]
{members}
"""
HOOP = 20_000.0  # N of prestress in the hoop of the dome


@dataclass(frozen=True)
class Run:
    """One command: CPU of all processes [s], largest resident set of one [MB], lines, how it ended."""

    cpu: float
    memory: float
    lines: int
    ended: str = ""


def write_tower() -> str:
    """Return the scene of the tower."""
    return TOWER.format(quantities=QUANTITIES, stages=50)


def write_dome(sectors: int = 12) -> str:
    """Return the scene of a Geiger dome of 6 sectors + 1 members, its prestress in equilibrium."""
    ring = range(1, sectors + 1)
    nodes = ["ht = { position = [0, 0, 1.6], mass = 15 }", "hb = { position = [0, 0, -0.2], mass = 15 }"]
    for k in ring:
        x, y = math.cos(2 * math.pi * k / sectors), math.sin(2 * math.pi * k / sectors)
        nodes.append(f"a{k} = {{ position = [{6 * x!r}, {6 * y!r}, 0], anchored = true }}")
        nodes += [
            f"{name}{k} = {{ position = [{3 * x!r}, {3 * y!r}, {z}], mass = 15 }}"
            for name, z in (("t", 1.1), ("b", -0.9))
        ]
    ends = {
        "post": ("t{0}", "b{0}"),
        "inner_ridge": ("ht", "t{0}"),
        "outer_ridge": ("t{0}", "a{0}"),
        "inner_diagonal": ("hb", "t{0}"),
        "outer_diagonal": ("b{0}", "a{0}"),
        "hoop": ("b{0}", "b{1}"),
    }
    members = ['hub1 = { class = "hub", nodes = ["ht", "hb"] }']
    members += [
        f'{name}{k} = {{ class = "{name}", nodes = ["{i.format(k)}", "{j.format(k, k % sectors + 1)}"] }}'
        for name, (i, j) in ends.items()
        for k in ring
    ]
    classes = (
        f'[classes.{name}]\nkind = "{"bar" if force < 0 else "cable"}"\n'
        f"axial_stiffness = {2e7 if force < 0 else 5e6}\nprestress = {force!r}"
        for name, force in find_dome_prestress(sectors).items()
    )
    return DOME.format(classes="\n".join(classes), nodes="\n".join(nodes), members="\n".join(members))


def find_dome_prestress(sectors: int) -> dict[str, float]:
    """Return the self-stress of the dome by class [N], from the horizontal forces of one sector."""
    radial = 2 * HOOP * math.sin(math.pi / sectors)
    lift = radial * 0.9 / 3  # of the outer diagonal, which the post carries to the ridge
    outer = lift * 3 / 1.1
    ridge, diagonal = outer * 1.3 / 1.8, outer * 0.5 / 1.8
    return {
        "hub": -sectors * ridge * 0.5 / 3,
        "post": -lift,
        "inner_ridge": ridge * math.hypot(3, 0.5) / 3,
        "outer_ridge": outer * math.hypot(3, 1.1) / 3,
        "inner_diagonal": diagonal * math.hypot(3, 1.3) / 3,
        "outer_diagonal": radial * math.hypot(3, 0.9) / 3,
        "hoop": HOOP,
    }


STRUCTURES: dict[str, tuple[str, Callable[[], str]]] = {
    "prism": ("prism, 12", (EXAMPLES / "prism.toml").read_text),
    "dome": ("dome, 73", write_dome),
    "tower": ("tower, 894", write_tower),
    "net": ("net, 9,384", lambda: write_net(70)),
    "large_net": ("net, 99,904", lambda: write_net(225)),
}


def measure(command: Sequence[str], environment: dict[str, str], limit: float) -> Run:
    """Return what one command took; one that is not ready after `limit` seconds by the clock is ended."""
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, env=environment, stdout=said, stderr=said, start_new_session=True)
        ended, status, used = os.wait4(process.pid, os.WNOHANG)
        deadline, given_up = time.monotonic() + limit, False
        while not ended:
            if time.monotonic() > deadline:
                given_up = True
                process.terminate()  # passed on to the process that works
            time.sleep(PAUSE)
            ended, status, used = os.wait4(process.pid, 0 if given_up else os.WNOHANG)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read().decode("utf-8", "replace")
    end = f"after {limit:g} s" if given_up else describe_end(process.returncode, text)
    cpu = used.ru_utime + used.ru_stime
    return Run(cpu, used.ru_maxrss / 1024, text.count("\n"), end)


def describe_end(code: int, text: str) -> str:
    """Return the exit code and the line that says why, "" for code 0."""
    if code == 0:
        return ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    said = next((line for line in lines if line.startswith("error")), lines[-1] if lines else "")
    return f"{code}: {said[:80]}".replace("|", "/")


class Unit:
    """The CPU of `python -c "import numpy"` [s], the least of three runs, measured again every minute."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.environment = environment
        self.measured = -math.inf
        self.cpu = 0.0

    def find(self) -> float:
        """Return it."""
        if time.monotonic() - self.measured > MINUTE:
            self.cpu = min(measure(NUMPY, self.environment, MINUTE).cpu for _ in range(3))
            self.measured = time.monotonic()
        return self.cpu


def describe_run(run: Run, unit: float) -> tuple[str, str, str, str, str]:
    """Return the last cells of a row."""
    return (
        f"{run.cpu:.2f}",
        f"{run.cpu / unit:.1f}",
        f"{run.memory:.0f}",
        str(run.lines),
        run.ended,
    )


def take_median(runs: Sequence[Run]) -> Run:
    """Return the first run with the median of all CPU times."""
    return replace(runs[0], cpu=statistics.median(run.cpu for run in runs))


def measure_cells(
    scene: Path, verb: str, environment: dict[str, str], kinds: Sequence[str], limit: float
) -> Iterator[tuple[str, Run]]:
    """Yield cold or warm and what the command took, each verb with a cache of its own."""
    with tempfile.TemporaryDirectory() as folder:
        environment = environment | {CACHE_VARIABLE: f"{folder}/cache"}
        for kind in ("cold", "warm"):
            runs: list[Run] = []
            while len(runs) < (RUNS if kind == "warm" and (not runs or runs[0].cpu < SHORT) else 1):
                out = f"{folder}/{kind}{len(runs)}"
                words = [word.format(out=out) for word in VERBS[verb]]
                command = (*PROGRAM, verb.split()[0], str(scene), *words)
                runs.append(measure(command, environment, limit))
            if kind in kinds:
                yield kind, take_median(runs)
            if runs[0].ended.startswith("after") or kinds == ("cold",):
                return


def measure_all(options: argparse.Namespace, folder: Path) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the table."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    # A user's modules are compiled at the installation or at the first start.
    environment |= {"PYTHONPATH": str(ROOT), "PYTHONPYCACHEPREFIX": str(ROOT / "output" / "bytecode")}
    unit = Unit(environment)
    kinds = ("cold",) if options.cold else ("warm",) if options.warm else ("cold", "warm")
    for number, name in enumerate(options.structures):
        title, write = STRUCTURES[name]
        scene = folder / f"{name}.toml"
        scene.write_text(write(), encoding="utf-8")
        for verb in options.verbs:
            if number == 0:  # compiles the modules
                list(measure_cells(scene, verb, environment, ("cold",), options.limit))
            for kind, run in measure_cells(scene, verb, environment, kinds, options.limit):
                row = (title, verb, kind, *describe_run(run, unit.find()))
                print(*row, sep=", ", file=sys.stderr, flush=True)
                yield row


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--structures", nargs="+", choices=STRUCTURES, default=USUAL, metavar="NAME")
    parser.add_argument("--verbs", nargs="+", choices=VERBS, default=tuple(VERBS), metavar="VERB")
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument("--cold", action="store_true", help="with an empty cache only")
    kinds.add_argument("--warm", action="store_true", help="with a library from the cache only")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds after which a command is ended")
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = list(measure_all(options, Path(folder)))
    bars = draw_bars("structure, verb, cache", HEADS[3])
    publish(
        PAGE, describe_finding(rows), bars, table_text(HEADS, rows), find_about(__doc__), write=options.write
    )


def describe_finding(rows: Sequence[Sequence[str]]) -> str:
    """Return the median processor time, cold and warm, of commands that answer, and the longest one."""
    parts = [
        f"{statistics.median(float(row[3]) for row in rows if row[2] == kind):.1f} s {kind}"
        for kind in dict.fromkeys(row[2] for row in rows)
    ]
    worst = max(rows, key=lambda row: float(row[3]))
    return (
        f"A command takes {', '.join(parts)} of processor time at the median; the longest "
        f"{float(worst[3]):.1f} s "
        f"({worst[1]}, {worst[0]} members, {worst[2]})"
    )


if __name__ == "__main__":
    main()
