"""Tasks on a Dask cluster, a bounded number at a time.

Generated source travels to other machines, which compile it for their own processor.
"""

import pickle
import platform
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from tensegrity_codegen.analyses.cases.record import TaskResult
from tensegrity_codegen.codegen.compilation.cache import MANIFEST_FILE, Cache, CacheEntry, read_contents
from tensegrity_codegen.codegen.compilation.fingerprint import hash_text
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, BuiltLibrary, build_library
from tensegrity_codegen.pipeline.compile_source import compile_source
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.engines.cluster import (
    check_versions,
    connect,
    count_threads,
    describe_versions,
)
from tensegrity_codegen.sweeps.engines.engine import Engine
from tensegrity_codegen.sweeps.engines.work import SweepWork, compute_task, library_request
from tensegrity_codegen.sweeps.plan import Task
from tensegrity_codegen.system.errors import ClusterError, CompilerMissingError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import find_target

LOG = "compile.log"


@dataclass(frozen=True)
class SourceParcel:
    """Generated source of one library.

    hash: hash of the source and of how it is compiled.
    files: generated files: name and text.
    flags: how they are compiled: ``"native"`` for the processor of the machine that compiles them.
    scene: hash of the scene.
    library: the library as this machine compiled it, for machines of the same kind without a compiler; empty
        with native flags, since it may hold instructions that another processor lacks.
    library_name: name of its file.
    platform: system and architecture of `library`.
    """

    hash: str
    files: tuple[tuple[str, str], ...]
    flags: str
    scene: str
    library: bytes
    library_name: str
    platform: str


def make_parcel(built: BuiltLibrary, flags: str) -> SourceParcel:
    """Return the source of a library; raises LibraryError where its files in the cache are damaged."""
    contents = read_contents(built.entry)
    contents.pop(LOG, None)
    library = contents.pop(built.path.name)
    texts = {name: content.decode("utf-8") for name, content in contents.items()}
    # As it was generated: the manifest in the cache names the instruction sets of this processor.
    texts[MANIFEST_FILE] = replace(built.manifest, instruction_sets=(), target="").to_json()
    files = tuple(sorted(texts.items()))
    digest = hash_text(flags, built.entry.scene, *(part for item in files for part in item))
    portable = find_flags(flags).portable
    return SourceParcel(
        digest,
        files,
        flags,
        built.entry.scene,
        library if portable else b"",
        built.path.name,
        _describe_platform(),
    )


def load_parcel(parcel: SourceParcel, structure: Subject, cache: Cache | None = None) -> CompiledModel:
    """Return the library of a parcel, compiled for this machine or found in its cache.

    Raises CompilerMissingError: this machine has no compiler, and the library that came along is not for it;
    CompileError, LibraryError, OutputError: the compiler failed, the library does not load, the cache cannot
    be written.
    """
    cache = cache or Cache()
    texts = dict(parcel.files)
    manifest = Manifest.from_json(texts[MANIFEST_FILE])

    def matches(entry: CacheEntry, found: Manifest) -> bool:
        return entry.scene == parcel.scene and found.scene_hash == manifest.scene_hash

    try:
        compiler = find_compiler(None)
    except CompilerMissingError:
        if not parcel.library or parcel.platform != _describe_platform():
            raise
        entry = _store_library(parcel, cache)
    else:
        entry, manifest = compile_source(
            texts,
            manifest,
            compiler=compiler,
            flags=find_flags(parcel.flags),
            target=find_target(None),
            cache=cache,
            scene=parcel.scene,
            matches=matches,
        )
    assert entry.library is not None
    return CompiledModel(entry.library, manifest, structure=structure)


def _store_library(parcel: SourceParcel, cache: Cache) -> CacheEntry:
    """Keep the library that came along in the cache, under a key of its own."""
    key = hash_text("parcel", parcel.hash, parcel.platform)
    with cache.lock(key):
        known = cache.find(key)
        if known is not None:
            return known
        files = {name: text.encode("utf-8") for name, text in parcel.files}
        return cache.store(key, {**files, parcel.library_name: parcel.library}, scene=parcel.scene)


def _describe_platform() -> str:
    libc = "-".join(platform.libc_ver())
    return f"{sys.platform} {platform.machine()} {libc}"


AHEAD = 2  # tasks in flight for each thread of the workers: the next is there when one ends
_models: dict[str, CompiledModel] = {}  # libraries of this process by the hash of their source
_lock = threading.Lock()


@dataclass(frozen=True)
class DaskEngine(Engine):
    """Workers of a Dask cluster.

    The source of each library goes along, known by its hash; a worker compiles it for its own processor into
    its own cache. Results come back to this process, which alone writes them, so that workers need no folder
    in common with it.

    address: address of the scheduler; wait: longest time to wait for the scheduler, and for a worker whenever
    there is none [s].
    """

    address: str
    wait: float = 30.0

    @contextmanager
    def open(self, work: SweepWork, tasks: Sequence[Task]) -> Iterator["_Cluster"]:
        """Connect to the scheduler; see `Engine.open`. What is not finished is dropped at the end."""
        with connect(self.address, self.wait) as client:
            yield _Cluster(client, work, self.wait)


@dataclass(eq=False)
class _Cluster:
    """A cluster that computes the tasks of one sweep."""

    client: Any
    work: SweepWork
    wait: float
    sources: dict[int, Any] = field(default_factory=dict)
    remote: Any = None
    last_worker: float = field(default_factory=time.monotonic)  # when there was a worker last

    def submit(self, task: Task) -> Any:
        """Return the future of a task; see `Place`."""
        if self.remote is None:
            self.remote = self._send(RemoteWork(self.work, describe_versions()))
        sources = {number: self._source(number) for number in task.groups}
        return self.client.submit(compute_remotely, self.remote, sources, task.number, pure=False, retries=0)

    def count(self) -> int:
        """Return how many tasks shall be under way; raises ClusterError without scheduler or workers."""
        if self.client.status not in ("running", "connecting"):
            raise _lost("the connection to the scheduler is lost")
        threads = count_threads(self.client)
        if threads:
            self.last_worker = time.monotonic()
        elif time.monotonic() - self.last_worker > self.wait:
            raise _lost(f"the scheduler has had no workers for {self.wait:g} s")
        return AHEAD * max(threads, 1) + 1

    def explain(self, error: Exception) -> str:
        """Return why a task has no result; raises ClusterError where the cluster has dropped it."""
        problem = f"{type(error).__name__}: {error}"[:500]
        if "Cancelled" not in type(error).__name__:
            return problem
        raise ClusterError(
            "the cluster has dropped the tasks of this sweep",
            where="scheduler",
            given=problem,
            hint="run the same command again: it goes on where it stopped",
        ) from error

    def _send(self, value: Any) -> Any:
        """Send an object to the cluster; workers pass it on, and it can be had again if one is lost."""
        return self.client.submit(unpack, pickle.dumps(value), pure=False)

    def _source(self, number: int) -> Any:
        """Return the source of a group's library on the cluster, built here when it is first needed."""
        if number not in self.sources:
            group = self.work.plan.groups[number]
            request = library_request(group, self.work.operation)
            built = build_library(group.structure, request, calls=MANY_CALLS)
            self.sources[number] = self._send(make_parcel(built, request.flags))
        return self.sources[number]


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
        # The first thread that needs a library compiles it.
        parcel = sources[group.number]
        with _lock:
            if parcel.hash not in _models:
                _models[parcel.hash] = load_parcel(parcel, group.structure)
            return _models[parcel.hash]

    work = remote.work
    task = work.plan.tasks[number]
    for group, _ in work.plan.find_rows(task):
        load(group)
    started = time.perf_counter()
    result = compute_task(work, task, load)
    return result, time.perf_counter() - started, {"machine": platform.node()}
