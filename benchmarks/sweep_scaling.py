"""How a sweep scales to 1,000 workers: measured overhead, measured tasks, and a simulation of the queue.

python benchmarks/sweep_scaling.py [--quick] [--write]   needs distributed

Measured on this machine: processor time of Dask's scheduler (and of the client, in the same process) for an
empty task on a LocalCluster; processor time of tasks of several sizes on one core, fitted by a + b n; time to
write the results of a task to the store, in memory (which the simulation uses) and on disk. The simulation
has a queue for the scheduler, one for the writing of results, and any number of workers; it prints the
overhead of each batch size, and the least batch size whose overhead is below 5 %.
"""

import heapq
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from harness.turns import EXAMPLES, draw_bars, find_about, publish, table_text

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, TaskResult
from tensegrity_codegen.analyses.equilibrium import FindEquilibrium
from tensegrity_codegen.analyses.evaluate import Evaluate
from tensegrity_codegen.analyses.simulate import Simulate
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.store.store import StoreContents, SweepStore, create_store

PAGE = "sweep_measured.md"
WORKERS = (1, 10, 100, 1000)
SIZES = (64, 256, 1024, 4096, 16384)
TASKS_OF_A_WORKER = 50
WRITES = 40  # of which the least time counts
LONGEST = 1.0  # [s] of a task that is measured
LIMIT = 0.05  # of the overhead
AHEAD = 2  # tasks under way for each worker, as in the engine


@dataclass(frozen=True)
class Costs:
    """Times [s]: of the scheduler and of writing for each task, of a task as fixed + per_case * n.

    latency: from the order to the start of a task; spread: standard deviation of a task's time over its mean.
    """

    scheduler: float
    write: float
    write_per_case: float
    fixed: float
    per_case: float
    latency: float = 0.0
    spread: float = 0.0


@dataclass(frozen=True)
class Row:
    """Measured times [s] of a task with so many cases: on a core; to write its results to memory and disk."""

    size: int
    seconds: float
    write: float
    disk: float


def simulate_queue(
    costs: Costs, workers: int, size: int, tasks: int, *, ahead: int = AHEAD, seed: int = 0
) -> float:
    """Return the time [s] from the first order to the last result that is written.

    As the engine works: at most `ahead` tasks for each worker are under way; the scheduler passes on one
    after the other; the client writes one result after the other, and orders another task after each. Task
    times scatter as a gamma distribution.
    """
    durations = _draw_durations(costs, size, tasks, seed)
    writing = costs.write + costs.write_per_case * size
    free = [0.0] * workers  # when each worker is free; a heap
    ends: list[float] = []  # of the tasks under way; a heap
    scheduler = written = 0.0
    ordered = 0

    def order(now: float) -> None:
        nonlocal scheduler, ordered
        scheduler = max(scheduler, now) + costs.scheduler
        start = max(scheduler + costs.latency, heapq.heappop(free))
        heapq.heappush(free, start + durations[ordered])
        heapq.heappush(ends, start + durations[ordered])
        ordered += 1

    for _ in range(min(tasks, ahead * workers)):
        order(0.0)
    while ends:
        written = max(written, heapq.heappop(ends)) + writing
        if ordered < tasks:
            order(written)
    return written


def _draw_durations(costs: Costs, size: int, tasks: int, seed: int) -> list[float]:
    mean = costs.fixed + costs.per_case * size
    if costs.spread <= 0.0:
        return [mean] * tasks
    shape = costs.spread**-2
    return [float(value) for value in np.random.default_rng(seed).gamma(shape, mean / shape, tasks)]


def compute_overhead(
    costs: Costs, workers: int, size: int, tasks_of_a_worker: int = TASKS_OF_A_WORKER
) -> float:
    """Return the part of the workers' time in which they compute no cases, 0 to 1."""
    tasks = workers * tasks_of_a_worker
    spent = workers * simulate_queue(costs, workers, size, tasks)
    return 1.0 - tasks * size * costs.per_case / spent


def find_least_size(costs: Costs, workers: int, limit: float = LIMIT) -> int | None:
    """Return the least of the sizes 8, 16, 32, ... whose overhead is below the limit; None up to 2^24."""
    for power in range(3, 25):
        if compute_overhead(costs, workers, 2**power) < limit:
            return int(2**power)
    return None


def fit_line(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Return (a, b) >= 0 of y = a + b x, each point weighted by 1/y^2."""
    from scipy.optimize import nnls

    weight = 1.0 / np.asarray(y)
    table = np.stack([weight, weight * np.asarray(x)], axis=1)
    (a, b), _ = nnls(table, np.ones(len(weight)))
    return float(a), float(b)


# --- measurements ------------------------------------------------------------------------------------


def do_nothing(number: int) -> int:
    """Return the number: an empty task."""
    return number


def measure_scheduler(counts: Sequence[int]) -> tuple[float, float, float]:
    """Return processor and wall time of scheduler and client for a task [s], and latency of one task [s]."""
    from distributed import Client, LocalCluster

    rows = []
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit=0) as cluster,
        Client(cluster) as client,
    ):
        client.gather(client.map(do_nothing, range(500), pure=False))
        for count in counts:
            wall, cpu = time.perf_counter(), time.process_time()
            client.gather(client.map(do_nothing, range(count), pure=False))
            rows.append((count, time.perf_counter() - wall, time.process_time() - cpu))
        latency = min(_time_one(client) for _ in range(50))
    _, wall_each = fit_line([row[0] for row in rows], [row[1] for row in rows])
    _, cpu_each = fit_line([row[0] for row in rows], [row[2] for row in rows])
    return cpu_each, wall_each, latency


def _time_one(client: Any) -> float:
    start = time.perf_counter()
    client.submit(do_nothing, 1, pure=False).result()
    return time.perf_counter() - start


def measure_calls(run: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Return median processor time of a call [s], and the deviation of its times over it."""
    run()
    times = []
    for _ in range(rounds):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return statistics.median(times), float(np.std(times) / np.mean(times))


def prepare_operations() -> Iterator[tuple[str, CaseAnalysis, CompiledModel]]:
    """Yield name, operation and library of the example prism."""
    structure, request = load_scene(EXAMPLES / "prism.toml")
    for name, operation in (
        ("evaluate, tensions", Evaluate(keep=("member_tension",))),
        ("equilibrium, largest tension", FindEquilibrium(keep=("max(member_tension)",))),
        ("equilibrium, usual results", FindEquilibrium()),
        ("simulate 1 s, largest tension", Simulate(t_end=1.0, keep=("max(member_tension).max",))),
    ):
        wanted = operation.needs(structure, request).alone(request)
        yield name, operation, build_library(structure, wanted).load()


def measure_operation(
    operation: CaseAnalysis,
    model: CompiledModel,
    sizes: Sequence[int],
    rounds: int,
    folders: tuple[Path, Path],
) -> tuple[list[Row], float]:
    """Return a row of times for each size of a task, and the relative scatter of the largest task's times."""
    start = model.nominal("coordinate")
    rng = np.random.default_rng(0)
    rows, scatter = [], 0.0
    for size in sizes:
        if rows and rows[-1].seconds * size > LONGEST * rows[-1].size:
            break
        arguments = {"coordinate": start + 1e-3 * rng.normal(size=(size, len(start)))}
        result = operation.run(model, arguments, size)
        run = partial(operation.run, model, arguments, size)
        seconds, scatter = measure_calls(run, rounds)
        rest = (operation, model, result, size)
        rows.append(
            Row(size, seconds, *(measure_write(*rest, folder / f"{size}.zarr") for folder in folders))
        )
    return rows, scatter


def measure_write(
    operation: CaseAnalysis, model: CompiledModel, result: TaskResult, size: int, path: Path
) -> float:
    """Return the least wall time [s] to write the results of a task of this size to a new store.

    Other work on the machine and its disk only adds to it, in bursts; processor times are free of that.
    """
    cases = Cases((Axis("number", np.arange(float(size * WRITES))),))
    layout = CaseLayout.of(cases.shape, size)
    create_store(path, StoreContents(cases, layout, operation.outputs(model.manifest), {}))
    store = SweepStore(path)
    times = []
    for task in range(layout.n_tasks):
        start = time.perf_counter()
        store.write(task, result, {})
        times.append(time.perf_counter() - start)
    return min(times)


def describe_operation(name: str, rows: Sequence[Row], costs: Costs) -> str:
    """Return the measured times of an operation, and what the simulation uses of them."""
    heads = ("cases a task", "task [ms]", "a case [us]", "writing, to memory [ms]", "to this disk [ms]")
    cells = [
        (row.size, *(f"{value:.3g}" for value in
                     (1e3 * row.seconds, 1e6 * row.seconds / row.size, 1e3 * row.write, 1e3 * row.disk)))
        for row in rows
    ]  # fmt: skip
    most = costs.per_case / costs.write_per_case if costs.write_per_case > 0.0 else np.inf
    fit = (
        f"Fit: {1e3 * costs.fixed:.3g} ms + {1e6 * costs.per_case:.3g} us a case; writing "
        f"{1e3 * costs.write:.3g} "
        f"ms + {1e6 * costs.write_per_case:.3g} us a case, so that results of at most {most:,.0f} "
        "workers can be "
        f"written at their rate; times of equal tasks scatter by {100 * costs.spread:.0f} %."
    )
    return f"### {name}\n\n{table_text(heads, cells)}\n\n{fit}"


def list_overheads(name: str, costs: Costs, sizes: Sequence[int]) -> list[tuple[str, ...]]:
    """Return the overhead of each size for each number of workers, and the least size below the limit."""
    rows = [
        (name, f"{size:,}", *(f"{100 * compute_overhead(costs, workers, size):.0f}" for workers in WORKERS))
        for size in sizes
    ]
    least = [find_least_size(costs, workers) for workers in WORKERS]
    return [
        *rows,
        (name, "least below 5 %", *("none" if size is None else f"{size:,} cases" for size in least)),
    ]


def main(quick: bool, write: bool) -> None:
    """Measure, simulate, and print the tables, or write them into the page."""
    cpu, wall, latency = measure_scheduler((500, 1000) if quick else (2000, 4000, 8000))
    sizes, rounds = (SIZES[:3], 3) if quick else (SIZES, 7)
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    overheads, texts = [], []
    with tempfile.TemporaryDirectory() as disk, tempfile.TemporaryDirectory(dir=memory) as fast:
        for number, (name, operation, model) in enumerate(prepare_operations()):
            folders = Path(fast, str(number)), Path(disk, str(number))
            rows, scatter = measure_operation(operation, model, sizes, rounds, folders)
            fixed, per_case = fit_line([row.size for row in rows], [row.seconds for row in rows])
            writing = fit_line([row.size for row in rows], [row.write for row in rows])
            costs = Costs(cpu, *writing, fixed, per_case, latency, scatter)
            texts.append(describe_operation(name, rows, costs))
            overheads += list_overheads(name, costs, (64, 1024, 16384))
    heads = ("operation", "cases a task", *(f"{workers:,} workers" for workers in WORKERS))
    publish(
        PAGE,
        describe_finding(overheads),
        f"Dask, empty tasks: {1e6 * cpu:.0f} us of processor time, {1e6 * wall:.0f} us of wall time a task; "
        f"{1e3 * latency:.1f} ms from the order of a single task to its result. Overhead, in %:",
        draw_bars("operation, cases a task", heads[-1]),
        table_text(heads, overheads),
        *texts,
        find_about(__doc__),
        write=write,
    )


def describe_finding(rows: Sequence[Sequence[str]]) -> str:
    """Return the cases a task that most workers need for each operation."""
    needed = [f"{row[-1]} ({row[0]})" for row in rows if row[1].startswith("least")]
    return f"Cases a task for less than 5 % of overhead with {WORKERS[-1]:,} workers: {', '.join(needed)}"


if __name__ == "__main__":
    main("--quick" in sys.argv[1:], "--write" in sys.argv[1:])
