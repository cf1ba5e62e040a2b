"""The plan of a sweep, known before it starts, and the work of a worker: libraries, results of one task."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, Output, TaskResult
from tensegrity_codegen.analyses.cases.statuses import encode_status
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.sweeps.apply.mapper import AppliedCases, CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.quantities import PARAMETERS
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class Task:
    """Consecutive cases that one worker computes: one chunk of every array of results.

    first, last: cases first to last - 1; groups: numbers of the groups that these cases belong to: one
    unless keys vary that change the library.
    """

    number: int  # place among the tasks, from 0
    first: int
    last: int
    groups: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of cases."""
        return self.last - self.first


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """Cases, groups of cases that share a library, and tasks."""

    cases: Cases
    groups: tuple[CaseGroup, ...]  # cases by library
    tasks: tuple[Task, ...]  # consecutive cases, boxes of a grid of cases (`CaseLayout`)
    task_size: int  # largest number of cases of a task
    seconds: float | None = None  # estimated time on one core [s]; None if it was not measured
    bytes: int | None = None  # estimated size of the results before compression; None if unknown

    @property
    def layout(self) -> CaseLayout:
        """How the cases lie in stored arrays."""
        return CaseLayout.of(self.cases.shape, self.task_size)

    def find_rows(self, task: Task) -> tuple[tuple[CaseGroup, NDArray[np.int64]], ...]:
        """Return the groups of a task, each with the numbers of its cases in this task."""
        return tuple(
            (self.groups[number], self.groups[number].rows_between(task.first, task.last))
            for number in task.groups
        )


def divide_cases(cases: Cases, groups: tuple[CaseGroup, ...], task_size: int) -> tuple[Task, ...]:
    """Return tasks of at most `task_size` consecutive cases, boxes of the grid of cases (`CaseLayout`)."""
    layout = CaseLayout.of(cases.shape, task_size)
    ranges = [layout.cases_of(number) for number in range(layout.n_tasks)]
    return tuple(
        Task(
            number,
            start,
            stop,
            tuple(group.number for group in groups if len(group.rows_between(start, stop))),
        )
        for number, (start, stop) in enumerate(ranges)
    )


ON_ANCHORS = "member_length"

Places = tuple[NDArray[np.int64], ...] | None
LoadModel = Callable[[CaseGroup], CompiledModel]


@dataclass(frozen=True, eq=False)
class SweepWork:
    """All that a worker needs besides the libraries; processes hand it on by pickling.

    is_joint: whether libraries have other nodes or members, so that each fills its part of the arrays.
    """

    plan: SweepPlan  # cases, groups and tasks
    operation: CaseAnalysis  # computed for each case
    outputs: tuple[Output, ...]  # the arrays of results
    is_joint: bool = False


def library_request(group: CaseGroup, operation: CaseAnalysis) -> ModelRequest:
    """Return the request for the library of a group: needs of the operation, positions of moved anchors."""
    alone = operation.needs(group.structure, group.request).alone(group.request)
    moved = (ON_ANCHORS,) if "anchor_position" in group.request.parameters else ()
    return replace(alone, quantities=(*alone.quantities, *moved), solvers=group.request.solvers)


def compute_task(work: SweepWork, task: Task, load: LoadModel) -> TaskResult:
    """Return the results of a task, cases in order; cases whose values are no scene are "bad_input"."""
    empty = build_empty_result(work, task, "bad_input")
    arrays, status, messages = empty.arrays, empty.status, list(empty.messages)
    for group, numbers in work.plan.find_rows(task):
        applied = group.arguments(work.plan.cases.select(numbers))
        case_rows, good = numbers - task.first, applied.good
        for row, message in zip(case_rows.tolist(), applied.messages, strict=True):
            messages[row] = message
        if not good.any():
            continue
        model = load(group)
        result = work.operation.run(model, select_arguments(model, applied), int(good.sum()))
        outputs = work.operation.outputs(model.manifest) if work.is_joint else work.outputs
        for name, inner in _place(outputs, work.outputs).items():
            rows: Any = case_rows[good] if inner is None else np.ix_(case_rows[good], *inner)
            arrays[name][rows] = result.arrays[name]
        status[case_rows[good]] = result.status
        for row, message in zip(case_rows[good].tolist(), result.messages, strict=True):
            messages[row] = message
    return TaskResult(arrays, status, tuple(messages))


def select_arguments(model: CompiledModel, applied: AppliedCases) -> dict[str, NDArray[Any]]:
    """Return the arguments of the good cases without parameters on which nothing in the library depends."""
    arguments = {name: array[applied.good] for name, array in applied.arguments.items()}
    if not any(name in PARAMETERS for name in arguments):
        return arguments
    valid_names = {argument.name for argument in model.manifest.arguments}
    return {name: array for name, array in arguments.items() if name in valid_names or name not in PARAMETERS}


def build_empty_result(work: SweepWork, task: Task, status: str, message: str = "") -> TaskResult:
    """Return the results of a task of which no case is computed."""
    arrays = {output.name: output.full_of_nan(task.count) for output in work.outputs}
    codes = np.full(task.count, encode_status(status), dtype=np.int8)
    return TaskResult(arrays, codes, (message,) * task.count)


def _place(own: tuple[Output, ...], joint: tuple[Output, ...]) -> dict[str, Places]:
    """Return the indices of the results of a library in the stored arrays, by name; None: all of them."""
    if own is joint:
        return {output.name: None for output in joint}
    joint_outputs = {output.name: output for output in joint}
    return {output.name: find_places(output, joint_outputs[output.name]) for output in own}


@dataclass(eq=False)
class Libraries:
    """Libraries by the number of their group.

    models: those that are loaded; a forked process has them too.
    """

    operation: CaseAnalysis  # that the libraries serve
    models: dict[int, CompiledModel] = field(default_factory=dict)

    def load(self, group: CaseGroup) -> CompiledModel:
        """Return the library of a group; raises as `build_library`."""
        if group.number not in self.models:
            built = build_library(group.structure, library_request(group, self.operation), calls=MANY_CALLS)
            self.models[group.number] = built.load()
        return self.models[group.number]

    def __getstate__(self) -> dict[str, object]:
        """Return the state of a process that starts anew: it loads the libraries itself."""
        return {"operation": self.operation, "models": {}}


def join_outputs(parts: Sequence[tuple[Output, ...]]) -> tuple[Output, ...]:
    """Return outputs with the results of several libraries; axes with labels have those of all."""
    labels: dict[str, dict[Any, None]] = {}
    outputs_by_name: dict[str, Output] = {}
    for outputs in parts:
        for output in outputs:
            outputs_by_name.setdefault(output.name, output)
            for dim, names in output.coordinates.items():
                labels.setdefault(dim, {}).update(dict.fromkeys(names))
    joint = {name: _widen(output, labels) for name, output in outputs_by_name.items()}
    for outputs in parts:
        for output in outputs:
            _check_fits(output, joint[output.name])
    return tuple(joint.values())


def _widen(output: Output, labels: dict[str, dict[Any, None]]) -> Output:
    coordinates = {dim: tuple(labels[dim]) for dim in output.coordinates}
    sizes = zip(output.dims, output.shape, strict=True)
    shape = tuple(len(coordinates[dim]) if dim in coordinates else size for dim, size in sizes)
    return replace(output, shape=shape, coordinates=coordinates)


def _check_fits(output: Output, joint: Output) -> None:
    fixed = [k for k, dim in enumerate(output.dims) if dim not in joint.coordinates]
    if output.dims != joint.dims or any(output.shape[k] != joint.shape[k] for k in fixed):
        problem = "results have another size in cases of another library"
        value = f"{output.name}: {output.shape} and {joint.shape}"
        allowed = "results with the same axes in all cases, or with names of nodes or members"
        hint = "keep numbers, such as max(member_tension), or sweep these cases by themselves"
        raise InvalidValueError(problem, where="keep", given=value, allowed=allowed, hint=hint)


def find_places(own: Output, joint: Output) -> tuple[NDArray[np.int64], ...] | None:
    """Return the indices of a library's results along the axes of the joint ones; None: all of them."""
    if own.shape == joint.shape and dict(own.coordinates) == dict(joint.coordinates):
        return None
    indices = []
    for dim, size in zip(own.dims, own.shape, strict=True):
        if dim in joint.coordinates:
            at = {name: k for k, name in enumerate(joint.coordinates[dim])}
            indices.append(np.array([at[name] for name in own.coordinates[dim]], dtype=np.int64))
        else:
            indices.append(np.arange(size))
    return tuple(indices)
