"""Drift of energy and bar lengths of an undamped prism over a long time, with and without `keep = "energy"`.

python benchmarks/energy_drift.py [seconds]

The prism starts off its equilibrium, with elastic bars a thousand times as stiff as its cables and with rigid
ones; cables go slack and taut. Drifts are the largest at any sample: of the energy over its start, of a rigid
bar's length over that length.
"""

import sys
import time

import numpy as np
from harness.turns import EXAMPLES

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest

SCENE = EXAMPLES / "prism.toml"
RATIO = 1e3
SAMPLES = 1001
RUNS = (("rk54", 1e-6), ("rk853", 1e-6), ("rk853", 1e-9))
MOST_STEPS = 100_000_000


def undamped(structure: Structure) -> Structure:
    """Return the free prism without gravity and damping, its cables shortened, its bars stiff."""
    mu = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    bars = structure.is_bar
    stiff = RATIO * mu[~bars].max()
    n = structure.n_members
    rest = np.where(bars, structure.member_length(), 0.9 * structure.member_length())
    angle = 0.1 * np.sign(structure.node_position[:, 2] - structure.node_position[:, 2].mean())
    turn = np.stack(
        [-angle * structure.node_position[:, 1], angle * structure.node_position[:, 0], 0 * angle], axis=1
    )
    return structure.with_changes(
        node_position=structure.node_position + turn,
        spring_constant=np.where(bars, stiff, mu),
        axial_stiffness=np.zeros(n),
        damping=np.zeros(n),
        rest_length=rest,
        gravity=np.zeros(3),
        node_load=np.zeros_like(structure.node_load),
        node_anchored=np.zeros_like(structure.node_anchored),
        inputs=(),
    )


def compiled(structure: Structure, formulation: str) -> CompiledModel:
    """Return the model of one formulation with both integrators."""
    request = ModelRequest(
        simulation_quantities(formulation),
        integrators=("rk54", "rk853"),
        formulation=formulation,
        options={"bars": "all"} if formulation == "rigid_bar" else {},
        keep=("energy",),
        events=("auto",),
    )
    return build_library(structure, request).load()


def length_drift(model: CompiledModel, position: np.ndarray, is_bar: np.ndarray) -> float:
    """Return the largest relative change of a bar's length over the samples."""
    ends = np.array(model.manifest.connectivity)[is_bar]
    length = np.linalg.norm(position[:, ends[:, 0]] - position[:, ends[:, 1]], axis=2)
    return float(np.abs(length / length[0] - 1.0).max())


def main() -> None:
    """Print one line for each run."""
    span = float(sys.argv[1]) if len(sys.argv) > 1 else 1000.0
    structure = undamped(load_scene(SCENE)[0])
    print(f"prism, {span:g} s, {SAMPLES} samples")
    print(
        "bars       method rtol    keep    status  steps     events   time [s] energy drift  bar length drift"
    )
    for formulation, word in (("node_position", "elastic"), ("rigid_bar", "rigid")):
        model = compiled(structure, formulation)
        for method, tolerance in RUNS:
            for keep in ("energy", ""):
                started = time.perf_counter()
                found = simulate(
                    model, span, samples=SAMPLES, method=method, rtol=tolerance,
                    stepping=Stepping(None, tolerance, MOST_STEPS, keep, "steps"),
                )  # fmt: skip
                seconds = time.perf_counter() - started
                energy = found.total_energy
                drift = np.abs(energy / energy[0] - 1.0).max()
                bars = (
                    length_drift(model, found.node_position, structure.is_bar) if word == "rigid" else np.nan
                )
                print(
                    f"{word:10} {method:6} {tolerance:.0e}  {keep or '-':7} {found.status:7} "
                    f"{found.n_steps:9} {found.log.count:7} {seconds:8.2f}   {drift:9.1e}     {bars:9.1e}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
