"""Random scenes and settings: a result called good is within ten times its tolerance, and in time.

python benchmarks/fuzz.py [--examples 2000] [--seed 0] [--far] [--first 0] [--limit 2]
python benchmarks/fuzz.py --number 3071992 [--far]

With --far every second example lies 1e2 m to 1e7 m from the origin. Example k of a seed is the same in every
run, so that parts may run side by side: --first is the first one. A finding is printed with its number, which
draws it again, and with what was drawn. A count of verdicts comes at the end. Exit code 1 if there is a
finding.
"""

import argparse
import sys
import time
import traceback
from collections import Counter

import numpy as np

from tensegrity_codegen.studies.stability.judge import Limits
from tests.studies.test_fuzz import draw_example, run_example

GRACE = 2.0  # seconds beyond its limit that a run may take until it looks at the clock
LARGEST = 2**62


class Tally:
    """What the examples so far came to."""

    def __init__(self, limits: Limits, *, far: bool) -> None:
        self.limits, self.far = limits, far
        self.verdicts: Counter[str] = Counter()
        self.rules: Counter[str] = Counter()
        self.findings, self.slowest, self.started = 0, 0.0, time.process_time()

    def add(self, number: int, *, talks: bool = False) -> None:
        """Run the example of a number; print it if it is a finding, or if `talks`."""
        example = draw_example(number, far=self.far)
        try:
            outcome = run_example(example, self.limits)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            print(f"crash: {error!r} at {place.filename}:{place.lineno}", flush=True)
            self._say(number, repr(example))
            return
        self.slowest = max(self.slowest, outcome.seconds)
        self.verdicts[outcome.verdict] += 1
        self.rules[outcome.rule or "not certified"] += 1
        is_finding = outcome.verdict == "wrong" or outcome.seconds > self.limits.run + GRACE
        if is_finding or talks or outcome.verdict == "over time":
            print(f"{outcome.verdict}, {outcome.error} times the tolerance, {outcome.seconds:.1f} s")
            told = f"  {outcome.contender}: {outcome.status}, {outcome.message}"
            self._say(number, f"{example!r}\n{told}", is_finding=is_finding)

    def _say(self, number: int, text: str, *, is_finding: bool = True) -> None:
        self.findings += is_finding
        print(f"  --number {number}{' --far' if self.far else ''}: {text}", flush=True)

    def progress(self) -> str:
        """Return the counts so far."""
        seconds = time.process_time() - self.started
        return f"{dict(self.verdicts)} {dict(self.rules)} {self.findings} findings, {seconds:.1f} s"


def main() -> None:
    """Draw examples and run them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--examples", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="which example of the seed is the first")
    parser.add_argument("--far", action="store_true", help="half of the examples far from the origin")
    parser.add_argument("--number", type=int, action="append", help="this example only, in full")
    parser.add_argument("--limit", type=float, default=2.0, help="seconds that one run may take")
    words = parser.parse_args()
    limits = Limits(run=words.limit, reference=2 * words.limit, peers=False, compiles=False)
    tally = Tally(limits, far=words.far)
    for number in words.number or ():
        tally.add(number, talks=True)
    for index in () if words.number else range(words.first, words.first + words.examples):
        tally.add(int(np.random.default_rng([words.seed, index]).integers(LARGEST)))
        if (index - words.first) % 50 == 49:
            print(tally.progress(), flush=True)
    print(f"{sum(tally.verdicts.values())} examples: {tally.progress()}; longest run {tally.slowest:.1f} s")
    sys.exit(1 if tally.findings else 0)


if __name__ == "__main__":
    main()
