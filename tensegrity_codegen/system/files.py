"""Writing of files, whole or not at all, which replaces files only on request."""

import math
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tensegrity_codegen.system.checks import check_path
from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.system.temporary_files import announce, name_owner, remove_abandoned, withdraw

FILE_RULE = "a file name in a folder that exists and may be written to"
FOLDER_RULE = "a folder that exists or can be made, and may be written to"


def check_ending(path: str | Path, *allowed: str) -> None:
    """Raise OutputError if the name of `path` has an ending (".csv") that is not `allowed`.

    Else a file would hold another format than its name says. A name without an ending is taken as it is.
    """
    check_path(path, "path")
    ending = Path(path).suffix
    if ending and ending.lower() not in allowed:
        raise OutputError(
            f"this output cannot have the ending {ending!r}",
            where=str(path),
            given=Path(path).name,
            allowed=f"a name that ends in {' or '.join(allowed)}",
            hint=f"{Path(path).stem}{allowed[0]}",
        )


def find_kind(path: str | Path) -> str:
    """Return the kind of a path that is no regular file ("a pipe"), "" for a file or nothing at all."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return ""
    kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return "" if stat.S_ISREG(mode) else kinds.get(stat.S_IFMT(mode), "a device")


def check_output(path: str | Path, *, inputs: Iterable[Path] = (), overwrite: bool = False) -> Path:
    """Return the regular file that `path` leads to, so that long work knows before it starts."""
    check_path(path, "path")
    target = Path(os.path.realpath(path))
    try:
        if target.is_dir():
            raise explain_unwritable(path, "this is a folder, not a file")
        exists = target.exists()
        if exists and not target.is_file():
            raise explain_unwritable(path, "this is a device or a pipe, not a file")
        if not target.parent.is_dir():
            raise explain_unwritable(path, f"there is no folder {target.parent}")
    except OSError as error:
        raise explain_unwritable(path, _reason(error)) from error
    check_not_input(path, inputs)
    if exists and not overwrite:
        hint = "choose another name, or pass `overwrite=True` to replace it"
        raise OutputError("the file exists already", where=str(path), hint=hint)
    if not os.access(target.parent, os.W_OK):
        raise explain_unwritable(path, f"the folder {target.parent} may not be written to")
    return target


def check_not_input(path: str | Path, inputs: Iterable[Path]) -> None:
    """Raise OutputError if `path` is one of the files that are read, under whatever name."""
    for source in inputs:
        with suppress(OSError):
            if Path(path).samefile(source):
                problem, allowed = "the output would replace an input", "a file that is not read"
                hint = "choose another name for the output"
                raise OutputError(problem, where=str(path), given=str(source), allowed=allowed, hint=hint)


@contextmanager
def replaced(path: str | Path, *, overwrite: bool) -> Iterator[Path]:
    """Yield a path beside `path` to write to; it takes the place of `path` when the block ends well.

    Nothing is left behind when the block raises; what a killed process left goes with the next call. Raises
    OutputError if the file exists (without `overwrite`) or cannot be written.
    """
    target = check_output(path, overwrite=overwrite)
    # The suffix stays last, since writers choose their format by it.
    ending = f".{target.name[-100:]}"
    remove_abandoned(target.parent, ".", ending)
    temporary = target.with_name(f".{name_owner()}{ending}")
    announce(temporary)
    try:
        try:
            yield temporary
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
            withdraw(temporary)
    except OSError as error:
        raise explain_unwritable(path, _reason(error)) from error


def write_text(text: str, path: str | Path, *, overwrite: bool) -> None:
    """Write a text file whole or not at all; OutputError if one exists and may not be replaced."""
    with replaced(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def plain(value: Any) -> Any:
    """Return `value` in JSON's types; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float):  # NumPy's too
        return float(value) if math.isfinite(value) else None
    if isinstance(value, str | int) or value is None:
        return value
    import numpy as np  # loaded already, if there is such a value

    return plain(value.tolist()) if isinstance(value, np.ndarray | np.generic) else value


def explain_unwritable(path: str | Path, reason: str, what: str = "file") -> OutputError:
    """Return the error for a "file" that cannot be written or a "folder" that cannot be made."""
    return OutputError(
        f"the {what} cannot be {'written' if what == 'file' else 'made'}: {reason}",
        where=str(path),
        allowed=FILE_RULE if what == "file" else FOLDER_RULE,
        hint="check the path, its permissions and free space",
    )


def _reason(error: OSError) -> str:
    return error.strerror or type(error).__name__
