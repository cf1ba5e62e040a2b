"""The loops of the acceptance tables of feedback again, with delays of the actuators that the gains know.

python benchmarks/control_delays.py [prism] [tower] [spine] [--write]

End errors of the draws of tests/control/feedback, simulated in C. Ratios to those without delay: of the
largest errors of all draws, and the largest one of a draw. The spine needs the files of NTRT that its test
needs, and half an hour with OPENBLAS_NUM_THREADS=1, much more with more threads on a busy machine.
"""

import sys
import time
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from harness.turns import draw_bars, find_about, publish, table_text

from tensegrity_codegen import (
    ActuatorLimits,
    Disturbance,
    Gust,
    design_distribution,
    design_kalman,
    simulate_control_batch,
)
from tests.control.feedback import pinned_prism, test_spine_feedback, tower_motion

DRAWS = 20
DELAYS = (0.0, 0.005, 0.01, 0.02)  # [s]
ROWS: list[tuple[str, ...]] = []
HEADS = (
    "loop",
    "delay",
    "least end [deg]",
    "worst end [deg]",
    "over no delay",
    "of one draw",
    "least tension [N]",
    "not ok",
)


def print_rows(
    name: str,
    parts: Sequence[Any],
    parameters: dict[str, Any],
    find_end: Callable[[Any], float],
    since: float,
) -> None:
    """Add least and largest error at the end, ratio and least tension of a loop, for each delay.

    parts: model, motion, gains as a function of the delay, draws.
    """
    model, motion, design, draws = parts
    cables = ~np.asarray(model.structure.is_bar)
    first = np.zeros(0)
    for delay in DELAYS:
        started = time.perf_counter()
        runs = simulate_control_batch(
            model, motion, design(delay), draws=draws, limits=ActuatorLimits(delay=delay), compare=False,
            **parameters,
        )  # fmt: skip
        assert all(run.status == "ok" for run in runs), [run.message for run in runs]
        ends = np.array([find_end(run) for run in runs])
        first = ends if delay == 0.0 else first
        tension = min(float(run.least_tension(since)[cables].min()) for run in runs)
        cut = np.mean([word != "ok" for run in runs for word in run.step_status])
        ROWS.append(
            (
                name, f"{1000 * delay:g} ms", f"{ends.min():.4f}", f"{ends.max():.4f}",
                f"{ends.max() / first.max():.2f}", f"{(ends / first).max():.2f}", f"{tension:.1f}",
                f"{100 * cut:.1f} %",
            )
        )  # fmt: skip
        print(*ROWS[-1], f"{time.perf_counter() - started:.0f} s", sep=", ", flush=True)


def run_prism() -> None:
    """Add the rows of the pinned prism, with a distribution of tensions too."""
    model = pinned_prism.build_prism()
    motion = pinned_prism.move_prism(model)
    draws = [pinned_prism.draw_errors(model, seed, seed) for seed in range(DRAWS)]
    gains = cache(lambda delay: pinned_prism.design_gains(model, motion, delay=delay))
    lengths, biased = design_kalman(model, motion), design_kalman(model, motion, disturbance=0.0)
    spread = design_distribution(model, motion, least_tension=10.0)
    find_end = lambda run: float(np.degrees(run.worst_error(0.5)))  # noqa: E731
    show = partial(print_rows, find_end=find_end, since=1.0)
    for name, options in (
        ("true state", {}),
        ("lengths, 0.5 mm", {"estimator": lengths}),
        ("lengths, 0.5 mm, `disturbance=0`", {"estimator": biased}),
        ("true state, least tension 10 N", {"distribution": spread}),
        ("lengths, 0.5 mm, least tension 10 N", {"estimator": lengths, "distribution": spread}),
    ):
        show(f"prism: {name}", (model, motion, gains, draws), {"t_end": 3.0, **options})
    # The push of the table of distributions.
    push = [
        Disturbance(
            axial_stiffness=pinned_prism.STIFFNESS * np.array([1.05 if e % 2 else 0.95 for e in range(12)]),
            gust=Gust("bar2_B", (4.0, 0.0, 0.0), 1.2, 0.3),
        )
    ]
    for name, options in (("pushed", {}), ("pushed, least tension 10 N", {"distribution": spread})):
        show(f"prism: {name}", (model, motion, gains, push), {"t_end": 3.0, **options}, since=1.1)


def run_tower() -> None:
    """Add the rows of the tower of two stages."""
    model = tower_motion.build_tower()
    motion = tower_motion.move_tower(model)
    angles = tower_motion.find_angles(model)
    draws = [tower_motion.draw_tower_errors(model, seed, seed) for seed in range(DRAWS)]
    gains = cache(lambda delay: tower_motion.design_tower_gains(model, motion, delay=delay))
    find_end = lambda run: float(np.degrees(run.worst_error(1.0, angles)))  # noqa: E731
    for name, noise in (("true state", 0.0), ("lengths, 0.1 mm", 1e-4), ("lengths, 0.5 mm", 5e-4)):
        estimator = tower_motion.design_tower_estimator(model, motion, noise) if noise else None
        options = {"t_end": 12.0, "estimator": estimator}
        print_rows(f"tower: {name}", (model, motion, gains, draws), options, find_end, 7.0)


def run_spine() -> None:
    """Add the rows of the spine of NTRT."""
    model = test_spine_feedback.build_spine()
    motion = test_spine_feedback.bend(model)
    draws = [test_spine_feedback.draw_errors(model, seed, seed) for seed in range(DRAWS)]
    gains = cache(lambda delay: test_spine_feedback.design_gains(model, motion, delay=delay))

    def find_end(run: Any) -> float:
        late, goal = run.time >= run.time[-1] - 0.5, run.coordinate - run.error
        return float(test_spine_feedback.find_turns(model, run.coordinate[late], goal[late]).max())

    design = partial(test_spine_feedback.design_estimator, model, motion)
    estimators = {
        "true state": None, "lengths, 0.5 mm": design(),
        "lengths, 0.5 mm, `disturbance=0`": design(disturbance=0.0),
    }  # fmt: skip
    for name, estimator in estimators.items():
        options = {"t_end": 5.0, "estimator": estimator}
        print_rows(f"spine: {name}", (model, motion, gains, draws), options, find_end, 1.0)


def main(words: Sequence[str]) -> None:
    """Print the table, and write it if asked to."""
    runs = {"prism": run_prism, "tower": run_tower, "spine": run_spine}
    chosen = [word for word in words if word in runs] or list(runs)
    for name in chosen:
        runs[name]()
    without = [row for row in ROWS if row[1] == "0 ms"]
    worst = max(without, key=lambda row: float(row[3]))
    slowest = max(ROWS, key=lambda row: float(row[4]))
    finding = (
        f"With feedback loops end within {min(float(row[3]) for row in without):g} to {worst[3]} deg (worst: "
        f"{worst[0]}); delays that the gains know make that at most {slowest[4]} times as large "
        f"({slowest[0]}, "
        f"{slowest[1]})"
    )
    bars = draw_bars("loop, delay", HEADS[3])
    parts = (bars, table_text(HEADS, ROWS), find_about(__doc__))
    publish("control_measured.md", finding, *parts, write="--write" in words)


if __name__ == "__main__":
    main(sys.argv[1:])
