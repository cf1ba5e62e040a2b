"""Steps of model-predictive control by acados and by our C, in turns: the pinned prism and the tower.

python benchmarks/mpc_against_acados.py [--case prism] [--only hpipm]

Needs acados (https://docs.acados.org) and its Python package, with ACADOS_SOURCE_DIR set. The package writes
both: the project of `export_acados` and the controller of `build_controller`, compiled with the same flags.
From each of 200 states about the motion both go on from their own plan of the state before. Times are thread
CPU time of a step, median / 99 %; setting references, bounds and the plan is not in those of acados. Not
solved: steps whose quadratic program ends at the largest number of iterations or fails, which acados itself
does not report as a failed step.
"""

import argparse
import contextlib
import importlib.util
import io
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness.turns import markdown_head, markdown_row
from numpy.typing import NDArray

from tensegrity_codegen import (
    CompiledModel,
    ControllerCode,
    Motion,
    Mpc,
    build_controller,
    design_mpc,
    export_acados,
)
from tests.control.feedback.pinned_prism import build_prism, move_prism
from tests.control.feedback.tower_motion import TOWER_SAMPLE, build_tower, move_tower

Array = NDArray[np.float64]
NATIVE = ("gcc", "-std=c99", "-O3", "-march=native", "-fPIC", "-shared")
CASES = {
    "prism": (build_prism, move_prism, 0.005, 5.0),
    "tower": (build_tower, move_tower, TOWER_SAMPLE, 1.0),
}  # sample [s], least tension [N]
BLOCKS, FREE = (1, 1, 2, 4, 12), (1,) * 20
STAGES = {"qp_solver": "PARTIAL_CONDENSING_HPIPM"}
BY_BLOCKS = {"qp_solver_cond_N": len(BLOCKS), "qp_solver_cond_block_size": [*BLOCKS, 0]}
# Blocks, a solver of the project's script, what differs.
ROWS: dict[str, tuple[tuple[int, ...], str, dict[str, Any]]] = {
    "blocks, hpipm, condensed": (BLOCKS, "hpipm", {}),
    "blocks, hpipm, a stage a block": (BLOCKS, "hpipm", STAGES | BY_BLOCKS),
    "blocks, daqp, condensed": (BLOCKS, "daqp", {}),
    "free, hpipm, 20 stages": (FREE, "hpipm", STAGES),
}
STATES = 200
WARM_UP = 10  # steps that are not counted
SWING, FREQUENCY = 2e-3, 0.7  # of the states about the motion [rad or m, Hz]
OFFSET = 2e-4  # of the command before a state from the motion's [m]


def list_states(motion: Motion, mpc: Mpc) -> list[tuple[Array, Array, Array]]:
    """Return state, sums and command before of states about the motion, one for each sample.

    At time t = i sample coordinates are those of the motion + SWING sin(w t + phase), with their rates;
    commands before are the motion's half a sample earlier + OFFSET sin(w t + their phase); the sums go on
    from sample to sample.
    """
    n, turn = len(mpc.coordinate_range), 2 * np.pi * FREQUENCY
    phase = np.random.default_rng(1).uniform(0.0, 2 * np.pi, n + len(mpc.R))
    given, sums = [], np.zeros(len(mpc.gains.integral_action))
    for now in (mpc.gains.sample * np.arange(STATES)).tolist():
        point, angle = motion.at(now), turn * now + phase
        error = SWING * np.concatenate([np.sin(angle[:n]), turn * np.cos(angle[:n])])
        before = motion.at(now - 0.5 * mpc.gains.sample).input + OFFSET * np.sin(angle[n:])
        given.append((np.concatenate([point.coordinate, point.velocity]) + error, sums, before))
        sums = sums + mpc.gains.integral_action @ error
    return given


def make_peer(model: CompiledModel, motion: Motion, mpc: Mpc, row: str, folder: Path) -> Any:
    """Return the controller of the exported script."""
    export_acados(model, motion, mpc, out=folder)
    spec = importlib.util.spec_from_file_location("make_solver", folder / "make_solver.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    _, solver, options = ROWS[row]
    with contextlib.redirect_stdout(io.StringIO()):
        return script.Controller(script.make_solver(**script.SOLVERS[solver] | options))


def compare(model: CompiledModel, motion: Motion, mpc: Mpc, row: str, folder: Path) -> list[str]:
    """Return the cells of a row: times, their ratio, differences of commands and plans, steps not solved."""
    peer = make_peer(model, motion, mpc, row, folder / "peer")
    code = ControllerCode(name="ahead", qp_iterations=1000)
    bundle = build_controller(model, motion, mpc, out=folder / "ours", code=code)
    sources = ("ahead_control.c", "ahead_control_model.c", "-lm")
    subprocess.run([*NATIVE, "-o", bundle.description.library, *sources], cwd=bundle.folder, check=True)
    controller = bundle.load()
    controller.init()
    memory, n, m = controller._memory, 2 * len(mpc.coordinate_range), len(mpc.R)
    spent: dict[str, list[float]] = {"acados": [], "ours": []}
    differences, unsolved = [], 0
    for k, (state, sums, before) in enumerate(list_states(motion, mpc)):
        peer.begin(k, state, sums, before)
        since = time.thread_time_ns()
        peer.solver.solve()
        spent["acados"].append(1e-3 * (time.thread_time_ns() - since))
        unsolved += peer.read() != 0
        for place, value in enumerate(sums.tolist()):
            memory.deviation[n + place] = value
        for place, value in enumerate(before.tolist()):
            memory.command[place] = memory.sent[place] = memory.sent[m + place] = value
        since = time.thread_time_ns()
        word, _ = controller.step_state(k * mpc.gains.sample, state)
        spent["ours"].append(1e-3 * (time.thread_time_ns() - since))
        unsolved += word == "not_solved"
        plan = np.array(list(memory.mpc.state)).reshape(-1, n)
        command = np.array(list(memory.command))
        differences.append((np.abs(command - peer.command).max(), np.abs(plan - peer.state).max()))
        peer.shift()
    quantiles = {name: np.quantile(times[WARM_UP:], [0.5, 0.99]) for name, times in spent.items()}
    away = np.max(differences, axis=0)
    return [
        *("{:.0f} / {:.0f}".format(*quantiles[name]) for name in ("acados", "ours")),
        f"{quantiles['ours'][0] / quantiles['acados'][0]:.2f}",
        f"{away[0]:.1e} m, {away[1]:.1e}",
        str(unsolved),
    ]


def main() -> None:
    """Print one row for each structure, form and solver."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", choices=CASES, action="append")
    parser.add_argument("--only", default="", help="rows whose form and solver contain this")
    options = parser.parse_args()
    heads = ("acados [us]", "ours [us]", "ratio", "commands, plans differ by", "not solved")
    print(markdown_head("case, form, solver", *heads))
    for case in options.case or CASES:
        build, move, sample, tension = CASES[case]
        model = build()
        motion, names = move(model), model.manifest.coordinate_name
        weight = np.concatenate([np.full(len(names), value) for value in (100.0, 0.1, 10.0)])
        for row, (blocks, *_) in ROWS.items():
            if options.only in row:
                mpc = design_mpc(
                    model, motion, weight, np.full(len(motion.actuators), 1e6), sample=sample, blocks=blocks,
                    integral_action=names, least_tension=tension,
                )  # fmt: skip
                with tempfile.TemporaryDirectory() as folder:
                    cells = compare(model, motion, mpc, row, Path(folder))
                print(markdown_row(f"{case}, {row}", *cells), flush=True)


if __name__ == "__main__":
    main()
