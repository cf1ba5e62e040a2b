"""Model-predictive control in C: time of a step, and what it gains over stored gains.

python benchmarks/mpc.py [--write]

Times are thread CPU time of single steps in the states of simulated loops, compiled as by `build_controller`
and with -O3 -march=native. Errors are the largest of any coordinate; the loops are those of the acceptance
tables of feedback (tests/control/feedback): starts off by about 1 deg, stiffnesses off by 5 %, gusts of 5 N.
"""

import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from harness.turns import draw_bars, find_about, publish, table_text

from tensegrity_codegen import (
    ActuatorLimits,
    ControllerCode,
    Disturbance,
    Gust,
    build_controller,
    design_distribution,
    design_lqr,
    design_mpc,
    simulate_control,
    simulate_control_batch,
)
from tensegrity_codegen.control.feedback.loop.sampled_plant import SampledPlant
from tensegrity_codegen.system.errors import InvalidValueError
from tests.control.feedback.pinned_prism import build_prism, draw_errors, move_prism
from tests.control.feedback.tower_motion import build_tower, draw_tower_errors, move_tower

DRAWS = 5
TIMES = ("controller", "flags", "median [ms]", "99 % below [ms]", "steps with a limit", "not solved")
LOOPS = ("errors on the way, at the end; least tension; commands cut", "LQR", "MPC")
NATIVE = ("gcc", "-std=c99", "-O3", "-march=native", "-fPIC", "-shared")


class Case:
    """A structure with its motion, regulator and model-predictive control of the same weights."""

    def __init__(
        self, name: str, model: Any, motion: Any, draws: list[Disturbance], sample: float, least: float | None
    ) -> None:
        self.name, self.model, self.motion, self.draws, self.sample = name, model, motion, draws, sample
        n, self.m = len(model.manifest.coordinate_name), len(motion.actuators)
        self.weights = np.concatenate([np.full(n, 100.0), np.full(n, 0.1), np.full(n, 10.0)])
        self.gains = self.design(design_lqr)
        self.mpc = self.design(design_mpc, least_tension=least)

    def design(self, how: Any, **options: Any) -> Any:
        """Return feedback of one kind: all coordinates are summed."""
        names = self.model.manifest.coordinate_name
        return how(
            self.model, self.motion, self.weights, np.full(self.m, 1e6), sample=self.sample,
            integral_action=names, **options,
        )  # fmt: skip

    def simulate(self, feedback: Any, draws: list[Disturbance] | None = None, **options: Any) -> list[Any]:
        """Return the runs of all draws."""
        return list(
            simulate_control_batch(
                self.model, self.motion, feedback, draws=draws or self.draws,
                t_end=3.0 * self.motion.duration if self.name == "prism" else 7.0, compare=False, **options,
            )
        )  # fmt: skip


def time_steps(case: Case, mpc: Any, native: bool) -> tuple[str, ...]:
    """Return flags, median and 99 % of the time of a step in the states of two simulated loops."""
    runs = case.simulate(mpc, case.draws[:2])
    folder = Path(tempfile.mkdtemp()) / "controller"
    bundle = build_controller(case.model, case.motion, mpc, out=folder, code=ControllerCode(name="ahead"))
    if native:
        sources = ("ahead_control.c", "ahead_control_model.c", "-lm")
        subprocess.run([*NATIVE, "-o", bundle.description.library, *sources], cwd=folder, check=True)
    controller, spent, words = bundle.load(), [], Counter()
    for run in runs:
        controller.init()
        for k in range(int(case.motion.duration / case.sample)):
            state = np.concatenate([run.coordinate[k], run.velocity[k]])
            before = time.thread_time_ns()
            word, _ = controller.step_state(k * case.sample, state)
            spent.append(1e-6 * (time.thread_time_ns() - before))
            words[word] += 1
    middle, high = np.quantile(spent, [0.5, 0.99])
    limited = sum(count for word, count in words.items() if word != "ok")
    flags = "-O3 -march=native" if native else "as built"
    counts = (f"{limited} of {len(spent)}", f"{words['not_solved']}")
    return (flags, f"{middle:.2f}", f"{high:.2f}", *counts)


def measure(case: Case, runs: list[Any], last: float = 0.5) -> str:
    """Return largest errors on the way after a second and at the end, and least tensions."""
    way, ends = [], []
    for run in runs:
        reference = np.array([case.motion.at(t).coordinate for t in run.time.tolist()])
        error = np.abs(run.coordinate - reference).max(axis=1)
        way.append(error[run.time > 0.2].max())
        ends.append(error[run.time > run.time[-1] - last].max())
    cables = ~np.asarray(case.model.structure.is_bar)
    least = min(float(run.member_tension[:, cables].min()) for run in runs)
    words = Counter(word for run in runs for word in run.step_status)
    cut = sum(words[word] for word in ("rate_limited", "range_limited")) / sum(words.values())
    return f"{max(way):.2e}, {max(ends):.1e}; {least:.2f} N; {100 * cut:.0f} % cut"


def follow(case: Case, feedback: Any, offset: Any) -> str:
    """Return the error to a target that moves while the loop runs: offset(time) from the motion's start."""
    folder = Path(tempfile.mkdtemp()) / "controller"
    controller = build_controller(case.model, case.motion, feedback, out=folder).load()
    controller.init()
    point = case.motion.at(0.0)
    n, errors = len(point.coordinate), []
    plant = SampledPlant(case.model, np.concatenate([point.coordinate, point.velocity]), {}, None)
    for k in range(int(2.0 / case.sample)):
        now, state = k * case.sample, plant.state
        reference = case.motion.at(now).coordinate
        errors.append(np.abs(state[:n] - reference - offset(now)).max())
        if feedback is case.mpc:
            for i, value in enumerate(offset(now)):
                controller._memory.mpc.target[i] = value
            controller.step_state(now, state)
        else:
            controller.step_state(now, state - np.concatenate([offset(now), np.zeros(n)]))
        value = case.motion.at(now).input.copy()
        places = [case.model.manifest.input_name.index(name) for name in case.motion.actuators]
        value[places] = list(controller._memory.command)
        plant.advance(now, now + case.sample, value)
    return f"{np.max(errors[20:]):.2e}, mean {np.mean(errors):.2e}, {errors[-1]:.1e} at the end"


def main() -> None:
    """Print both tables, and write them if asked to."""
    prism_model, tower_model = build_prism(), build_tower()
    prism = Case(
        "prism", prism_model, move_prism(prism_model),
        [draw_errors(prism_model, seed) for seed in range(DRAWS)], 0.005, None,
    )  # fmt: skip
    tower = Case(
        "tower", tower_model, move_tower(tower_model),
        [draw_tower_errors(tower_model, seed) for seed in range(DRAWS)], 0.01, -np.inf,
    )  # fmt: skip
    least = tower.design(design_mpc, least_tension=1.0)
    cases = ((prism, prism.mpc, "prism, 9 motors"), (tower, tower.mpc, "tower, 18 motors"),
             (tower, least, "tower, least tensions of 1 N"))  # fmt: skip
    times = [(name, *time_steps(case, mpc, native)) for case, mpc, name in cases for native in (False, True)]
    loops: list[tuple[str, ...]] = []

    def row(name: str, *texts: str) -> None:
        loops.append((name, *texts))
        print(*loops[-1], sep=" | ", flush=True)

    for case in (prism, tower):
        row(f"{case.name}", *(measure(case, case.simulate(item)) for item in (case.gains, case.mpc)))
        for delay in (0.01, 0.02):
            late = ActuatorLimits(delay=delay)
            gains = case.design(design_lqr, delay=delay)
            texts = [measure(case, case.simulate(item, limits=late)) for item in (gains, case.mpc)]
            row(f"{case.name}, {1000 * delay:g} ms delay", *texts)
    slow = ActuatorLimits(rate=0.02)
    for case in (prism, tower):
        try:
            text = measure(case, case.simulate(case.gains, limits=slow))
        except InvalidValueError as error:
            text = f"refused: {error.given}"
        row(f"{case.name}, rate 0.02 m/s", text, measure(case, case.simulate(case.mpc, limits=slow)))
    # A push that would slacken cables, against the regulator with its distribution of tensions.
    push = [Disturbance(gust=Gust("bar1_B", tuple(25.0 * np.array(way)), 1.2, 0.3))
            for way in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]  # fmt: skip
    spread = design_distribution(prism.model, prism.motion, least_tension=2.0)
    careful = prism.design(design_mpc, least_tension=2.0)
    plain = measure(prism, prism.simulate(prism.gains, push))
    free = prism.design(design_mpc, least_tension=-np.inf)
    kept = [simulate_control(prism.model, prism.motion, prism.gains, distribution=spread, disturbance=item,
                             t_end=3.0, compare=False) for item in push]  # fmt: skip
    row("prism, push of 25 N, no least tensions", plain, measure(prism, prism.simulate(free, push)))
    row("the same, least tension 2 N", measure(prism, kept), measure(prism, prism.simulate(careful, push)))

    def offset(time: float) -> Any:
        return np.radians(2.0) * np.sin(2.0 * np.pi * time) * np.ones(6)

    row(
        "prism, target that swings by 2 deg at 1 Hz",
        *(follow(prism, item, offset) for item in (prism.gains, prism.mpc)),
    )
    slow, fast = (choose(times, key=lambda row: float(row[2])) for choose in (max, min))
    finding = (
        f"A step of model-predictive control takes {fast[2]} ms ({fast[0]}, {fast[1]}) to {slow[2]} ms "
        f"({slow[0]}, "
        f"{slow[1]}) at the median, 99 % take less than {max(float(cells[3]) for cells in times):g} ms"
    )
    parts = (draw_bars("controller, flags", TIMES[2]), table_text(TIMES, times), table_text(LOOPS, loops))
    publish("control_measured.md", finding, *parts, find_about(__doc__), write="--write" in sys.argv)


if __name__ == "__main__":
    main()
