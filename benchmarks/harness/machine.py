"""The machine by what matters to a reader: CPU model and compilers; and one core to stay on."""

import contextlib
import os
import platform
from collections.abc import Iterator, Sequence

from tensegrity_codegen.codegen.compilation.flags import Compiler

PACKAGES = ("casadi", "numpy", "numba", "jax", "mujoco", "scikit-sundae")
ONE_THREAD = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
}

_ALLOWED: set[int] = set()  # cores before pinning, empty where nothing is pinned


def pin_to_one_core() -> str:
    """Keep this process and its children on one core and libraries at one thread; return what was done.

    To be called before NumPy or JAX are imported.
    """
    os.environ.update(ONE_THREAD)
    with contextlib.suppress(AttributeError, OSError):  # no such call on macOS and Windows
        _ALLOWED.update(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {max(_ALLOWED)})
        return "one core, the last one allowed"
    return "not pinned: the system has no such call"


@contextlib.contextmanager
def all_cores() -> Iterator[None]:
    """Give this process all cores that it had before it was pinned, for compilers."""
    if not _ALLOWED:
        yield
        return
    kept = os.sched_getaffinity(0)
    os.sched_setaffinity(0, _ALLOWED)
    try:
        yield
    finally:
        os.sched_setaffinity(0, kept)


def describe_machine(compilers: Sequence[Compiler], pinned: str) -> dict[str, str]:
    """Return CPU model, compilers and packages by version, and whether the process stays on one core."""
    from harness.turns import describe_origin  # imports NumPy
    from tensegrity_codegen.studies.study import find_version

    versions = {name: find_version(name) for name in PACKAGES}
    return {
        "run": describe_origin().removesuffix("."),
        "compilers": "; ".join(f"{compiler.name} {compiler.version}" for compiler in compilers),
        "packages": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "Python": platform.python_version(),
        "pinned": pinned,
    }
