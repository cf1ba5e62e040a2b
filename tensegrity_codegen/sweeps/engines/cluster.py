"""A connection to a Dask scheduler: that it is there, that it has workers, and that these can do the work."""

import functools
import platform
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tensegrity_codegen.codegen.compilation.fingerprint import hash_package
from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import ClusterError, InvalidValueError
from tensegrity_codegen.system.extras import CLUSTER, import_extra
from tensegrity_codegen.system.forked import count_workers
from tensegrity_codegen.system.version import VERSION

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
    """Give a client of the scheduler at an address, once it has a worker.

    address: address of the scheduler, for example ``"tcp://10.0.0.1:8786"``; wait: longest time to wait for
    the scheduler and for a worker [s].
    Raises MissingExtraError: dask is not installed; ClusterError: there is no scheduler, it has no workers,
    or a worker has other versions.
    """
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
    """Raise InvalidValueError for what is no time to wait [s]."""
    if isinstance(wait, bool) or not isinstance(wait, int | float) or not 0.0 <= wait < 1e7:
        raise InvalidValueError("not a time", where="wait", given=wait, allowed="seconds, from 0 on")


def check_workers(workers: Any) -> int | Cluster:
    """Return where a sweep is computed, by default one process a core; raises InvalidValueError."""
    if not isinstance(workers, Cluster):
        found = count_workers() if workers is None else workers
        return check_whole(found, "workers", 1, problem="not a number of workers")
    if not isinstance(workers.address, str) or not workers.address.strip():
        raise InvalidValueError(
            "not the address of a scheduler",
            where="scheduler",
            given=workers.address,
            allowed="a text such as tcp://10.0.0.1:8786",
            hint="`workers` is a number for processes of this machine",
        )
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
        raise ClusterError(
            f"no scheduler answered within {within:g} s",
            where="scheduler",
            given=address,
            allowed="the address of a Dask scheduler, such as tcp://10.0.0.1:8786",
            hint="start one with `dask scheduler`, and workers with `dask worker ADDRESS`",
        ) from error


def _knock(address: str, within: float) -> None:
    """Raise OSError or ValueError where nothing listens; clients of distributed may hang after that."""
    scheme, _, place = address.rpartition("://")
    if scheme not in ("", "tcp", "tls"):
        return
    host, _, port = place.rpartition(":") if ":" in place else (place, "", PORT)
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
            raise ClusterError(
                f"the scheduler has no workers after {wait:g} s",
                where="scheduler",
                given=address,
                allowed="a scheduler with one worker or more",
                hint=f"start workers with `dask worker {address}`, or wait longer, with a larger `wait`",
            )
        time.sleep(LOOK)


def _check_workers(client: Any) -> None:
    """Raise ClusterError for the first worker that cannot do the work."""
    found = client.run(describe_versions, on_error="return")
    for worker, versions in sorted(found.items()):
        if isinstance(versions, ImportError):
            versions = {}
        if isinstance(versions, BaseException):
            raise ClusterError(
                "a worker does not answer", where=f"worker {worker}", given=str(versions)
            ) from versions
        check_versions(describe_versions(), versions, worker)


@functools.cache
def describe_versions() -> dict[str, str]:
    """Return the versions in this process, by name."""
    python = ".".join(platform.python_version_tuple()[:2])
    source = hash_package(Path(__file__).resolve().parents[2], template_folder())[:12]
    found = {OWN: VERSION, SOURCE: source, "Python": python}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def check_versions(expected: Mapping[str, str], found: Mapping[str, str], worker: str) -> None:
    """Raise ClusterError, naming what differs, unless a worker has the versions of the client."""
    different = [name for name, value in expected.items() if found.get(name) != value]
    if different:
        raise ClusterError(
            "a worker has other versions than this process",
            where=f"worker {worker}",
            given=", ".join(f"{name} {found.get(name, 'not installed')}" for name in different),
            allowed=", ".join(f"{name} {expected[name]}" for name in different),
            hint="start the workers in the environment of this process, or in one with the same versions",
        )
