"""The folder of a store before it is opened: which sweep it is, whether it is whole, whether it is in use."""

import hashlib
import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.system.errors import OutputError, suggest
from tensegrity_codegen.system.extras import SWEEP, import_extra
from tensegrity_codegen.system.files import check_ending, explain_unwritable
from tensegrity_codegen.system.output_folder import check_folder

CRC_BYTES = 4  # of the checksum at the end of a chunk
CODECS = {True: ["vlen-utf8", "zstd", "crc32c"], False: ["bytes", "blosc", "crc32c"]}  # of text, of numbers
MAX_CHUNKS = 2_000_000  # of an array
MAX_TEXT_BYTES, OTHER_BYTES = (
    4096,
    2**16,
)  # of an entry of text on average; of the other content of each chunk


def check_array(array: Mapping[str, Any]) -> None:
    """Raise ValueError, or an error of look-ups or types, for an array that no sweep has written."""
    chunk = array["chunk_grid"]["configuration"]["chunk_shape"]
    numbers = [*array["shape"], *chunk]
    is_counted = all(type(number) is int and number >= 0 for number in numbers) and min(chunk, default=1) > 0
    codecs = [codec["name"] for codec in array["codecs"]]
    if not is_counted or codecs != CODECS[array["data_type"] == "string"]:
        raise ValueError("an array of another kind")
    chunk_counts = (-(-size // length) for size, length in zip(array["shape"], chunk, strict=True))
    if math.prod(chunk_counts) > MAX_CHUNKS:
        raise ValueError("an array with too many chunks")


def is_whole(file: Path, array: Mapping[str, Any]) -> bool:
    """Return whether a chunk has the checksum (CRC-32C), the size and the kind that were written."""
    is_text = array["data_type"] == "string"
    count: int = math.prod(array["chunk_grid"]["configuration"]["chunk_shape"])
    limit = OTHER_BYTES + count * (MAX_TEXT_BYTES if is_text else np.dtype(array["data_type"]).itemsize)
    try:
        if file.stat().st_size > limit:
            return False
        data = file.read_bytes()
    except OSError:
        return False
    content, checksum = data[:-CRC_BYTES], data[-CRC_BYTES:]
    computed = import_extra("google_crc32c", SWEEP).value(content)
    if not content or computed != int.from_bytes(checksum, "little"):
        return False
    numcodecs = import_extra("numcodecs", SWEEP)
    try:
        if not is_text:
            size = int.from_bytes(content[4:8], "little")
            return size == limit - OTHER_BYTES and len(numcodecs.blosc.decompress(content)) == size
        if read_frame_size(content) > limit:
            return False
        decoded = numcodecs.zstd.decompress(content)
        return int.from_bytes(decoded[:4], "little") == count == len(numcodecs.VLenUTF8().decode(decoded))
    except (IndexError, RuntimeError, ValueError):
        return False


def read_frame_size(data: bytes) -> int:
    """Return the size in a header of Zstandard (RFC 8878, 3.1.1.1); raises ValueError, IndexError."""
    is_single = data[4] >> 5 & 1
    width = (is_single, 2, 4, 8)[data[4] >> 6]
    if data[:4] != b"\x28\xb5\x2f\xfd" or not width:
        raise ValueError("no frame with a size")
    start = 6 - is_single + (0, 1, 2, 4)[data[4] & 3]
    return int.from_bytes(data[start : start + width], "little") + 256 * (width == 2)


ATTRIBUTE = "tensegrity_codegen_sweep"
FORMAT = 2
METADATA = "zarr.json"
STATUS, MESSAGE, RECORD = "status", "message", "task_record"
ENDING = ".zarr"
MOST_NAMED = 4


@dataclass(frozen=True)
class StoredSweep:
    """The metadata in the folder of a sweep."""

    path: Path  # the folder
    identity: Mapping[str, Any]  # sources of its results
    task_size: int  # largest number of cases of a task
    attributes: Mapping[str, Any]  # all attributes of the data set
    arrays: Mapping[str, Mapping[str, Any]] = field(repr=False)  # metadata of each array

    @cached_property
    def layout(self) -> CaseLayout:
        """How the cases lie in the arrays."""
        return CaseLayout(tuple(self.arrays[STATUS]["shape"]), self._chunk(STATUS))

    @cached_property
    def results(self) -> tuple[str, ...]:
        """Names of the arrays with a chunk for each task, in the order of writing: the status is last."""
        sweep = self.attributes[ATTRIBUTE]
        dims, keys = sweep["case_dims"], sweep["keys"].values()
        names = [
            name
            for name, array in self.arrays.items()
            if name not in (STATUS, MESSAGE, *keys)
            and array["dimension_names"][: len(dims)] == dims
            and 0 not in array["shape"]
        ]
        return (*names, MESSAGE, STATUS)

    @cached_property
    def coordinate_files(self) -> tuple[Path, ...]:
        """Chunks of the values of keys and of labels, which are written with a new folder."""
        files = []
        for name in sorted(self.arrays.keys() - {*self.results, RECORD}):
            sizes = zip(self.arrays[name]["shape"], self._chunk(name), strict=True)
            positions = itertools.product(*(range(-(-size // length)) for size, length in sizes))
            files += [self._chunk_file(name, position) for position in positions]
        return tuple(files)

    def chunk_file(self, name: str, task: int) -> Path:
        """Return the file of a result of a task, of its status or record."""
        position = (task,) if name == RECORD else self.layout.place_of(task)
        return self._chunk_file(name, (*position, *[0] * (len(self.arrays[name]["shape"]) - len(position))))

    def is_whole(self, file: Path) -> bool:
        """Return whether a chunk is as it was written."""
        return is_whole(file, self.arrays[file.relative_to(self.path).parts[0]])

    def _chunk(self, name: str) -> tuple[int, ...]:
        return tuple(self.arrays[name]["chunk_grid"]["configuration"]["chunk_shape"])

    def _chunk_file(self, name: str, place: tuple[int, ...]) -> Path:
        return self.path.joinpath(name, "c", *map(str, place))


def check_store_folder(path: str | Path) -> StoredSweep | None:
    """Return the sweep in a folder, None where there is nothing yet; raises OutputError for anything else."""
    check_store_name(path)
    target = check_folder(path)
    if not os.path.lexists(target) or (target.is_dir() and not any(target.iterdir())):
        return None
    return read_stored_sweep(target, is_output=True)


def check_store_name(path: Any) -> None:
    """Raise OutputError unless this can be the name of a folder of results."""
    problem, name = "", str(path) if isinstance(path, Path) else path
    if not isinstance(path, str | Path):
        problem = "not the name of a folder"
    elif Path(path).name in ("", ".."):
        problem = "the name of the folder is empty, or leads to the current folder or one above"
    elif "\0" in str(path):
        problem = "the name of the folder has a zero character"
    if problem:
        raise OutputError(problem, where="out", given=name, allowed=f"a name that ends in {ENDING}")
    check_ending(path, ENDING)


def read_stored_sweep(path: str | Path, *, is_output: bool = False) -> StoredSweep:
    """Return the metadata of the folder of a sweep; raises OutputError for any other folder."""
    folder = Path(path)
    try:
        data = json.loads((folder / METADATA).read_bytes())
        attributes = data["attributes"]
        format = attributes[ATTRIBUTE]["format"]
        arrays = data["consolidated_metadata"]["metadata"] if format == FORMAT else {}
        for array in arrays.values():
            check_array(array)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        new = ", or a new name for another one" if is_output else ""
        reason = f": {METADATA} is damaged or of another program" if (folder / METADATA).exists() else ""
        problem = f"this is not a sweep{reason}" if folder.exists() else "there is no such folder"
        allowed = f"a Zarr folder that `sweep` wrote{new}"
        hint = "choose another name, or remove what is there" if is_output else _suggest_near(folder)
        raise OutputError(problem, where=str(path), allowed=allowed, hint=hint) from error
    if format != FORMAT:
        problem = "the sweep was written in another format of its folder"
        hint = "use the version of tensegrity_codegen that wrote it, or choose another name"
        raise OutputError(problem, where=str(path), given=format, allowed=str(FORMAT), hint=hint)
    # A file that was edited is not trusted.
    sweep = attributes[ATTRIBUTE]
    if sweep.get("checksum") != compute_checksum(data):
        problem = "this file is damaged or was edited: its checksum is not that of its content"
        location = str(folder / METADATA)
        hint = "restore it from a copy, or remove the folder and run the sweep again"
        raise OutputError(problem, where=location, allowed="the file as `sweep` wrote it", hint=hint)
    return StoredSweep(folder, sweep["identity"], sweep["task_size"], attributes, arrays)


def compute_checksum(metadata: Mapping[str, Any]) -> str:
    """Return the sha256 of the content of a file of metadata: the sweep and its arrays."""
    sweep = {key: value for key, value in metadata["attributes"][ATTRIBUTE].items() if key != "checksum"}
    content = [sweep, metadata.get("consolidated_metadata")]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _suggest_near(folder: Path) -> str:
    """Return a hint that lists the sweeps beside a folder that is none."""
    parent = folder if folder.is_dir() else folder.parent
    with suppress(OSError):
        names = [path.name for path in parent.iterdir() if path.suffix == ENDING and path != folder]
        return f"in {parent.absolute()}: {suggest(folder.name, names)}" if names else ""
    return ""


def find_finished(path: str | Path) -> frozenset[int]:
    """Return the numbers of the tasks in a folder that have a record and of which no file is damaged."""
    if not (Path(path) / METADATA).exists():
        return frozenset()
    stored = read_stored_sweep(path)
    return frozenset(
        task
        for task in range(stored.layout.n_tasks)
        if all(stored.is_whole(stored.chunk_file(name, task)) for name in (RECORD, *stored.results))
    )


def find_damaged(stored: StoredSweep) -> list[Path]:
    """Return the files that are not as they were written, or are missing: of coordinates and results."""
    damaged = [file for file in stored.coordinate_files if not stored.is_whole(file)]
    for task in range(stored.layout.n_tasks):
        is_computed = any(os.path.lexists(stored.chunk_file(name, task)) for name in (STATUS, RECORD))
        files = [stored.chunk_file(name, task) for name in stored.results]
        damaged += [
            file for file in files if (is_computed or os.path.lexists(file)) and not stored.is_whole(file)
        ]
    return damaged


def check_not_damaged(stored: StoredSweep) -> None:
    """Raise OutputError, naming files, if a stored sweep is not as it was written."""
    damaged = [str(file.relative_to(stored.path)) for file in find_damaged(stored)]
    if damaged:
        hidden = [f"{len(damaged) - MOST_NAMED} more"] if len(damaged) > MOST_NAMED else []
        problem, value = "files of results are damaged or missing", ", ".join(damaged[:MOST_NAMED] + hidden)
        allowed = "files as `sweep` wrote them"
        hint = "run the same sweep again with this folder: it computes again what is damaged"
        raise OutputError(problem, where=str(stored.path), given=value, allowed=allowed, hint=hint)


@contextmanager
def locked_store(path: str | Path) -> Iterator[None]:
    """Keep other sweeps out of a folder; raises OutputError while one is at work there."""
    folder = Path(path).absolute()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise explain_unwritable(path, error.strerror or type(error).__name__, "folder") from error
    lock_file = folder.with_name(f".{folder.name}.lock")
    lock = FileLock(str(lock_file), timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        if not lock_file.exists():
            raise explain_unwritable(path, "no file can be made there", "folder") from error
        hint = "wait for its end, or choose another name"
        raise OutputError("another sweep is writing to this folder", where=str(path), hint=hint) from error
    except (OSError, NotImplementedError):  # the file system has no locks
        yield
        return
    try:
        yield
    finally:
        lock_file.unlink(missing_ok=True)
        lock.release()


def open_sweep(path: str | Path) -> Any:
    """Open the results of a sweep, finished or not; arrays are verified, and read when they are used.

    path: the folder that `sweep` wrote. Returns one variable a quantity, units and description in its
    attributes; dimensions are the axes of the grid or ``case``, then ``time``, ``node``, ``member``. Cases
    that are not computed yet have the status -1. Raises MissingExtraError: xarray or Zarr is not installed;
    OutputError: the folder is not a sweep, or files in it are damaged or missing.
    """
    stored = read_stored_sweep(path)
    check_not_damaged(stored)
    import_extra("zarr", SWEEP)
    xarray = import_extra("xarray", SWEEP)
    dataset = xarray.open_zarr(str(stored.path), chunks=None, consolidated=True, zarr_format=3)
    return dataset.drop_vars(RECORD)


MAX_DIFFERENCES = 8
LONGEST = 60  # characters of a value in a message
ABSENT = object()
# Values of an identity, and those that they follow from by the beginnings of their keys.
FOLLOWING = {
    "structure_hash": ("scene",),
    "cases.method": ("cases.points.method",),
    "cases.count": ("cases.axes", "cases.points"),
}


def check_same_sweep(path: str | Path, stored: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Raise OutputError, naming the differences, unless two identities are equal."""
    differences = find_differences(stored, asked)
    if not differences:
        return
    n_hidden = len(differences) - MAX_DIFFERENCES
    rows = [*differences[:MAX_DIFFERENCES], *([f"and {n_hidden} more"] if n_hidden > 0 else [])]
    raise OutputError(
        f"the folder holds another sweep; {len(differences)} of its settings "
        f"{'differs' if len(differences) == 1 else 'differ'}:\n    " + "\n    ".join(rows),
        where=str(path),
        allowed="the sweep that the folder holds, which then goes on where it stopped",
        hint="choose another name, or remove the folder",
    )


def find_differences(stored: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """Return a line for each value that differs, without those that follow from others that do."""
    differences = {key: (old, new) for key, old, new in _compare("", _normalise(stored), _normalise(asked))}
    for result, sources in FOLLOWING.items():
        if result in differences and any(key != result and key.startswith(sources) for key in differences):
            del differences[result]
    return [f"{key}: {_show(old)} in the folder, {_show(new)} now" for key, (old, new) in differences.items()]


def _normalise(value: Mapping[str, Any]) -> Any:
    """Return the value as JSON gives it back: tuples are lists."""
    return json.loads(json.dumps(value))


def _compare(key: str, old: Any, new: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for name in [*old, *(name for name in new if name not in old)]:
            path = f"{key}.{name}" if key else name
            yield from _compare(path, old.get(name, ABSENT), new.get(name, ABSENT))
    elif (
        isinstance(old, list)
        and isinstance(new, list)
        and len(old) == len(new)
        and any(isinstance(entry, dict) for entry in old)
    ):
        for index, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from _compare(f"{key}[{_label(index, a, b)}]", a, b)
    elif old is ABSENT or new is ABSENT or old != new:
        yield key, old, new


def _label(place: int, a: Any, b: Any) -> str:
    """Return the key or name that two entries of a list have in common, else their place."""
    for key in ("key", "name"):
        if isinstance(a, dict) and isinstance(b, dict) and a.get(key) and a.get(key) == b.get(key):
            return str(a[key])
    return str(place)


def _show(value: Any) -> str:
    if value is ABSENT:
        return "absent"
    if isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 6:
        return f"{len(value)} values from {value[0]} to {value[-1]}"
    shown = json.dumps(value)
    return shown if len(shown) <= LONGEST else shown[: LONGEST - 3] + "..."
