"""Many cases of one prism by `sweep`, beside the bare batch functions and other ways to compute them.

python benchmarks/sweep.py [--only equilibria|motions|evaluations] [--rounds 3] [--part 1.0] [--peers 40]
                           [--write]

equilibria: 10,000 over load and prestress. motions: 1,000 of 1 s over stiffness and start, bars a thousand
times as stiff as cables, positions at the end within 1e-5 m of Runge-Kutta 8(5,3) at a tolerance of 1e-11.
evaluations: a million tensions, rest lengths and places at random, with the largest memory of a process.

All in one run, round by round, medians; wall seconds and CPU seconds, of children too. Planning and compiling
come before and are shown apart. `sweep` writes its results to disk; the bare functions write an .npz file.
Other ways compute a few of the cases (--peers), and count as if the others took as long.
"""

import argparse
import os
import shutil
import statistics
import tempfile
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from harness.turns import EXAMPLES, draw_bars, find_about, publish, table_text
from numpy.typing import NDArray
from scipy import integrate, optimize

from tensegrity_codegen import find_equilibrium, simulate, symbolic_functions
from tensegrity_codegen.analyses.cases.record import CaseAnalysis
from tensegrity_codegen.analyses.cases.registry import build_analysis
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.sweeps.cases.build_cases import build_cases
from tensegrity_codegen.sweeps.engines.work import library_request, select_arguments
from tensegrity_codegen.sweeps.sweep import PreparedSweep, prepare_sweep

FloatArray = NDArray[np.float64]

SCENE = EXAMPLES / "prism.toml"
PAGE = "sweep_measured.md"
HEADS = ("cases", "way", "cases a second", "wall, each [ms]", "CPU, each [ms]", "rate over the first")
ERROR = 1e-5  # [m] of positions at the end of motions
CHECKED = 16  # motions whose error is looked at
STEPS = (1e-4, 5e-5, 2.5e-5, 1e-5, 5e-6)  # [s] of MuJoCo
Way = Callable[[], int]  # computes, and returns how many cases


@dataclass(frozen=True)
class Work:
    """Cases of one kind: what a sweep of them is, and what the library takes for them."""

    scene: dict[str, Any]
    options: dict[str, Any]
    operation: CaseAnalysis
    model: Any
    arguments: dict[str, FloatArray]
    count: int
    folder: Path

    def prepare(self, workers: int) -> PreparedSweep:
        """Return the sweep, planned."""
        return prepare_sweep(
            self.scene, build_cases(**self.options), self.operation, workers=workers, yes=True
        )

    def of_case(self, k: int) -> dict[str, FloatArray]:
        """Return the arguments of one case."""
        return {name: array[k] for name, array in self.arguments.items()}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", choices=tuple(KINDS), default=None)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--part", type=float, default=1.0, help="of the cases")
    parser.add_argument("--peers", type=int, default=40, help="cases of other ways")
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    given = parser.parse_args()
    rows: list[tuple[str, ...]] = []
    folder = Path(tempfile.mkdtemp(prefix="sweep-benchmark-"))
    try:
        for name in (given.only,) if given.only else KINDS:
            rows += [(name, *cells) for cells in KINDS[name](folder, given)]
    finally:
        shutil.rmtree(folder)
    parts = (draw_bars("cases, way", HEADS[2]), table_text(HEADS, rows), find_about(__doc__))
    publish(PAGE, describe_finding(rows), *parts, write=given.write)


def describe_finding(rows: Sequence[Sequence[str]]) -> str:
    """Return for each kind the rate of two workers over those of the batch function and the fastest other."""
    words = []
    for kind in dict.fromkeys(row[0] for row in rows):
        rates = {row[1]: float(row[2].replace(",", "")) for row in rows if row[0] == kind}
        two = next((rate for way, rate in rates.items() if way.startswith("sweep, 2")), None)
        others = {way: rate for way, rate in rates.items() if not way.startswith(("sweep", "batch"))}
        if two and others:
            best = max(others, key=lambda way: others[way])
            batch = next(rate for way, rate in rates.items() if way.startswith("batch"))
            words.append(
                f"{kind}: {two / batch:.2g} times the rate of the batch function on one core, "
                f"{two / others[best]:.2g} "
                f"times that of the fastest other way ({best})"
            )
    return f"A sweep with two workers, {'; '.join(words)}"


def make_work(folder: Path, scene: dict[str, Any], operation: CaseAnalysis, **options: Any) -> Work:
    """Return the cases of a sweep with their library and arguments."""
    started = time.perf_counter()
    cases = build_cases(**options)
    group = prepare_sweep(scene, cases, operation, workers=1, yes=True).planned.work.plan.groups[0]
    library = prepare_library(group, operation)
    applied = group.arguments(cases.values(0, cases.count))
    arguments = {name: np.asarray(array) for name, array in select_arguments(library, applied).items()}
    spent = time.perf_counter() - started
    print(f"\n{operation.name}: {cases.count} cases; planned and compiled in {spent:.1f} s", flush=True)
    return Work(scene, options, operation, library, arguments, cases.count, folder)


def prepare_library(group: Any, operation: CaseAnalysis) -> Any:
    """Return the library of a group of cases."""
    from tensegrity_codegen.pipeline.build_library import build_library

    return build_library(group.structure, library_request(group, operation)).load()


def compare(ways: dict[str, Way], rounds: int, first: str) -> list[tuple[str, ...]]:
    """Print and return medians of all ways, run in rounds; ratios are to the rate of the first."""
    rows = []
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            wall, cpu = time.perf_counter(), sum(os.times()[:4])
            count = way()
            spent = (time.perf_counter() - wall, sum(os.times()[:4]) - cpu)
            seconds[name].append((spent[0] / count, spent[1] / count))
    wall_of = {name: statistics.median(item[0] for item in found) for name, found in seconds.items()}
    print(f"{'':44} {'cases a second':>15} {'wall, each':>12} {'CPU, each':>12} {'rate':>7}")
    for name, found in seconds.items():
        cpu = statistics.median(item[1] for item in found)
        wall = wall_of[name]
        times = f"{1e3 * wall:9.4f} ms {1e3 * cpu:9.4f} ms"
        print(f"{name:44} {1 / wall:15.1f} {times} {wall_of[first] / wall:7.3g}", flush=True)
        cells = (f"{1 / wall:,.1f}", f"{1e3 * wall:.4g}", f"{1e3 * cpu:.4g}", f"{wall_of[first] / wall:.3g}")
        rows.append((name, *cells))
    return rows


def list_sweeps(work: Work) -> dict[str, Way]:
    """Return the bare operation of one core, writing a file, and sweeps with one and two workers."""

    def bare() -> int:
        result = work.operation.run(work.model, work.arguments, work.count)
        np.savez(work.folder / "bare.npz", status=result.status, **result.arrays)
        return work.count

    def swept(prepared: PreparedSweep) -> int:
        out = work.folder / "sweep.zarr"
        outcome = prepared.run(out)
        shutil.rmtree(out)
        assert sum(outcome.counts.values()) == work.count
        return work.count

    ways: dict[str, Way] = {"batch function, 1 core, to .npz": bare}
    for workers in (1, 2):
        prepared = work.prepare(workers)
        ways[f"sweep, {workers} worker{'s'[: workers - 1]}"] = lambda prepared=prepared: swept(prepared)
    return ways


def read_scene() -> dict[str, Any]:
    """Return the prism of the examples, bars without mass, which springs of MuJoCo do not have."""
    scene = tomllib.loads(SCENE.read_text(encoding="utf-8"))
    for key in ("density", "radius", "inner_radius"):
        del scene["classes"]["bar"][key]
    return scene


# --- equilibria --------------------------------------------------------------------------------------


def equilibria(folder: Path, given: argparse.Namespace) -> list[tuple[str, ...]]:
    """Compare ways to find equilibria over load and prestress."""
    side = max(2, round(100 * given.part**0.5))
    over = {"loads[0].force[2]": f"-6:0:{side}", "shape.prestress": f"5:12:{side}"}
    work = make_work(folder, read_scene(), build_analysis("equilibrium"), over=over)
    chosen = np.linspace(0, work.count - 1, min(given.peers, work.count)).astype(int).tolist()
    ways = list_sweeps(work)

    def alone() -> int:
        for k in chosen:
            find_equilibrium(work.model, arguments=work.of_case(k))
        return len(chosen)

    ways["find_equilibrium in a loop"] = alone
    ways["scipy.optimize.root over CasADi functions"] = _make_root(work, chosen)
    return compare(ways, given.rounds, "batch function, 1 core, to .npz")


def _functions(work: Work, *quantities: str) -> tuple[Any, list[list[FloatArray]]]:
    """Return CasADi functions of the scene, and their arguments behind the state for each case."""
    manifest = work.model.manifest
    names = [name for name in work.arguments if name not in ("coordinate", "velocity")]
    index = {
        name: tuple(
            (manifest.node_name if item in manifest.node_name else manifest.member_name).index(item)
            for item in manifest.argument(name).over
        )
        for name in names
    }
    return symbolic_functions(work.scene, quantities=quantities, parameters=index), names


def _make_root(work: Work, chosen: list[int]) -> Way:
    functions, _ = _functions(work, "node_residual", "tangent_stiffness")
    residual, stiffness = functions["node_residual"], functions["tangent_stiffness"]
    start = work.model.nominal("coordinate")

    def call(function: ca.Function, place: FloatArray, own: dict[str, FloatArray]) -> Any:
        values = [place if name == "coordinate" else own[name].T for name in function.name_in()]
        return function(*values)

    def root() -> int:
        for k in chosen:
            own = work.of_case(k)
            optimize.root(
                lambda q, own=own: -np.array(call(residual, q, own)).ravel(),
                start,
                jac=lambda q, own=own: call(stiffness, q, own).full(),
                method="lm",  # the others stop at the singular stiffness of a structure that slides
                tol=1e-10,
            )
        return len(chosen)

    return root


# --- motions -----------------------------------------------------------------------------------------


def motions(folder: Path, given: argparse.Namespace) -> list[tuple[str, ...]]:
    """Compare ways to integrate motions over stiffness and start."""
    side = max(2, round((1000 * given.part) ** 0.5))
    over = {"classes.cable.spring_constant": f"150:250:{side}", "node_velocity.t1[2]": f"-0.5:0.5:{side}"}
    keep, span = ("node_position.final", "member_tension.max"), {"t_end": 1.0, "samples": 11}
    exact = build_analysis("simulate", keep, rtol=1e-11, atol=1e-12, **span)
    work = make_work(folder, read_scene(), exact, over=over)
    looked = np.linspace(0, work.count - 1, min(CHECKED, work.count)).astype(int)
    some = {name: array[looked] for name, array in work.arguments.items()}
    end = exact.run(work.model, some, len(looked)).arrays["node_position_final"]
    for rtol in 10.0 ** -np.arange(2.0, 10.0, 0.5):
        operation = build_analysis("simulate", keep, rtol=float(rtol), atol=float(rtol), **span)
        found = operation.run(work.model, some, len(looked)).arrays["node_position_final"]
        if np.abs(found - end).max() <= ERROR:
            break
    print(f"tolerance {rtol:.1e}: error {np.abs(found - end).max():.1e} m in {len(looked)} motions")
    work = Work(work.scene, work.options, operation, work.model, work.arguments, work.count, folder)
    chosen = np.linspace(0, work.count - 1, min(given.peers, work.count)).astype(int).tolist()
    ways = list_sweeps(work) | _list_single(work, chosen, float(rtol))
    ways["solve_ivp (DOP853) over CasADi functions"] = _make_solve_ivp(work, chosen[:4], float(rtol))
    ways |= _list_mujoco(work, chosen, looked, end)
    return compare(ways, given.rounds, "batch function, 1 core, to .npz")


def run_alone(work: Work, k: int, rtol: float) -> FloatArray:
    """Return the end of one motion by `simulate`."""
    own = work.of_case(k)
    start = {name: own.pop(name) for name in ("coordinate", "velocity") if name in own}
    options = {"method": "rk853", "rtol": rtol, "stepping": Stepping(atol=rtol, control="steps")}
    return simulate(work.model, 1.0, samples=11, arguments=own, **start, **options).node_position[-1]


def _list_single(work: Work, chosen: list[int], rtol: float) -> dict[str, Way]:
    """Return `simulate` in a loop, and in threads of joblib."""
    ways: dict[str, Way] = {"simulate in a loop": lambda: len([run_alone(work, k, rtol) for k in chosen])}
    try:
        import joblib
    except ImportError:
        print("not installed: joblib")
        return ways

    def parallel() -> int:
        pool = joblib.Parallel(n_jobs=2, prefer="threads")
        return len(pool(joblib.delayed(run_alone)(work, k, rtol) for k in chosen))

    return {**ways, "joblib over simulate, 2 threads": parallel}


def _make_solve_ivp(work: Work, chosen: list[int], rtol: float) -> Way:
    functions, _ = _functions(work, "acceleration")
    function, n = functions["acceleration"], len(work.model.nominal("coordinate"))

    def rate(state: FloatArray, own: dict[str, FloatArray]) -> FloatArray:
        given = {**own, "coordinate": state[:n], "velocity": state[n:]}
        values = [given[name].T for name in function.name_in()]
        return np.concatenate([state[n:], np.array(function(*values)).ravel()])

    def solve() -> int:
        for k in chosen:
            own = work.of_case(k)
            parts = (own.pop(name, work.model.nominal(name)) for name in ("coordinate", "velocity"))
            start, options = np.concatenate(list(parts)), {"rtol": rtol, "atol": rtol}
            integrate.solve_ivp(lambda _, x, own=own: rate(x, own), (0.0, 1.0), start, "DOP853", **options)
        return len(chosen)

    return solve


def _list_mujoco(work: Work, chosen: list[int], looked: Any, end: FloatArray) -> dict[str, Way]:
    """Return MuJoCo's rollout of several models at the longest step that meets the error, if it is there."""
    try:
        import mujoco
        from mujoco import rollout
    except ImportError:
        print("not installed: mujoco")
        return {}
    from tensegrity_codegen.studies.work_precision.peers.mujoco_tendons import write_model

    mujoco.set_mju_user_warning(lambda _: None)
    base, manifest = work.model.structure, work.model.manifest

    def make(k: int, step: float) -> tuple[Any, FloatArray]:
        changed = {}
        for name in ("spring_constant", "rest_length"):
            values = getattr(base, name).copy()
            values[[manifest.member_name.index(item) for item in manifest.argument(name).over]] = (
                work.arguments[name][k]
            )
            changed[name] = values
        model = mujoco.MjModel.from_xml_string(write_model(base.with_changes(**changed), "RK4"))
        model.opt.timestep = step
        data = mujoco.MjData(model)
        data.qvel[:] = work.arguments["velocity"][k]
        for node in range(base.n_nodes):  # a load, as a second gravity of its body
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"s{node}")
            data.xfrc_applied[model.site_bodyid[site], :3] = base.node_load[node]
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        return model, state

    def roll(cases: list[int], step: float, threads: int) -> FloatArray:
        made = [make(k, step) for k in cases]
        models = [model for model, _ in made]
        control = int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
        size = mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        first = np.array([_full(mujoco, model, state) for model, state in made])
        force = np.zeros((len(cases), 1, 6 * models[0].nbody))
        for row, (model, state) in enumerate(made):
            force[row, 0] = _force(mujoco, model, state)
        force = np.repeat(force, round(1.0 / step), axis=1)
        data = [mujoco.MjData(models[0]) for _ in range(threads)]
        states, _ = rollout.rollout(models, data, first, force, control_spec=control)
        assert states.shape[2] == size
        nq = models[0].nq
        return np.asarray(states[:, -1, 1 : 1 + nq])

    start = work.model.nominal("coordinate")
    places = manifest.coordinate_place
    wanted = end[:, places[:, 0], places[:, 1]]
    for step in STEPS:
        error = float(np.abs(start + roll(looked.tolist()[:4], step, 1) - wanted[:4]).max())
        if error <= ERROR:
            break
    print(f"MuJoCo RK4, step {step:.1e} s: error {error:.1e} m in 4 motions")
    few = chosen[:8]
    return {
        f"MuJoCo rollout, {threads} thread{'s'[: threads - 1]}": lambda threads=threads: len(
            roll(few, step, threads)
        )
        for threads in (1, 2)
    }


def _full(mujoco: Any, model: Any, state: FloatArray) -> FloatArray:
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    full = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, full, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return full


def _force(mujoco: Any, model: Any, state: FloatArray) -> FloatArray:
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    return np.array(data.xfrc_applied).ravel()


# --- evaluations -------------------------------------------------------------------------------------


def evaluations(folder: Path, given: argparse.Namespace) -> list[tuple[str, ...]]:
    """Show how long tensions of a Monte Carlo sample take, and how much memory."""
    sample = {f"rest_length.vertical{k}": "normal(0.2, 1e-3)" for k in (1, 2, 3)}
    rows: list[tuple[str, ...]] = []
    sample |= {"node_position.t1[2]": "normal(0.3, 1e-3)", "node_position.t2[2]": "normal(0.3, 1e-3)"}
    for count in (round(1e5 * given.part), round(1e6 * given.part)):
        operation = build_analysis("evaluate", "member_tension")
        options: dict[str, Any] = {"sample": sample, "n": count, "seed": 1, "yes": True}
        cases = build_cases(**options)
        started = time.perf_counter()
        prepared = prepare_sweep(read_scene(), cases, operation, workers=2, yes=True)
        planned = time.perf_counter() - started
        started = time.perf_counter()
        prepared.run(folder / f"tensions{count}.zarr")
        spent = time.perf_counter() - started
        memory = [_peak(kind) for kind in ("self", "children")]
        print(
            f"\nevaluate: {count} tensions, 2 workers: planned in {planned:.1f} s, computed and written in "
            f"{spent:.1f} s; largest memory: {memory[0]:.0f} MB here, {memory[1]:.0f} MB in a worker",
            flush=True,
        )
        way = f"sweep, 2 workers, {count:,} cases: at most {max(memory):.0f} MB a process"
        rows.append((way, f"{count / spent:,.1f}", f"{1e3 * spent / count:.4g}", "", ""))
    return rows


def _peak(kind: str) -> float:
    """Return the largest memory so far of this process, or of any child [MB]."""
    import resource

    who = resource.RUSAGE_SELF if kind == "self" else resource.RUSAGE_CHILDREN
    return resource.getrusage(who).ru_maxrss / 1024


KINDS = {"evaluations": evaluations, "equilibria": equilibria, "motions": motions}

if __name__ == "__main__":
    main()
