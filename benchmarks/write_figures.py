"""Run every program that writes a page of figures, then the figures of README; `make figures` is the same.

python benchmarks/write_figures.py [NAME ...] [--quiet | --timings] [--dirty] [--list]

NAME: programs, such as stiff_bars; all if none. Those whose results do not depend on other work run first
(--quiet runs them alone), those that time something last, one at a time (--timings runs them alone). These
refuse a tree with changes of code, unless --dirty is given. What fails, or takes longer than 30
minutes, is named at the end, and its page keeps its figures. Run it with a Python that has mujoco, jax,
numba, scikit-sundae and distributed.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

from harness.turns import END, ROOT, describe_origin, replace_figures

MOST = 1800.0  # s that a program may take
README = "<!-- figures: benchmarks/write_figures.py -->"


@dataclass(frozen=True)
class Program:
    """A program of this folder, the page of docs/ that it writes, its words, whether it times something."""

    name: str
    page: str
    words: str = ""
    is_timing: bool = True

    @property
    def mark(self) -> str:
        """The mark of a page behind which the figures of this program stand."""
        return f"<!-- figures: benchmarks/{self.name}.py -->"

    @property
    def command(self) -> list[str]:
        """The words of the command, without the Python that runs it."""
        return [f"benchmarks/{self.name}.py", *self.words.split(), "--write"]


PROGRAMS = (
    Program("stability_pages", "stability.md", "--budget 110 --limit 1", is_timing=False),
    Program("reproduction_page", "reproduction.md", is_timing=False),
    Program("identification", "identify_measured.md", "--seeds 100", is_timing=False),
    Program("machines", "answers_measured.md", is_timing=False),
    Program("control_delays", "control_measured.md", "prism tower", is_timing=False),
    Program(
        "far_plans", "control_measured.md", "--out output/figures/far_plans.jsonl --count 5", is_timing=False
    ),
    Program("control_step", "control_measured.md", "--steps 20000"),
    Program("control_loops", "control_measured.md"),
    Program("mpc", "control_measured.md"),
    Program("gradients", "identify_measured.md", "--no-mjx"),
    Program("ground", "ground_measured.md"),
    Program("derivatives", "learning_measured.md"),
    Program("environments", "learning_measured.md", "--rounds 3 --states 32"),
    Program("ensembles", "sweep_measured.md"),
    Program("sweep", "sweep_measured.md", "--peers 20"),
    Program("sweep_scaling", "sweep_measured.md", "--quick"),
    Program("time_to_answer", "answers_measured.md", "--verbs check equilibrium analyse simulate build play"),
    Program("live_pages", "answers_measured.md"),
    Program("robots", "robots_measured.md", "--rounds 5"),
    Program("stiffness_spread", "stiffness.md", "--rounds 5"),
    Program("stiff_bars", "stiffness.md", "prism icosahedron rosenbrock --patience 1 --rounds 5"),
    Program("simulate_calls", "simulate_calls.md", "--references output/references --quick --patience 1"),
    Program("bench", "benchmarks.md", "--only prism icosahedron tower10"),
)
# What README says before the finding of a program.
LINES = {
    "stiff_bars": "Stiff bars",
    "bench": "Functions beside CasADi, NumPy, JAX",
    "ensembles": "1,000 motions at once",
    "simulate_calls": "`simulate` from Python",
}


def main() -> int:
    """Run the programs; return 1 where one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[[], *(item.name for item in PROGRAMS)])
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument("--quiet", action="store_true", help="only what does not time anything")
    kinds.add_argument("--timings", action="store_true", help="only what times something")
    parser.add_argument("--dirty", action="store_true", help="times of code with changes too")
    parser.add_argument("--list", action="store_true", help="print what would run")
    words = parser.parse_args()
    chosen = [
        item
        for item in PROGRAMS
        if (not words.names or item.name in words.names)
        and not (words.quiet and item.is_timing)
        and not (words.timings and not item.is_timing)
    ]
    if words.list:
        print("\n".join(f"{item.page:24}{' '.join(item.command)}" for item in chosen))
        return 0
    if any(item.is_timing for item in chosen) and "with changes" in describe_origin() and not words.dirty:
        raise SystemExit("the code has changes that are not committed: commit them, or give --dirty")
    failed = [item.name for item in chosen if not run(item)]
    write_readme()
    print(f"failed: {', '.join(failed)}" if failed else "all done")
    return 1 if failed else 0


def run(item: Program) -> bool:
    """Run a program, print the time it took, return whether it ended well; output/figures has its output."""
    log = ROOT / "output" / "figures" / f"{item.name}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
    began = time.monotonic()
    with (
        log.open("w", encoding="utf-8") as file,
        subprocess.Popen(
            [sys.executable, *item.command],
            cwd=ROOT,
            env=environment,
            stdout=file,
            stderr=file,
            start_new_session=True,
        ) as process,
    ):
        try:
            process.wait(MOST)
        except (subprocess.TimeoutExpired, KeyboardInterrupt) as reason:
            os.killpg(process.pid, signal.SIGKILL)
            if isinstance(reason, KeyboardInterrupt):
                raise
    taken = time.monotonic() - began
    words = "" if process.returncode == 0 else f", failed with {process.returncode}: {log.relative_to(ROOT)}"
    print(f"{item.name:20}{taken:8.0f} s{words}", flush=True)
    return process.returncode == 0


def read_figures(item: Program) -> str:
    """Return what stands between the marks of a program."""
    text = (ROOT / "docs" / item.page).read_text(encoding="utf-8")
    return text.partition(item.mark)[2].partition(END)[0]


def list_lines() -> list[str]:
    """Return the lines of README: findings of pages, with the commit of each."""
    items = {item.name: item for item in PROGRAMS}
    lines = []
    for name, title in LINES.items():
        text = read_figures(items[name])
        finding = text.partition("**")[2].partition("**")[0]
        commit = re.search(r"at commit (\w+)", text)
        page = f"[{commit[1] if commit else 'page'}](docs/{items[name].page})"
        lines.append(f"- {title}: {finding[0].lower()}{finding[1:]} ({page}).")
    return lines


def write_readme() -> None:
    """Write the findings of pages between the marks of README."""
    replace_figures(ROOT / "README.md", README, END, "\n".join(list_lines()))


if __name__ == "__main__":
    sys.exit(main())
