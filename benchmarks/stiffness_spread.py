"""Time at equal error over stiffness ratios: the mixed form with error control, in one run.

python benchmarks/stiffness_spread.py [prism] [icosahedron] [--rounds 9]

Scenes, errors and references are those of stiff_bars.py; of the loosest settings that reach the error the
cheapest counts. Times are medians of CPU time in rounds that take turns over the ratios; the spread is the
longest over the shortest.
"""

import argparse
from dataclasses import replace

import stiff_bars
from harness.turns import markdown_head, markdown_row, print_table
from stiff_bars import RADAU, Case, Found, Pair, certify, find_setting, make_contenders, time_in_turns

RATIOS = (1e3, 1e5, 1e7, 1e9)
ERRORS = (1e-4, 1e-5)
NAMES = ("prism", "icosahedron")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="prism, icosahedron; both if none")
    parser.add_argument("--rounds", type=int, default=9)
    words = parser.parse_args()
    stiff_bars.ROUNDS = words.rounds
    print(markdown_head("structure", "error [m]", "ratio", "setting", "error found [m]", "CPU time [ms]"))
    spreads = []
    for name in words.names or NAMES:
        found = measure(name)
        for error in ERRORS:
            rows = {ratio: item for (ratio, wanted), item in found.items() if wanted == error}
            for ratio, item in rows.items():
                cells = (f"{item.setting:.1e}", f"{item.error:.1e}", f"{1e3 * item.seconds:.3f}")
                print(markdown_row(name, f"{error:.0e}", f"{ratio:.0e}", *cells))
            times = [item.seconds for item in rows.values()]
            spread = max(times) / min(times)
            spreads.append((name, f"{error:.0e}", f"{spread:.2f}", "yes" if spread <= 1.3 else "no"))
    print()
    print_table(("structure", "error [m]", "spread", "at most 1.3"), spreads)


def measure(name: str) -> dict[tuple[float, float], Found]:
    """Return the cheapest setting of each ratio and error, timed in turns."""
    found = {}
    for ratio in RATIOS:
        case = Case(name, ratio, 1.0, 0.0, (Pair("our methods", (RADAU,), ()),))
        contenders = make_contenders(case)
        reference = certify(case, contenders)
        for error in ERRORS:
            contender = replace(contenders[RADAU], name=f"{ratio:.0e}, {error:.0e}")
            item = find_setting(contender, reference, error, 60.0)
            if item is None:
                raise SystemExit(f"{name}, ratio {ratio:.0e}: no setting reaches {error:.0e} m")
            found[ratio, error] = item
    time_in_turns(list(found.values()))
    return found


if __name__ == "__main__":
    main()
