"""The common prism over 5 s: error at the end and time, beside MuJoCo's RK4 at 1 ms in the same run.

python benchmarks/common_prism.py        needs the package mujoco (extra `bench`)

Errors are the largest of all node coordinates at 5 s, against the reference in tests/common_prism.py.
Times are medians of CPU time over rounds that take turns, of whole runs: ours with the call from Python,
MuJoCo's one call of mj_step.
"""

from collections.abc import Callable

import mujoco
import numpy as np
from harness.turns import print_table, time_in_turns
from numpy.typing import NDArray

from tensegrity_codegen.export.rigid_parts import numbers
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.tables.request import ModelRequest
from tests.common_prism import BARS, PLACES, POSITION, STRINGS, common_prism

FloatArray = NDArray[np.float64]
SECONDS, ROUNDS = 5.0, 9
OURS = tuple((name, tol) for name in ("rk54", "rk853") for tol in (1e-5, 2e-6, 1e-6, 1e-8, 1e-10, 1e-12))


def main() -> None:
    """Print one row a method and tolerance: error, time, ratio to MuJoCo's, events, evaluations."""
    integrators = ("rk54", "rk853")
    request = ModelRequest(
        SIMULATION_QUANTITIES, formulation="rigid_bar", integrators=integrators, events=("auto",)
    )
    model = build_library(common_prism(), request, flags="native").load()
    end = POSITION[-1].reshape(6, 3)
    runs: dict[str, Callable[[], FloatArray]] = {"MuJoCo RK4 1 ms": lambda: run_mujoco(1e-3)}
    for name, tol in OURS:
        runs[f"{name} {tol:.0e}"] = ours(model, name, tol, None)
    runs["rk853 1e-10, no events"] = ours(model, "rk853", 1e-10, Watch())
    errors = {name: float(np.abs(run() - end).max()) for name, run in runs.items()}
    times = time_in_turns(runs, ROUNDS)
    rows = [
        (name, f"{errors[name]:.1e}", f"{1e3 * taken:.3f}", f"{times['MuJoCo RK4 1 ms'] / taken:.1f}")
        for name, taken in times.items()
    ]
    print_table(("run", "error at 5 s [m]", "ms", "times faster than MuJoCo"), rows)
    good = [times[name] for name in times if errors[name] <= 3e-7 and not name.startswith("MuJoCo")]
    print(f"\nerror <= 3e-7 m: {times['MuJoCo RK4 1 ms'] / min(good):.1f} times faster; asked for: 25")


def ours(model: CompiledModel, name: str, tol: float, watch: Watch | None) -> Callable[[], FloatArray]:
    """Return a run of one of our methods, from the start to the node positions at the end."""
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    motion = Motion(model, state, np.array([0.0, SECONDS]), watch=watch)

    def run() -> FloatArray:
        found = integrate_adaptive(motion, RunOptions(name, tol, tol / 10))
        return found.state[-1, :18].reshape(6, 3)

    return run


def run_mujoco(step: float) -> FloatArray:
    """Return MuJoCo's node positions at the end: free rods with sites at their ends, pulling tendons."""
    if step not in _MODELS:
        _MODELS[step] = mujoco.MjModel.from_xml_string(_describe(step))
    model = _MODELS[step]
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(SECONDS / step))
    mujoco.mj_forward(model, data)
    return np.array([data.site(f"n{k}").xpos for k in range(6)])


_MODELS: dict[float, mujoco.MjModel] = {}


def _describe(step: float) -> str:
    bodies = []
    for first, second in BARS:
        middle, half = (PLACES[first] + PLACES[second]) / 2, (PLACES[second] - PLACES[first]) / 2
        length = 2 * float(np.linalg.norm(half))
        across, along = length**2 / 12, 1e-6  # a thin rod of 1 kg; MuJoCo wants some inertia about its axis
        turn = np.zeros(4)
        mujoco.mju_quatZ2Vec(turn, half / np.linalg.norm(half))
        sites = "".join(
            f'<site name="n{node}" pos="0 0 {sign * length / 2!r}"/>'
            for node, sign in ((first, -1), (second, 1))
        )
        bodies.append(
            f'<body pos="{numbers(middle)}" quat="{numbers(turn)}"><freejoint/>'
            f'<inertial pos="0 0 0" mass="1" diaginertia="{across!r} {across!r} {along!r}"/>{sites}</body>'
        )
    tendons = []
    for first, second in STRINGS:
        rest = 0.95 * float(np.linalg.norm(PLACES[first] - PLACES[second]))
        sites = f'<site site="n{first}"/><site site="n{second}"/>'
        tendons.append(f'<spatial stiffness="100" springlength="0 {rest!r}">{sites}</spatial>')
    return (
        f'<mujoco><option timestep="{step!r}" integrator="RK4" gravity="0 0 0"/>'
        f"<worldbody>{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
    )


if __name__ == "__main__":
    main()
