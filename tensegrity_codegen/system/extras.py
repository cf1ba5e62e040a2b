"""Optional packages: whether they are there, and how they are installed."""

import importlib
from typing import Any

from tensegrity_codegen.system.errors import MissingExtraError

PLOT, CONTROL, TABLES, SWEEP, CLUSTER, CAD = "plot", "control", "tables", "sweep", "cluster", "cad"
LEARN = "learn"
JAX, TORCH = "jax", "torch"  # which no extra of this package installs
PACKAGES = {  # the packages of each extra, as in pyproject.toml
    PLOT: ("matplotlib", "pillow"),
    "cc": ("ziglang",),
    CONTROL: ("control", "daqp"),
    TABLES: ("pandas", "pyarrow", "xarray"),
    SWEEP: ("SALib", "google-crc32c", "xarray", "zarr"),
    CLUSTER: ("dask", "distributed"),
    CAD: ("ezdxf",),
    LEARN: ("gymnasium",),
}
WORK = {
    PLOT: "pictures need",
    CONTROL: "plans and feedback need",
    TABLES: "this kind of table needs",
    SWEEP: "sweeps need",
    CLUSTER: "sweeps on a cluster need",
    CAD: "DXF files need",
    LEARN: "environments need",
    JAX: "functions of JAX need",
    TORCH: "functions of PyTorch need",
}


def name_install(extra: str) -> str:
    """Return the command that installs an extra of this package; no index has the package yet.

    Elsewhere than in a checkout, where a wheel was installed: the packages of the extra by their names.
    """
    if extra not in PACKAGES:
        return f"pip install {extra}"
    command = f"pip install '.[{extra}]' in a checkout of tensegrity_codegen"
    return f"{command}; elsewhere: pip install {' '.join(PACKAGES[extra])}"


def import_extra(name: str, extra: str = PLOT) -> Any:
    """Return the module `name` of an extra; raises MissingExtraError if it cannot be imported."""
    try:
        importlib.import_module(
            name.partition(".")[0]
        )  # a submodule may be loaded although its package is gone
        return importlib.import_module(name)
    except ImportError as error:
        package = (error.name or name).partition(".")[0].replace("PIL", "pillow")
        problem = f"{WORK[extra]} the package {package!r}, which is not installed"
        raise MissingExtraError(problem, hint=name_install(extra)) from error


def require_plot() -> None:
    """Raise MissingExtraError if pictures cannot be drawn; called before long work that ends in pictures."""
    for name in ("matplotlib.figure", "matplotlib.backends.backend_agg"):
        import_extra(name)
