"""Build and run the examples, and compare their numbers with those of Python.

    python examples/run.py                 all that can run here
    python examples/run.py c rust --json   some of them; one JSON object on stdout

Exit code 0 where every example that could run printed the same numbers, 1 where one failed or printed others,
2 for a wrong argument. Examples whose tools are missing are listed with what to install.
"""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from trial.recipes import EXAMPLES, RECIPES
from trial.trial import Libraries, Outcome, run_examples

NAMES = tuple(recipe.name for recipe in RECIPES)


def describe(outcome: Outcome) -> str:
    """Return the lines of one example."""
    lines = [f"{outcome.name:10} {outcome.status}"]
    if outcome.largest:
        quantity = max(outcome.largest, key=lambda name: outcome.largest[name])
        lines[0] += f"; largest relative difference {outcome.largest[quantity]:.1e} ({quantity})"
    if outcome.missing:
        lines[0] += "; missing: " + ", ".join(f"{tool.program} ({tool.install})" for tool in outcome.missing)
    return "\n".join(lines + [f"{'':10} {line}" for line in outcome.message.splitlines()])


def main() -> int:
    """Run what the command line names; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("name", nargs="*", help=f"examples, all by default: {', '.join(NAMES)}")
    parser.add_argument("--out", type=Path, default=EXAMPLES.parent / "output" / "examples", help="folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    options = parser.parse_args()
    unknown = [name for name in options.name if name not in NAMES]
    if unknown:
        parser.error(f"no example {', '.join(unknown)}; there are {', '.join(NAMES)}")
    out = options.out.resolve()
    if len(str(out).split()) > 1:
        parser.error(f"--out: make and mkoctfile cannot use a folder with blanks: {out}")
    chosen = [recipe for recipe in RECIPES if not options.name or recipe.name in options.name]
    outcomes = []
    for outcome in run_examples(chosen, Libraries(out)):
        outcomes.append(outcome)
        print(describe(outcome), file=sys.stderr if options.json else sys.stdout, flush=True)
    if options.json:
        print(json.dumps({"examples": [asdict(outcome) for outcome in outcomes]}))
    return int(any(outcome.status == "failed" for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
