"""Tasks on a Dask cluster, a bounded number at a time."""

import pickle
import platform
import queue
import threading
import time
from collections import Counter, deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.sweeps.apply.group import CaseGroup
from tensegrity_codegen.sweeps.engines.cluster import (
    check_versions,
    connect,
    count_threads,
    describe_versions,
)
from tensegrity_codegen.sweeps.engines.engine import MOST_ATTEMPTS, FinishedTask
from tensegrity_codegen.sweeps.engines.parcel import SourceParcel, load_parcel, make_parcel
from tensegrity_codegen.sweeps.engines.work import SweepWork, compute_task, library_request, set_task_aside
from tensegrity_codegen.sweeps.plan import Task
from tensegrity_codegen.sweeps.tasks.operation import TaskResult
from tensegrity_codegen.system.errors import ClusterError, TensegrityError

LOOK = 1.0  # [s] between two looks at the workers while no task ends
AHEAD = 2  # tasks in flight for each thread of the workers: the next is there when one ends
_models: dict[str, CompiledModel] = {}  # libraries of this process by the hash of their source
_lock = threading.Lock()


@dataclass(frozen=True)
class DaskEngine:
    """Workers of a Dask cluster.

    The source of each library goes along, known by its hash; a worker compiles it for its own processor into
    its own cache. Results come back to this process, which alone writes them, so that workers need no folder
    in common with it.

    Attributes
    ----------
    address : str
        Address of the scheduler.
    wait : float
        Longest time to wait for the scheduler, and for a worker whenever there is none [s].
    """

    address: str
    wait: float = 30.0

    @contextmanager
    def run(self, work: SweepWork, tasks: Sequence[Task]) -> Iterator[Iterator[FinishedTask]]:
        """Connect to the scheduler and start the first tasks; see `Engine.run`."""
        if not tasks:
            yield iter(())
            return
        with connect(self.address, self.wait) as client:
            run = _ClusterRun(client, work, deque(tasks), self.wait)
            try:
                run.submit()
                yield run.results()
            finally:
                run.end()


@dataclass(eq=False)
class _ClusterRun:
    """The tasks of one sweep on a cluster."""

    client: Any
    work: SweepWork
    waiting: deque[Task]
    wait: float
    running: dict[Any, Task] = field(default_factory=dict)
    ended: queue.SimpleQueue[Any] = field(default_factory=queue.SimpleQueue)
    failed: Counter[int] = field(default_factory=Counter)
    sources: dict[int, Any] = field(default_factory=dict)
    remote: Any = None
    last_worker: float = 0.0  # when there was a worker last

    def submit(self) -> None:
        """Give the cluster as many tasks as it should have at a time."""
        threads = count_threads(self.client)
        if threads:
            self.last_worker = time.monotonic()
        if self.remote is None:
            self.remote = self._send(RemoteWork(self.work, describe_versions()))
        while self.waiting and len(self.running) < AHEAD * max(threads, 1) + 1:
            task = self.waiting.popleft()
            sources = {number: self._source(number) for number in task.groups}
            future = self.client.submit(
                compute_remotely, self.remote, sources, task.number, pure=False, retries=0
            )
            self.running[future] = task
            future.add_done_callback(self.ended.put)

    def results(self) -> Generator[FinishedTask, None, None]:
        """Give the results of all tasks as they end."""
        while self.running:
            with suppress(queue.Empty):
                finished = self._receive(self.ended.get(timeout=LOOK))
                if finished is not None:
                    yield finished
            self._check_alive()
            self.submit()

    def end(self) -> None:
        """Let the cluster drop what is not finished."""
        with suppress(Exception):
            self.client.cancel([*self.running, *self.sources.values(), self.remote], force=True)
        self.running.clear()

    def _send(self, value: Any) -> Any:
        """Send an object to the cluster; workers pass it on, and it can be had again if one is lost."""
        return self.client.submit(unpack, pickle.dumps(value), pure=False)

    def _source(self, number: int) -> Any:
        """Return the source of a group's library on the cluster, built here when it is first needed."""
        if number not in self.sources:
            group = self.work.plan.groups[number]
            request = library_request(group, self.work.operation)
            built = build_library(group.structure, request)
            self.sources[number] = self._send(make_parcel(built, request.flags))
        return self.sources[number]

    def _receive(self, future: Any) -> FinishedTask | None:
        task = self.running.pop(future)
        try:
            result, seconds, facts = future.result()
        except TensegrityError:
            raise
        except Exception as error:
            return self._give_up_or_repeat(task, error)
        finally:
            future.release()
        return FinishedTask(task, result, seconds, {"attempts": self.failed[task.number] + 1, **facts})

    def _give_up_or_repeat(self, task: Task, error: Exception) -> FinishedTask | None:
        """Set a task aside that Dask gives up, since its workers end, or that fails again."""
        problem = f"{type(error).__name__}: {error}"[:500]
        name = type(error).__name__
        self.failed[task.number] += 1
        if "Cancelled" in name:
            raise ClusterError(
                "the cluster has dropped the tasks of this sweep",
                where="scheduler",
                given=problem,
                hint="run the same command again: it goes on where it stopped",
            ) from error
        if name != "KilledWorker" and self.failed[task.number] < MOST_ATTEMPTS:
            self.waiting.appendleft(task)
            return None
        message = f"its task was computed several times without a result: {problem}"
        return FinishedTask(task, set_task_aside(self.work, task, message), 0.0, {"problem": problem})

    def _check_alive(self) -> None:
        """Raise ClusterError where the scheduler or all its workers have been gone for too long."""
        if self.client.status not in ("running", "connecting"):
            raise _lost("the connection to the scheduler is lost")
        if count_threads(self.client):
            self.last_worker = time.monotonic()
        elif time.monotonic() - self.last_worker > self.wait:
            raise _lost(f"the scheduler has had no workers for {self.wait:g} s")


def _lost(problem: str) -> ClusterError:
    return ClusterError(
        problem,
        where="scheduler",
        hint="start workers, and run the same command again: it goes on where it stopped",
    )


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
