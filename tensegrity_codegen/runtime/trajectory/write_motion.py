"""Files of motions: the ending of the name says which kind."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tensegrity_codegen.runtime.model.array_file import write_arrays
from tensegrity_codegen.runtime.trajectory.frames import list_columns
from tensegrity_codegen.system.files import check_ending
from tensegrity_codegen.system.table_files import require_packages, write_csv, write_mat, write_parquet


def _write_npz(motion: Any, path: Path, overwrite: bool) -> None:
    write_arrays(path, motion.arrays(), overwrite=overwrite)


def _write_csv(motion: Any, path: Path, overwrite: bool) -> None:
    columns = list_columns(motion)
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    write_csv(path, list(columns), rows, overwrite=overwrite)


def _write_parquet(motion: Any, path: Path, overwrite: bool) -> None:
    facts = {name: getattr(motion, name) for name in ("status", "message", "method")}
    texts = {name: value if isinstance(value, str) else "\n".join(value) for name, value in facts.items()}
    write_parquet(path, list_columns(motion), texts, overwrite=overwrite)


def _write_mat(motion: Any, path: Path, overwrite: bool) -> None:
    write_mat(path, motion.arrays(), overwrite=overwrite)


# Kinds of files by their endings, the usual one first.
WRITERS: Mapping[str, Callable[[Any, Path, bool], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".mat": _write_mat,
}
MOTION_ENDINGS = tuple(WRITERS)


def check_motion_file(path: str | Path) -> None:
    """Raise OutputError for a name with another ending, MissingExtraError where its package is missing."""
    check_ending(path, *MOTION_ENDINGS)
    require_packages(path)


def write_motion(motion: Any, path: str | Path, *, overwrite: bool) -> None:
    """Write a Trajectory or BatchTrajectory in the format of the path's ending; without one as .npz.

    Raises OutputError if it cannot be written, exists (without `overwrite`), or has another ending.
    """
    check_motion_file(path)
    WRITERS.get(Path(path).suffix.lower(), _write_npz)(motion, Path(path), overwrite)
