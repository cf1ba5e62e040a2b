"""Plans in files: all arrays (.npz), and the inputs over time (.csv) as profiles of `simulate`."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.model.array_file import write_arrays
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.system.files import check_ending
from tensegrity_codegen.system.table_files import write_csv

ENDINGS = (".npz", ".csv")


def write_plan(found: PlanResult, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a plan to a file, whole or not at all.

    Parameters
    ----------
    found : PlanResult
        The plan.
    path : str or Path
        ``.npz``: all arrays. ``.csv``: a row for each point, the first column ``time`` [s] (``progress``
        where there are no times), then the value of the input of each actuator [m].
    overwrite : bool
        Whether a file that exists is replaced.

    Raises
    ------
    OutputError
        The file cannot be written, exists already, or has another ending.
    """
    check_ending(path, *ENDINGS)
    if Path(path).suffix.lower() == ".npz":
        write_arrays(path, _arrays(found), overwrite=overwrite)
        return
    first, column = ("progress", found.progress) if found.time is None else ("time", found.time)
    rows = np.column_stack([column, found.change]).tolist()
    write_csv(path, (first, *found.actuator_name), rows, overwrite=overwrite)


def _arrays(found: PlanResult) -> dict[str, NDArray[Any]]:
    names = (
        *("progress", "target", "goal", "change", "rest_length", "node_position", "member_tension"),
        *("bar_distance", "smallest_eigenvalue", "residual", "coordinate"),
    )
    words = ("target_name", "target_unit", "actuator_name", "node_name", "member_name", "bar_pair_name")
    arrays: dict[str, NDArray[Any]] = {name: np.asarray(getattr(found, name)) for name in names}
    arrays |= {name: np.array(getattr(found, name), dtype=np.str_) for name in words}
    arrays |= {"status": np.array(found.status), "message": np.array(found.message)}
    rows = [(k, item) for k, items in enumerate(found.binding) for item in items]
    arrays["binding_step"] = np.array([k for k, _ in rows], dtype=np.int64)
    arrays["binding_limit"] = np.array([item.limit for _, item in rows], dtype=np.str_)
    arrays["binding_name"] = np.array([item.name for _, item in rows], dtype=np.str_)
    arrays["binding_multiplier"] = np.array([item.multiplier for _, item in rows], dtype=np.float64)
    if found.time is not None:
        arrays["time"] = found.time
    if isinstance(found.certificate, Certificate):
        arrays["certificate_displacement"] = found.certificate.displacement
        arrays["certificate_elongation"] = found.certificate.elongation
    return arrays
