"""Random scenes and settings: whoever calls a result good is within ten times its tolerance, and in time.

python benchmarks/fuzz.py [--examples 2000] [--seed 0] [--limit 2]

Prints every finding with what was drawn, so that it can be drawn again, and a count of verdicts at the end.
Exit code 1 if there is a finding.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tensegrity_codegen.studies.stability.run import Limits
from tests.studies.fuzz import Example, examples, run_example

GRACE = 2.0  # seconds beyond its limit that a run may take until it looks at the clock


def main() -> None:
    """Draw examples and run them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=float, default=2.0, help="seconds that one run may take")
    words = parser.parse_args()
    limits = Limits(run=words.limit, reference=2 * words.limit, peers=False, compiles=False)
    counts: Counter[str] = Counter()
    rules: Counter[str] = Counter()
    slowest, started = 0.0, time.process_time()

    @seed(words.seed)
    @settings(
        max_examples=words.examples,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(examples())
    def draw(example: Example) -> None:
        nonlocal slowest
        try:
            outcome = run_example(example, limits)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            print(f"crash: {error!r} at {place.filename}:{place.lineno}\n  {example!r}", flush=True)
            counts["crash"] += 1
            return
        slowest = max(slowest, outcome.seconds)
        counts[outcome.verdict] += 1
        rules[outcome.rule or "not certified"] += 1
        if outcome.verdict == "over time":
            print(f"over time: {example!r}", flush=True)
        if outcome.verdict == "wrong" or outcome.seconds > words.limit + GRACE:
            counts["finding"] += 1
            print(f"{outcome.verdict}, {outcome.error} times the tolerance, {outcome.seconds:.1f} s")
            print(f"  {example!r}\n  {outcome.contender}: {outcome.status}, {outcome.message}", flush=True)
        if (sum(counts.values()) - counts["finding"]) % 50 == 0:
            print(dict(counts), dict(rules), f"{time.process_time() - started:.1f} s", flush=True)

    draw()
    print(f"{sum(counts.values()) - counts['finding']} examples: {dict(counts)}; longest run {slowest:.1f} s")
    print(f"certified by rules: {dict(rules)}")
    sys.exit(1 if counts["finding"] or counts["crash"] else 0)


if __name__ == "__main__":
    main()
