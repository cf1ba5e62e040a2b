"""Number of threads of linear algebra: one if small matrices or many workers use the cores better."""

import ctypes
import itertools
import os
from contextlib import suppress
from pathlib import Path

VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
SETTERS = tuple(
    f"{prefix}{name}{ending}"
    for prefix, name, ending in itertools.product(
        ("", "scipy_"), ("openblas_set_num_threads", "MKL_Set_Num_Threads"), ("", "64_", "_64")
    )
)


def limit_threads() -> None:
    """Let linear algebra use one thread in this process: libraries that are loaded, and those to come."""
    for name in VARIABLES:
        os.environ[name] = "1"
    for path in _find_loaded():
        with suppress(OSError):
            library = ctypes.CDLL(path)
            for name in SETTERS:
                with suppress(AttributeError):
                    getattr(library, name)(1)


def _find_loaded() -> list[str]:
    """Return the libraries of linear algebra in this process; none if the system does not list them."""
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    paths = {line.split(maxsplit=5)[5] for line in lines if len(line.split(maxsplit=5)) == 6}
    return sorted(path for path in paths if "openblas" in Path(path).name or "mkl_rt" in Path(path).name)
