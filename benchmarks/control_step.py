"""Time of one step of controllers in C, and of its parts: the pinned prism and the two-stage tower.

python benchmarks/control_step.py [--steps 100000] [--write]

Steps are driven by the measurements of a noisy simulated closed loop, again and again. Each one is timed by
the CPU time of its thread, less the time of reading that clock. Of five rounds the one is shown in which
other programs disturbed least: with the smallest ratio of the 99 % to the median. Parts are timed in loops.
"""

import argparse
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from harness.turns import draw_bars, find_about, publish, table_text

from tensegrity_codegen.codegen.compilation.flags import build_program_command, find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.loop.tension_distribution import (
    TensionDistribution,
    design_distribution,
)
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.control.feedback.pinned_prism import build_prism, design_gains, draw_errors, move_prism
from tests.control.feedback.tower_motion import (
    build_tower,
    design_tower_estimator,
    design_tower_gains,
    draw_tower_errors,
    move_tower,
)

HEADS = (
    "controller",
    "median [us]",
    "99 % below [us]",
    "over the median",
    "largest [us]",
    "parts [us]",
    "memory [byte]",
)
DRIVER = Path(__file__).resolve().parent / "harness" / "control_step.c"
ROUNDS = 5
KINDS = ("true state", "measurements", "measurements and tensions")


@dataclass(frozen=True)
class Case:
    """A structure with its motion, feedback and estimator, and the errors of one draw."""

    model: CompiledModel
    motion: Motion
    gains: Gains
    estimator: Estimator
    distribution: TensionDistribution
    t_end: float
    errors: Disturbance


def main() -> None:
    """Print one row for each controller, and write them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--write", action="store_true", help="write into docs/control_measured.md")
    words = parser.parse_args()
    rows = []
    for case in (make_prism(), make_tower()):
        for kind in KINDS:
            found = time_steps(case, words.steps, kind)
            parts = ("motion", "gains", "predict", "correct", "distribute")
            shown = ", ".join(f"{part} {1e6 * found[part]:.2f}" for part in parts if part in found)
            median, aside = 1e6 * found["median"], 1e6 * found["part99"]
            numbers = (f"{median:.2f}", f"{aside:.2f}", f"{aside / median:.2f}", f"{1e6 * found['most']:.1f}")
            title = f"{case.model.manifest.name}, {kind}"
            rows.append((title, *numbers, shown, f"{found['memory']:.0f}"))
    slow, fast = (choose(rows, key=lambda row: float(row[1])) for choose in (max, min))
    finding = (
        f"A step of a controller in C takes {fast[1]} us ({fast[0]}) to {slow[1]} us ({slow[0]}) at the "
        "median, "
        f"99 % take less than {max(float(row[2]) for row in rows):g} us"
    )
    page = (draw_bars(HEADS[0], HEADS[1]), table_text(HEADS, rows), find_about(__doc__))
    publish("control_measured.md", finding, *page, write=words.write)


def make_prism() -> Case:
    """Return the pinned prism at 200 Hz."""
    model = build_prism("control")
    motion = move_prism(model)
    estimator = design_kalman(model, motion, sample=0.005)
    tensions = design_distribution(model, motion, least_tension=10.0)
    return Case(
        model, motion, design_gains(model, motion), estimator, tensions, 3.0, draw_errors(model, 1, 1)
    )


def make_tower() -> Case:
    """Return the two-stage tower at 100 Hz."""
    model = build_tower()
    motion = move_tower(model)
    gains = design_tower_gains(model, motion)
    estimator = design_tower_estimator(model, motion)
    tensions = design_distribution(model, motion, least_tension=1.0)
    return Case(model, motion, gains, estimator, tensions, 12.0, draw_tower_errors(model, 1, 1))


def time_steps(case: Case, steps: int, kind: str) -> dict[str, float]:
    """Return the times [s] of the steps of a controller and of its parts by name."""
    estimator = None if kind == "true state" else case.estimator
    distribution = case.distribution if kind == KINDS[2] else None
    run = simulate_control(
        case.model,
        case.motion,
        case.gains.at_knots(),
        estimator=estimator,
        distribution=distribution,
        t_end=case.t_end,
        disturbance=case.errors,
    )
    rows = np.hstack([run.coordinate, run.velocity])[:-1]
    if estimator is not None:
        n, sensing = run.coordinate.shape[1], case.estimator.sensing
        noise = np.random.default_rng(1)
        given = [sensing.measure({"coordinate": row[:n], "velocity": row[n:], "input": u})
                 for row, u in zip(rows, run.input, strict=True)]  # fmt: skip
        rows = np.array(given) + sensing.noise * noise.normal(size=(len(given), len(sensing.noise)))
    with tempfile.TemporaryDirectory() as folder:
        return drive(case, {"estimator": estimator, "distribution": distribution}, rows, steps, Path(folder))


def drive(case: Case, parts: dict[str, Any], rows: np.ndarray, steps: int, folder: Path) -> dict[str, float]:
    """Build a controller and a program around it, run it, and return what it prints in its best round."""
    bundle = build_controller(
        case.model, case.motion, case.gains, **parts, out=folder / "ctl", code=ControllerCode(library=False)
    )
    has_estimator = parts["estimator"] is not None
    name = f"{bundle.description.name}_control"
    rows.astype(np.float64).tofile(folder / "rows")
    models = sorted(file for file in bundle.files if file.endswith("_model.c"))
    command = build_program_command(find_compiler(), find_flags("reference"), (str(DRIVER), *models), "drive")
    settings = {
        "SOURCE": f'"{name}.c"',
        "MEMORY": name,
        "INIT": f"{name}_init",
        "STEP": f"{name}_step" if has_estimator else f"{name}_step_state",
        "WIDTH": rows.shape[1],
        "WITH_GAINS": 1,
        "WITH_FILTER": int(has_estimator),
        "WITH_TENSIONS": int(parts["distribution"] is not None),
    }
    defined = [f"-D{key}={value}" for key, value in settings.items()]
    subprocess.run([*command, "-I.", *defined, "-lm"], cwd=folder / "ctl", check=True)
    program = [str(folder / "ctl" / "drive"), str(steps), str(len(rows)), str(folder / "rows")]
    rounds = []
    for _ in range(ROUNDS):
        done = subprocess.run(program, capture_output=True, text=True, check=True)
        rounds.append({line.split()[0]: float(line.split()[1]) for line in done.stdout.splitlines()})
    best = min(rounds, key=lambda found: found["part99"] / found["median"])
    return best | {part: best[part] - best["init"] for part in ("predict", "correct") if part in best}


if __name__ == "__main__":
    main()
