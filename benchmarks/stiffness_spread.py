"""Time at equal error over stiffness ratios: the mixed form with error control, in one run.

python benchmarks/stiffness_spread.py [prism] [icosahedron] [--rounds 9] [--write]

Scenes, errors and references are those of stiff_bars.py; of the loosest settings that reach the error the
cheapest counts. Times are medians of CPU time in rounds that take turns over the ratios; the spread is the
longest over the shortest.
"""

import argparse
from dataclasses import replace

import stiff_bars
from harness.turns import draw_bars, find_about, publish, table_text
from stiff_bars import RADAU, Case, Found, Pair, certify, find_setting, make_contenders, time_in_turns

RATIOS = (1e3, 1e5, 1e7, 1e9)
ERRORS = (1e-4, 1e-5)
NAMES = ("prism", "icosahedron")
PAGE = "stiffness.md"
HEADS = ("structure", "error [m]", "ratio", "setting", "error found [m]", "CPU time [ms]")


def main() -> None:
    """Print the table, and write it if asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="prism, icosahedron; both if none")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    words = parser.parse_args()
    stiff_bars.ROUNDS = words.rounds
    rows: list[tuple[str, ...]] = []
    spreads: list[float] = []
    for name in words.names or NAMES:
        found = measure(name)
        for error in ERRORS:
            chosen = {ratio: item for (ratio, wanted), item in found.items() if wanted == error}
            for ratio, item in chosen.items():
                cells = (f"{item.setting:.1e}", f"{item.error:.1e}", f"{1e3 * item.seconds:.3f}")
                rows.append((name, f"{error:.0e}", f"{ratio:.0e}", *cells))
            times = [item.seconds for item in chosen.values()]
            spreads.append(max(times) / min(times))
    finding = (
        f"At one error the time of `radau` spreads by {min(spreads):.2f} to {max(spreads):.2f} while "
        "bars become "
        f"{RATIOS[-1] / RATIOS[0]:,.0f} times as stiff"
    )
    bars = draw_bars(", ".join(HEADS[:3]), HEADS[-1])
    publish(PAGE, finding, bars, table_text(HEADS, rows), find_about(__doc__), write=words.write)


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
