"""Tasks on a Dask cluster, a bounded number at a time.

Generated source travels to other machines, which compile it for their own processor.
"""

import functools
import pickle
import platform
import socket
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tensegrity_codegen.analyses.cases.record import TaskResult
from tensegrity_codegen.codegen.compilation.cache import MANIFEST_FILE, Cache, CacheEntry, read_contents
from tensegrity_codegen.codegen.compilation.fingerprint import hash_package, hash_text
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, BuiltLibrary, build_library
from tensegrity_codegen.pipeline.compile_source import compile_source
from tensegrity_codegen.pipeline.rigid_twin import request_rigid_twin
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.engines.engine import Engine
from tensegrity_codegen.sweeps.engines.work import SweepWork, Task, compute_task, library_request
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import ClusterError, CompilerMissingError, InvalidValueError
from tensegrity_codegen.system.extras import CLUSTER, import_extra
from tensegrity_codegen.system.forked import count_workers
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest
from tensegrity_codegen.tables.targets import find_target

PORT = "8786"  # of a Dask scheduler, where an address has none
LOOK = 0.2  # [s] between two looks for workers
LEAST_WAIT = 1.0  # [s] for an answer of the scheduler
# Versions that must be equal wherever tasks of one sweep are computed, so that results are.
PACKAGES = ("numpy", "scipy", "casadi")
OWN = "tensegrity_codegen"
SOURCE = "source of tensegrity_codegen"


@dataclass(frozen=True)
class Cluster:
    """Workers of a running Dask scheduler.

    Attributes
    ----------
    address : str
        Address of the scheduler, such as ``"tcp://10.0.0.1:8786"``.
    wait : float
        Longest time to wait for the scheduler, and for a worker whenever there is none [s].
    """

    address: str
    wait: float = 30.0


@contextmanager
def connect(address: str, wait: float) -> Iterator[Any]:
    """Give a client of the scheduler at an address, once it has a worker; waits for both [s]."""
    check_wait(wait)
    distributed = import_extra("distributed", CLUSTER)
    deadline = time.monotonic() + wait
    client = _open(distributed, address, wait)
    try:
        _wait_for_workers(client, address, wait, deadline)
        _check_workers(client)
        yield client
    finally:
        with suppress(Exception):
            client.close(timeout=2.0)


def check_wait(wait: Any) -> None:
    """Raise InvalidValueError unless `wait` is a time [s]."""
    if isinstance(wait, bool) or not isinstance(wait, int | float) or not 0.0 <= wait < 1e7:
        raise InvalidValueError("not a time", where="wait", given=wait, allowed="seconds, from 0 on")


def check_workers(workers: Any) -> int | Cluster:
    """Return the workers of a sweep, by default one process a core; raises InvalidValueError."""
    if not isinstance(workers, Cluster):
        count = count_workers() if workers is None else workers
        return check_whole(count, "workers", 1, problem="not a number of workers")
    if not isinstance(workers.address, str) or not workers.address.strip():
        problem, allowed = "not the address of a scheduler", "a text such as tcp://10.0.0.1:8786"
        hint = "`workers` is a number for processes of this machine"
        raise InvalidValueError(problem, where="scheduler", given=workers.address, allowed=allowed, hint=hint)
    check_wait(workers.wait)
    return workers


def count_threads(client: Any) -> int:
    """Return how many tasks the workers compute at a time."""
    workers = client.scheduler_info()["workers"]
    return sum(int(worker["nthreads"]) for worker in workers.values())


def _open(distributed: Any, address: str, wait: float) -> Any:
    within = max(wait, LEAST_WAIT)
    try:
        _knock(address, within)
        return distributed.Client(address, timeout=within, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        problem = f"no scheduler answered within {within:g} s"
        allowed = "the address of a Dask scheduler, such as tcp://10.0.0.1:8786"
        hint = "start one with `dask scheduler`, and workers with `dask worker ADDRESS`"
        raise ClusterError(problem, where="scheduler", given=address, allowed=allowed, hint=hint) from error


def _knock(address: str, within: float) -> None:
    """Raise OSError or ValueError if nothing listens; clients of distributed may hang after that."""
    scheme, _, network_address = address.rpartition("://")
    if scheme not in ("", "tcp", "tls"):
        return
    host, _, port = network_address.rpartition(":") if ":" in network_address else (network_address, "", PORT)
    if not host:
        raise ValueError(address)
    deadline = time.monotonic() + within
    while True:
        try:
            socket.create_connection((host.strip("[]"), int(port)), timeout=within).close()
            return
        except OSError:
            if time.monotonic() >= deadline:
                raise
        time.sleep(LOOK)


def _wait_for_workers(client: Any, address: str, wait: float, deadline: float) -> None:
    while not count_threads(client):
        if time.monotonic() >= deadline:
            problem = f"the scheduler has no workers after {wait:g} s"
            allowed = "a scheduler with one worker or more"
            hint = f"start workers with `dask worker {address}`, or wait longer, with a larger `wait`"
            raise ClusterError(problem, where="scheduler", given=address, allowed=allowed, hint=hint)
        time.sleep(LOOK)


def _check_workers(client: Any) -> None:
    """Raise ClusterError for the first worker that cannot do the work."""
    versions_by_worker = client.run(describe_versions, on_error="return")
    for worker, versions in sorted(versions_by_worker.items()):
        if isinstance(versions, ImportError):
            versions = {}
        if isinstance(versions, BaseException):
            problem = "a worker does not answer"
            raise ClusterError(problem, where=f"worker {worker}", given=str(versions)) from versions
        check_versions(describe_versions(), versions, worker)


@functools.cache
def describe_versions() -> dict[str, str]:
    """Return the versions in this process, by name."""
    python = ".".join(platform.python_version_tuple()[:2])
    source = hash_package(Path(__file__).resolve().parents[2], template_folder())[:12]
    versions = {OWN: VERSION, SOURCE: source, "Python": python}
    return versions | {name: find_version(name) for name in PACKAGES}


def find_version(package: str) -> str:
    """Return the version of a package, or "not installed"."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def check_versions(expected: Mapping[str, str], found: Mapping[str, str], worker: str) -> None:
    """Raise ClusterError, naming the differences, unless a worker has the versions of the client."""
    different = [name for name, value in expected.items() if found.get(name) != value]
    if different:
        raise ClusterError(
            "a worker has other versions than this process",
            where=f"worker {worker}",
            given=", ".join(f"{name} {found.get(name, 'not installed')}" for name in different),
            allowed=", ".join(f"{name} {expected[name]}" for name in different),
            hint="start the workers in the environment of this process, or in one with the same versions",
        )


LOG = "compile.log"


@dataclass(frozen=True)
class SourceParcel:
    """Generated source of one library.

    library: the library as this machine compiled it, for machines of the same kind without a compiler;
    empty with native flags, since it may hold instructions that another processor lacks; twin: that of the
    model's `rigid_twin`.
    """

    hash: str  # hash of the source and of how it is compiled
    files: tuple[tuple[str, str], ...]  # generated files: name and text
    flags: str  # how they are compiled: ``"native"`` for the processor of the machine that compiles them
    scene: str  # hash of the scene
    library: bytes
    library_name: str  # name of its file
    platform: str  # system and architecture of `library`
    twin: "SourceParcel | None" = None


def make_parcel(built: BuiltLibrary, flags: str) -> SourceParcel:
    """Return the source of a library; raises LibraryError if its files in the cache are damaged."""
    contents = read_contents(built.entry)
    contents.pop(LOG, None)
    library = contents.pop(built.path.name)
    texts = {name: content.decode("utf-8") for name, content in contents.items()}
    # As it was generated: the manifest in the cache names the instruction sets of this processor.
    texts[MANIFEST_FILE] = replace(built.manifest, instruction_sets=(), target="").to_json()
    files = tuple(sorted(texts.items()))
    digest = hash_text(flags, built.entry.scene, *(text for file in files for text in file))
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
    """Return the library of a parcel, compiled for this machine or found in its cache."""
    cache = cache or Cache()
    texts = dict(parcel.files)
    manifest = Manifest.from_json(texts[MANIFEST_FILE])

    def matches(entry: CacheEntry, found: Manifest) -> bool:
        return entry.scene == parcel.scene and found.scene_hash == manifest.scene_hash

    # Without a compiler the library that came along serves, on a machine of the same kind.
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
    model = CompiledModel(entry.library, manifest, structure=structure)
    if parcel.twin is not None:
        model.build_twin = functools.partial(load_parcel, parcel.twin, structure, cache)
    return model


def _store_library(parcel: SourceParcel, cache: Cache) -> CacheEntry:
    """Keep the library that came along in the cache, under a key of its own."""
    key = hash_text("parcel", parcel.hash, parcel.platform)
    with cache.lock(key):
        stored = cache.find(key)
        if stored is not None:
            return stored
        files = {name: content.encode("utf-8") for name, content in parcel.files}
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
    """

    address: str  # address of the scheduler
    wait: float = 30.0  # longest time to wait for the scheduler, and for a worker whenever there is none [s]

    @contextmanager
    def open(self, work: SweepWork, tasks: Sequence[Task]) -> Iterator["_Cluster"]:
        """Connect to the scheduler; see `Engine.open`. Unfinished tasks are dropped at the end."""
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
        hint = "run the same command again: it goes on where it stopped"
        raise ClusterError(
            "the cluster has dropped the tasks of this sweep", where="scheduler", given=problem, hint=hint
        ) from error

    def _send(self, value: Any) -> Any:
        """Send an object to the cluster; workers pass it on, and it can be had again if one is lost."""
        return self.client.submit(unpack, pickle.dumps(value), pure=False)

    def _source(self, number: int) -> Any:
        """Return the source of a group's library on the cluster, built here when it is first needed."""
        if number not in self.sources:
            group = self.work.plan.groups[number]
            request = library_request(group, self.work.operation)
            parcel = self._pack(group, request)
            beside = request_rigid_twin(group.structure, request)
            twin = None if beside is None else self._pack(group, beside)
            self.sources[number] = self._send(replace(parcel, twin=twin))
        return self.sources[number]

    def _pack(self, group: CaseGroup, request: ModelRequest) -> SourceParcel:
        """Return the source of the library of a request."""
        built = build_library(group.structure, request, calls=MANY_CALLS)
        return make_parcel(built, request.flags)


def _lost(problem: str) -> ClusterError:
    hint = "start workers, and run the same command again: it goes on where it stopped"
    return ClusterError(problem, where="scheduler", hint=hint)


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
    """Return the results of a task, the time that it took, and the machine; sources: by number of group."""
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
