"""What runs in a worker of a cluster: all of it comes with the task, nothing from the disk of the client."""

import pickle
import platform
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.sweeps.apply.group import CaseGroup
from tensegrity_codegen.sweeps.engines.parcel import SourceParcel, load_parcel
from tensegrity_codegen.sweeps.engines.versions import check_versions, describe_versions
from tensegrity_codegen.sweeps.engines.work import SweepWork, compute_task
from tensegrity_codegen.sweeps.tasks.operation import TaskResult

_models: dict[str, CompiledModel] = {}  # libraries of this process by the hash of their source
_lock = threading.Lock()


@dataclass(frozen=True, eq=False)
class RemoteWork:
    """The work of a sweep, and the versions that it needs."""

    work: SweepWork
    versions: Mapping[str, str]


def unpack(data: bytes) -> Any:
    """Return the work or the source that was sent; its result is passed on from worker to worker."""
    return pickle.loads(data)


def compute_remotely(
    remote: RemoteWork, sources: Mapping[int, SourceParcel], number: int
) -> tuple[TaskResult, float, dict[str, Any]]:
    """Return the results of a task, the time that it took, and where it was computed.

    sources: source of the libraries of the task by the number of their group. Raises ClusterError where this
    worker has other versions than the client.
    """
    check_versions(remote.versions, describe_versions(), platform.node())

    def load(group: CaseGroup) -> CompiledModel:
        return _load(sources[group.number], group)

    work = remote.work
    task = work.plan.tasks[number]
    for group, _ in work.plan.find_rows(task):
        load(group)
    started = time.perf_counter()
    result = compute_task(work, task, load)
    return result, time.perf_counter() - started, {"machine": platform.node()}


def _load(parcel: SourceParcel, group: CaseGroup) -> CompiledModel:
    """Return a library of this process; the first thread that needs it compiles it."""
    with _lock:
        if parcel.hash not in _models:
            _models[parcel.hash] = load_parcel(parcel, group.structure)
        return _models[parcel.hash]
