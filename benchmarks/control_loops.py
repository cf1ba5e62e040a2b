"""Closed loops of the pinned prism and the tower: simulate_control beside simulate_control_batch.

python benchmarks/control_loops.py [--write]

Wall time a draw from lengths with noise, one thread; medians over rounds that take turns. Generating and
compiling the loop is timed apart, for it happens once for all draws.
"""

import sys
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from harness.turns import draw_bars, find_about, measure_call, publish, table_text, take_turns

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


def compare(name: str, parts: Sequence[Any]) -> tuple[str, ...]:
    """Return one row."""
    model, motion, gains, estimator, draws, t_end = parts

    given = {"estimator": estimator, "t_end": t_end}

    def in_c(count: int) -> float:
        call = partial(simulate_control_batch, model, motion, gains, draws=draws[:count], threads=1, **given)
        return measure_call(call, clock=time.perf_counter)

    def in_python() -> float:
        call = partial(simulate_control, model, motion, gains, **given, disturbance=draws[0])
        return measure_call(call, clock=time.perf_counter)

    first = in_c(1)
    turns = take_turns({"Python": in_python, "one": partial(in_c, 1), "all": partial(in_c, DRAWS)}, ROUNDS)
    python = np.median(turns["Python"])
    c = np.median(turns["all"] - turns["one"]) / (DRAWS - 1)
    return (name, f"{1e3 * python:.0f}", f"{1e3 * c:.2f}", f"{python / c:.0f}", f"{first:.1f}")


def main() -> None:
    """Print the table, and write it if asked to."""
    heads = ("loop", "Python [ms a draw]", "C [ms a draw]", "ratio", "first call in C, with compiling [s]")
    rows = [
        compare("prism, 3 s at 200 Hz", prepare_prism()),
        compare("tower, 12 s at 100 Hz", prepare_tower()),
    ]
    finding = f"Loops in C take {' and '.join(f'{row[2]} ms a draw ({row[0]})' for row in rows)}"
    ratios = [row[3] for row in rows]
    parts = (draw_bars("loop", heads[2]), table_text(heads, rows), find_about(__doc__))
    finding += f", {' and '.join(ratios)} times as fast as `simulate_control`"
    publish("control_measured.md", finding, *parts, write="--write" in sys.argv)


if __name__ == "__main__":
    main()
