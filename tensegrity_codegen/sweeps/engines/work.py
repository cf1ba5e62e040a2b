"""The work of a worker: libraries by group, and the results of one task."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.sweeps.apply.group import AppliedCases, CaseGroup
from tensegrity_codegen.sweeps.joint_outputs import find_places
from tensegrity_codegen.sweeps.plan import SweepPlan, Task
from tensegrity_codegen.sweeps.statuses import encode_status
from tensegrity_codegen.sweeps.tasks.operation import Operation, Output, TaskResult
from tensegrity_codegen.tables.quantities import PARAMETERS
from tensegrity_codegen.tables.request import ModelRequest

ON_ANCHORS = "member_length"

Places = tuple[NDArray[np.int64], ...] | None
LoadModel = Callable[[CaseGroup], CompiledModel]


@dataclass(frozen=True, eq=False)
class SweepWork:
    """All that a worker needs besides the libraries; processes hand it on by pickling.

    Attributes
    ----------
    plan : SweepPlan
        Cases, groups and tasks.
    operation : Operation
        What is computed for each case.
    outputs : tuple of Output
        The arrays of results.
    is_joint : bool
        Whether libraries have other nodes or members, so that each fills its part of the arrays.
    """

    plan: SweepPlan
    operation: Operation
    outputs: tuple[Output, ...]
    is_joint: bool = False


def library_request(group: CaseGroup, operation: Operation) -> ModelRequest:
    """Return the request for the library of a group: what the operation needs and no more.

    Where anchors move, a quantity is added that depends on each of them, so that the library has their
    positions as an argument even if nothing but positions is kept.
    """
    alone = operation.needs(group.structure, group.request).alone(group.request)
    moved = (ON_ANCHORS,) if "anchor_position" in group.request.parameters else ()
    return replace(alone, quantities=(*alone.quantities, *moved), solvers=group.request.solvers)


def compute_task(work: SweepWork, task: Task, load: LoadModel) -> TaskResult:
    """Return the results of a task, cases in order; cases whose values are no scene are "bad_input"."""
    arrays = {output.name: output.full_of_nan(task.count) for output in work.outputs}
    status = np.full(task.count, encode_status("bad_input"), dtype=np.int8)
    messages = [""] * task.count
    for group, numbers in work.plan.find_rows(task):
        applied = group.arguments(work.plan.cases.select(numbers))
        places, good = numbers - task.first, applied.good
        for place, message in zip(places.tolist(), applied.messages, strict=True):
            messages[place] = message
        if not good.any():
            continue
        model = load(group)
        found = work.operation.run(model, select_arguments(model, applied), int(good.sum()))
        own = work.operation.outputs(model.manifest) if work.is_joint else work.outputs
        _insert(arrays, _place(own, work.outputs), places[good], found)
        status[places[good]] = found.status
        for place, message in zip(places[good].tolist(), found.messages, strict=True):
            messages[place] = message
    return TaskResult(arrays, status, tuple(messages))


def select_arguments(model: CompiledModel, applied: AppliedCases) -> dict[str, NDArray[Any]]:
    """Return the arguments of the good cases without parameters on which nothing in the library depends."""
    arguments = {name: array[applied.good] for name, array in applied.arguments.items()}
    if not any(name in PARAMETERS for name in arguments):
        return arguments
    known = {item.name for item in model.manifest.arguments}
    return {name: array for name, array in arguments.items() if name in known or name not in PARAMETERS}


def set_task_aside(work: SweepWork, task: Task, message: str) -> TaskResult:
    """Return the results of a task that cannot be computed."""
    arrays = {output.name: output.full_of_nan(task.count) for output in work.outputs}
    status = np.full(task.count, encode_status("set_aside"), dtype=np.int8)
    return TaskResult(arrays, status, (message,) * task.count)


def _place(own: tuple[Output, ...], joint: tuple[Output, ...]) -> dict[str, Places]:
    """Return where the results of a library are in the stored arrays, by name; None: in all of them."""
    if own is joint:
        return {output.name: None for output in joint}
    known = {output.name: output for output in joint}
    return {output.name: find_places(output, known[output.name]) for output in own}


def _insert(
    arrays: dict[str, NDArray[Any]], at: dict[str, Places], rows: NDArray[np.int64], found: TaskResult
) -> None:
    for name, places in at.items():
        if places is None:
            arrays[name][rows] = found.arrays[name]
        else:
            arrays[name][np.ix_(rows, *places)] = found.arrays[name]


@dataclass(eq=False)
class Libraries:
    """Libraries by the number of their group.

    Attributes
    ----------
    operation : Operation
        What the libraries are for.
    models : dict of int to CompiledModel
        Those that are loaded; a forked process has them too.
    """

    operation: Operation
    models: dict[int, CompiledModel] = field(default_factory=dict)

    def load(self, group: CaseGroup) -> CompiledModel:
        """Return the library of a group; raises as `build_library`."""
        if group.number not in self.models:
            built = build_library(group.structure, library_request(group, self.operation))
            self.models[group.number] = built.load()
        return self.models[group.number]

    def __getstate__(self) -> dict[str, object]:
        """Return what a process that starts anew gets: it loads the libraries itself."""
        return {"operation": self.operation, "models": {}}
