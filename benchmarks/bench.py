"""The comparison: every emitter beside CasADi, NumPy, numba, JAX and MuJoCo, and the floor of this core.

    python benchmarks/bench.py [--out FOLDER] [--quick | --full] [--only NAME...] [--scripts]
                               [--write] [--fresh]

Compiled libraries stay in FOLDER/libraries, with the seconds and memory that they took to compile, so that a
second run is quicker. Finished comparisons are kept too: after an interruption the same command goes on from
them. --quick: small structures, few rounds; --full: more quantities at the largest size;
--scripts: the other scripts of this folder too, as tables of the same report.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from harness.machine import pin_to_one_core

PINNED = pin_to_one_core()  # before anything imports NumPy

from harness.report import write_document  # noqa: E402
from harness.run import Plan, run_all  # noqa: E402
from harness.sizes import STRUCTURES  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent


def main(arguments: list[str] | None = None) -> int:
    """Measure, write the report, print where it is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "output" / "bench", help="folder of the report")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="small structures, few rounds: a minute")
    size.add_argument("--full", action="store_true", help="every quantity at the largest size too")
    parser.add_argument("--only", nargs="*", choices=STRUCTURES, help="these structures alone")
    parser.add_argument("--scripts", action="store_true", help="the other scripts of this folder too")
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks.md")
    parser.add_argument("--fresh", action="store_true", help="use nothing of an interrupted run")
    options = parser.parse_args(arguments)
    plan = Plan(options.out, options.quick, options.full, options.scripts, PINNED, options.fresh)
    plan = replace(plan, only=tuple(options.only or ()))
    try:
        report = run_all(plan)
    except KeyboardInterrupt:
        return 130
    write_document(report, write=options.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
