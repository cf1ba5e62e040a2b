"""The work of a worker: libraries by group, results of one task, outputs that several libraries share."""

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
from tensegrity_codegen.sweeps.plan import SweepPlan, Task
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.quantities import PARAMETERS
from tensegrity_codegen.tables.request import ModelRequest

ON_ANCHORS = "member_length"

Places = tuple[NDArray[np.int64], ...] | None
LoadModel = Callable[[CaseGroup], CompiledModel]


@dataclass(frozen=True, eq=False)
class SweepWork:
    """All that a worker needs besides the libraries; processes hand it on by pickling.

    plan: cases, groups and tasks; operation: what is computed for each case; outputs: the arrays of results;
    is_joint: whether libraries have other nodes or members, so that each fills its part of the arrays.
    """

    plan: SweepPlan
    operation: CaseAnalysis
    outputs: tuple[Output, ...]
    is_joint: bool = False


def library_request(group: CaseGroup, operation: CaseAnalysis) -> ModelRequest:
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
        for name, inner in _place(own, work.outputs).items():
            rows: Any = places[good] if inner is None else np.ix_(places[good], *inner)
            arrays[name][rows] = found.arrays[name]
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


@dataclass(eq=False)
class Libraries:
    """Libraries by the number of their group.

    operation: what the libraries are for; models: those that are loaded; a forked process has them too.
    """

    operation: CaseAnalysis
    models: dict[int, CompiledModel] = field(default_factory=dict)

    def load(self, group: CaseGroup) -> CompiledModel:
        """Return the library of a group; raises as `build_library`."""
        if group.number not in self.models:
            built = build_library(group.structure, library_request(group, self.operation), calls=MANY_CALLS)
            self.models[group.number] = built.load()
        return self.models[group.number]

    def __getstate__(self) -> dict[str, object]:
        """Return what a process that starts anew gets: it loads the libraries itself."""
        return {"operation": self.operation, "models": {}}


def join_outputs(parts: Sequence[tuple[Output, ...]]) -> tuple[Output, ...]:
    """Return outputs that hold the results of several libraries.

    parts: outputs of each library. Returns one for each name, in the order of first appearance. An axis with
    labels, such as nodes or members, has those of all libraries; cases that lack one have NAN there. Raises
    InvalidValueError: libraries differ in the size of an axis without labels, or in the axes of an output.
    """
    labels: dict[str, dict[Any, None]] = {}
    first: dict[str, Output] = {}
    for outputs in parts:
        for output in outputs:
            first.setdefault(output.name, output)
            for dim, names in output.coordinates.items():
                labels.setdefault(dim, {}).update(dict.fromkeys(names))
    joint = {name: _widen(output, labels) for name, output in first.items()}
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
        raise InvalidValueError(
            "results have another size in cases of another library",
            where="keep",
            given=f"{output.name}: {output.shape} and {joint.shape}",
            allowed="results with the same axes in all cases, or with names of nodes or members",
            hint="keep numbers, such as max(member_tension), or sweep these cases by themselves",
        )


def find_places(own: Output, joint: Output) -> tuple[NDArray[np.int64], ...] | None:
    """Return where a library's results are along the axes of the joint ones; None: everywhere."""
    if own.shape == joint.shape and dict(own.coordinates) == dict(joint.coordinates):
        return None
    places = []
    for dim, size in zip(own.dims, own.shape, strict=True):
        if dim in joint.coordinates:
            at = {name: k for k, name in enumerate(joint.coordinates[dim])}
            places.append(np.array([at[name] for name in own.coordinates[dim]], dtype=np.int64))
        else:
            places.append(np.arange(size))
    return tuple(places)
