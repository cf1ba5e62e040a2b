"""Co-simulation of an exported unit in 1,000 communication steps, beside our own loop with 1,000 samples.

python benchmarks/fmu_steps.py [prism] [tower] [--rounds 15] [--rtol 1e-6]

Both integrate the same motion with the same method, tolerance of each step, and times at which the state is
known. The loop is one call into C; the unit is called once for each communication step, through ctypes, whose
share is in the times (about 0.5 us a call). Medians of rounds that take turns.
"""

import argparse
import ctypes as c
import tempfile
import time
from pathlib import Path

import numpy as np
from harness.turns import EXAMPLES, measure_call, take_turns

from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_length
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tests.export.importer import Unit2

N_STEPS = 1000


def compare(scene: Path, t_end: float, rtol: float, rounds: int, folder: Path) -> None:
    """Print the times of both, their ratio and the largest difference of a coordinate."""
    out = folder / f"{scene.stem}.fmu"
    exported = export_fmu(scene, out, rtol=rtol, t_end=t_end)
    method = exported.facts["method"]
    model = compile_scene(scene, for_="simulate", method=method)
    state = np.concatenate([model.nominal("coordinate").ravel(), model.nominal("velocity").ravel()])
    options = set_atol_by_length(model.manifest, RunOptions(method=method, rtol=rtol, control="steps"))
    unit = Unit2(out, folder / scene.stem, "cs")
    names = [name for name in unit.reference if name.startswith("coordinate.")]
    do_step, instance, size = unit.library.fmi2DoStep, unit.instance, c.c_double(t_end / N_STEPS)
    points = [c.c_double(k * t_end / N_STEPS) for k in range(N_STEPS)]

    def integrate() -> RawTrajectory:
        return integrate_adaptive(Motion(model, state, np.linspace(0.0, t_end, N_STEPS + 1), {}), options)

    def step_through() -> None:
        for point in points:
            do_step(instance, point, size, 1)

    def time_steps() -> float:
        unit.good("Reset")
        unit.start(rtol)
        return measure_call(step_through, clock=time.perf_counter)

    times = take_turns(
        {"loop": lambda: measure_call(integrate, clock=time.perf_counter), "unit": time_steps}, rounds
    )
    raw = integrate()
    error = float(np.abs(unit.get(*names) - raw.state[-1, : len(names)]).max())
    ours, theirs = (float(np.median(seconds)) for seconds in times.values())
    print(
        f"{scene.stem}: {method}, {t_end:g} s, rtol {rtol:g}: "
        f"loop {1e3 * ours:.2f} ms ({raw.n_steps} steps), "
        f"unit {1e3 * theirs:.2f} ms, ratio {theirs / ours:.2f}, largest difference {error:.1e} m"
    )
    unit.free()


def main() -> None:
    """Compare the units of some example scenes with our own loop."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*", default=["prism", "tower"])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--rtol", type=float, default=1e-6)
    parser.add_argument("--t-end", type=float, default=1.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for scene in given.scenes:
            path = Path(scene) if scene.endswith(".toml") else EXAMPLES / f"{scene}.toml"
            compare(path, given.t_end, given.rtol, given.rounds, Path(name))


if __name__ == "__main__":
    main()
