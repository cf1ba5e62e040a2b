"""Closed loops of the pinned prism and the tower: simulate_control beside simulate_control_batch.

python benchmarks/control_loops.py

Wall time a draw from lengths with noise, one thread; medians over rounds that take turns. Generating and
compiling the loop is timed apart, for it happens once for all draws.
"""

import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tensegrity_codegen import design_kalman, simulate_control, simulate_control_batch
from tests.control.feedback.pinned_prism import build_prism, design_gains, draw_errors, move_prism
from tests.control.feedback.tower_motion import (
    build_tower,
    design_tower_estimator,
    design_tower_gains,
    draw_tower_errors,
    move_tower,
)

ROUNDS, DRAWS = 5, 8


def prepare_prism() -> tuple[Any, ...]:
    """Return model, motion, gains, estimator, draws and end of the pinned prism."""
    model = build_prism()
    motion = move_prism(model)
    draws = [draw_errors(model, seed, seed) for seed in range(DRAWS)]
    return model, motion, design_gains(model, motion).at_knots(), design_kalman(model, motion), draws, 3.0


def prepare_tower() -> tuple[Any, ...]:
    """Return the same of the tower."""
    model = build_tower()
    motion = move_tower(model)
    gains = design_tower_gains(model, motion)
    estimator = design_tower_estimator(model, motion)
    draws = [draw_tower_errors(model, seed, seed) for seed in range(DRAWS)]
    return model, motion, gains.at_knots(), estimator, draws, 12.0


def measure(run: Callable[[], object]) -> float:
    """Return the wall time of a call [s]."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def compare(name: str, parts: Sequence[Any]) -> None:
    """Print one row."""
    model, motion, gains, estimator, draws, t_end = parts

    def in_c(count: int) -> float:
        chosen = draws[:count]
        return measure(
            lambda: simulate_control_batch(
                model, motion, gains, draws=chosen, estimator=estimator, t_end=t_end, threads=1
            )
        )

    def in_python() -> float:
        return measure(
            lambda: simulate_control(
                model, motion, gains, estimator=estimator, t_end=t_end, disturbance=draws[0]
            )
        )

    first = in_c(1)
    rows = [(in_python(), in_c(1), in_c(DRAWS)) for _ in range(ROUNDS)]
    python = statistics.median(row[0] for row in rows)
    c = statistics.median((row[2] - row[1]) / (DRAWS - 1) for row in rows)
    print(f"| {name} | {1e3 * python:.0f} | {1e3 * c:.2f} | {python / c:.0f} | {first:.1f} |")


def main() -> None:
    """Print the table."""
    print("| loop | Python [ms a draw] | C [ms a draw] | ratio | first call in C, with compiling [s] |")
    print("|---|---|---|---|---|")
    compare("prism, 3 s at 200 Hz", prepare_prism())
    compare("tower, 12 s at 100 Hz", prepare_tower())


if __name__ == "__main__":
    main()
