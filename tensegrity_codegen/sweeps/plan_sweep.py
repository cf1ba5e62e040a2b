"""The plan of a sweep: groups of cases, tasks of a size that suits, and what they will take."""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.quantities import OF_LOOPS
from tensegrity_codegen.analyses.cases.record import CaseAnalysis, Output
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.apply.assembler import build_assembler
from tensegrity_codegen.sweeps.apply.group_cases import find_groups
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.layout import LANES
from tensegrity_codegen.sweeps.cases.sampled import read_count
from tensegrity_codegen.sweeps.cases.table import Table
from tensegrity_codegen.sweeps.engines.work import (
    Libraries,
    SweepPlan,
    SweepWork,
    divide_cases,
    join_outputs,
    select_arguments,
)
from tensegrity_codegen.system.summaries import describe_count

TASK_SECONDS = 0.5  # that a task shall take, so that its overhead is small and little is lost with it
LEAST_TASKS = 4  # for each worker, so that none waits long for the others at the end
MOST_CASES = 32_768  # of a task
MOST_BYTES = 64 * 2**20  # of the results of a task
TRIED = (8, 8, 64, 512, 4096)  # cases that are computed to measure their time, the first ones twice: a first
# call loads modules, and many cases side by side take less time each than few
MEASURED_SECONDS = 0.05  # [s] of a measurement
SLOW = 1.0  # [s] of a first call, from which it counts


@dataclass(frozen=True, eq=False)
class PlannedSweep:
    """A sweep before it starts."""

    work: SweepWork  # plan, operation and outputs, for `run_sweep`
    libraries: Libraries = field(repr=False)  # libraries of the groups; the first one is loaded
    case_seconds: float  # measured time of a case on one core [s]
    build_seconds: float  # time that the first library took, 0 if it was in the cache [s]
    workers: int  # number of processes for which the time is estimated
    notes: tuple[str, ...]  # notes on the cases for the user

    @property
    def seconds(self) -> float:
        """Estimated time with all workers [s]."""
        plan = self.work.plan
        at_once = min(self.workers, len(plan.tasks))
        return self.case_seconds * plan.cases.count / at_once + self.build_seconds * (len(plan.groups) - 1)

    def describe(self) -> dict[str, Any]:
        """Return the plan as plain values, for JSON."""
        plan = self.work.plan
        return {
            "cases": plan.cases.count,
            "shape": list(plan.cases.shape),
            "keys": list(plan.cases.keys),
            "method": plan.cases.method,
            "operation": self.work.operation.describe(),
            "libraries": [_describe_group(group) for group in plan.groups],
            "tasks": len(plan.tasks),
            "task_size": plan.layout.task_size,
            "workers": self.workers,
            "seconds_per_case": self.case_seconds,
            "seconds": self.seconds,
            "bytes": plan.bytes,
            "outputs": [output.name for output in self.work.outputs],
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        plan = self.work.plan
        sizes = " x ".join(f"{size:,}" for size in plan.cases.shape)
        cases = describe_count(plan.cases.count, "case")
        yield f"{cases} ({sizes}), {plan.cases.method}: {', '.join(plan.cases.keys)}"
        yield f"{self.work.operation.name}: {', '.join(output.name for output in self.work.outputs)}"
        count = len(plan.groups)
        yield describe_count(count, "library", "libraries")
        for group in plan.groups[:5]:
            sizes = ", ".join(
                f"{name} ({size})" for name, size in _describe_group(group)["parameters"].items()
            )
            yield f"  {describe_count(len(group.rows), 'case')}; run-time parameters: {sizes or 'none'}"
        if count > 5:
            yield f"  and {count - 5} more"
        size = describe_count(plan.layout.task_size, "case")
        yield f"{describe_count(len(plan.tasks), 'task')} of up to {size}"
        workers = describe_count(self.workers, "worker")
        yield (
            f"about {format_seconds(self.seconds)} of computing with {workers} "
            f"({format_seconds(self.case_seconds)} a case and core), "
            f"{format_bytes(plan.bytes or 0)} of results before compression"
        )
        for note in self.notes:
            yield f"note: {note}"


def plan_sweep(
    scene: str | Path | Mapping[str, Any] | Scene,
    cases: Cases,
    operation: CaseAnalysis,
    *,
    task_size: int | None = None,
    workers: int = 1,
    yes: bool = False,
    option: str = "yes",
) -> PlannedSweep:
    """Find the libraries of a sweep, build the first one, measure some cases, divide all into tasks."""
    source = cases.points.source if isinstance(cases.points, Table) else ""
    assembler = replace(build_assembler(scene, cases.keys, source=source), analyses=operation.analyses)
    groups = find_groups(assembler, cases, yes=yes, option=option)
    libraries = Libraries(operation)
    started = time.perf_counter()
    model = libraries.load(groups[0])
    build_seconds = time.perf_counter() - started
    outputs, is_joint = _find_outputs(operation, groups, libraries)
    case_seconds = _measure(cases, groups[0], libraries, operation)
    # The size of a task is bounded by its time, the number of workers and the size of its results.
    if task_size is None:
        by_time = TASK_SECONDS / max(case_seconds, 1e-9)
        by_workers = cases.count / (LEAST_TASKS * workers)
        by_size = MOST_BYTES / max(_row_bytes(outputs), 1)
        task_size = max(int(min(by_time, by_workers, by_size, MOST_CASES)), LANES)
    task_size = read_count(task_size, "task_size", "number of cases of a task")
    tasks = divide_cases(cases, groups, task_size)
    seconds, size = case_seconds * cases.count, cases.count * _row_bytes(outputs)
    plan = SweepPlan(cases, groups, tasks, task_size, seconds, size)
    loop_names = OF_LOOPS if operation.needs_scene else ()
    names = {*loop_names, *(argument.name for argument in model.manifest.arguments)}
    notes = (*_note_sample(cases), *_note_accuracy(operation), *_note_groups(cases, groups, names))
    return PlannedSweep(
        SweepWork(plan, operation, outputs, is_joint), libraries, case_seconds, build_seconds, workers, notes
    )


def format_seconds(seconds: float) -> str:
    """Return a time in the unit that suits it, as "3.2 ms" or "1 h 20 min"."""
    if seconds < 0.995:
        scale, unit = (1e6, "us") if seconds < 995e-6 else (1e3, "ms")
        value = float(f"{seconds * scale:.2g}")
        return f"{value:g} {unit}"
    if seconds < 120:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


def format_bytes(size: int) -> str:
    """Return a size in the unit that suits it, as "12 MB"."""
    step = min(int(math.log(max(size, 1), 1000)), 4)
    return f"{size / 1000**step:.3g} {('B', 'kB', 'MB', 'GB', 'TB')[step]}"


def _measure(cases: Cases, group: CaseGroup, libraries: Libraries, operation: CaseAnalysis) -> float:
    """Return the mean processor time of a case of the first group on one core [s], its arguments included."""
    model = libraries.load(group)
    case_seconds, assembling = 0.0, _assembly_seconds(cases, group)
    for number, tried in enumerate(TRIED):
        count = min(tried, len(group.rows))
        chosen = np.unique(np.linspace(0, len(group.rows) - 1, count).astype(np.int64))
        values = cases.select(np.asarray(group.rows, dtype=np.int64)[chosen])
        started = time.process_time()
        applied = group.arguments(values)
        applying = time.process_time() - started
        if applied.good.any():
            operation.run(model, select_arguments(model, applied), int(applied.good.sum()))
        seconds = time.process_time() - started
        case_seconds = (seconds - applying if assembling else seconds) / count
        if seconds > (MEASURED_SECONDS if number else SLOW) or (number and count == len(group.rows)):
            break
    return case_seconds + assembling / cases.count


def _assembly_seconds(cases: Cases, group: CaseGroup) -> float:
    """Return the time to assemble the structures that the arguments of all cases are taken from [s]."""
    mapper = group.mapper
    if not (mapper.assembles_all or mapper.indirect_keys):
        return 0.0
    sets = math.prod(len(axis) for k, axis in enumerate(cases.axes) if k in mapper.indirect_keys)
    if cases.points is not None and max(mapper.indirect_keys, default=-1) >= len(cases.axes):
        sets *= cases.points.count
    times = []
    for _ in range(3):
        started = time.perf_counter()
        mapper.explain(mapper.base)
        times.append(time.perf_counter() - started)
    return min(times) * (cases.count if mapper.assembles_all else sets)


def _find_outputs(
    operation: CaseAnalysis, groups: tuple[CaseGroup, ...], libraries: Libraries
) -> tuple[tuple[Output, ...], bool]:
    """Return the outputs of all cases, and whether libraries with other nodes or members share them."""
    base = groups[0].structure
    differing = [
        group
        for group in groups
        if group.structure.node_name != base.node_name or group.structure.member_name != base.member_name
    ]
    models = [libraries.load(group) for group in (groups[0], *differing)]
    return join_outputs([operation.outputs(model.manifest) for model in models]), bool(differing)


def _row_bytes(outputs: tuple[Output, ...]) -> int:
    """Return the size of the results of one case, status included."""
    return 1 + sum(math.prod(output.shape) * np.dtype(output.dtype).itemsize for output in outputs)


def _describe_group(group: CaseGroup) -> dict[str, Any]:
    parameters = {name: len(rows) or 1 for name, rows in group.request.parameters.items()}
    return {"cases": len(group.rows), "hash": group.hash, "parameters": parameters}


def _note_sample(cases: Cases) -> Iterator[str]:
    n = getattr(cases.points, "n", 0)
    if cases.method in ("sobol", "saltelli") and n & (n - 1):
        power = 1 << (n.bit_length() - 1)
        yield f"a Sobol' sequence is balanced for n = 2, 4, 8, ...: choose {power} or {2 * power}, not {n}"


def _note_accuracy(operation: CaseAnalysis) -> Iterator[str]:
    if operation.describe().get("control", "samples") is None:
        yield (
            "tolerances bound the error of each step, as for batches; "
            "control samples bounds that of the motion, as simulate does, and takes longer"
        )


def _note_groups(cases: Cases, groups: tuple[CaseGroup, ...], known: set[str]) -> Iterator[str]:
    mappers = [group.mapper for group in groups]
    used = {key for mapper in mappers for key in mapper.find_used_keys(known)}
    constant = {axis.key for axis in cases.axes if len(axis) == 1}
    idle = [key for number, key in enumerate(cases.keys) if number not in used and key not in constant]
    if idle and not any(mapper.assembles_all for mapper in mappers):
        yield f"no quantity depends on {', '.join(idle)}"
    slow = [mapper for mapper in mappers if mapper.assembles_all]
    if slow:
        yield "every case is assembled by itself, since some are no scene for reasons that only this finds"
    elif any(mapper.indirect_keys for mapper in mappers):
        keys = dict.fromkeys(cases.keys[key] for mapper in mappers for key in mapper.indirect_keys)
        yield f"the structure is assembled for every set of values of {', '.join(keys)}"
