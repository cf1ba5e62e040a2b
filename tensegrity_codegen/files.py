"""Writing files whole or not at all."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tensegrity_codegen.errors import OutputError

__all__ = ["replaced", "write_folder"]


@contextmanager
def replaced(path: str | Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Yield a path beside `path` to write to; it takes the place of `path` when the block ends well.

    Nothing is left behind when the block raises. Raises OutputError where the file exists (without
    `overwrite`) or cannot be written.
    """
    target = Path(path)
    if target.exists() and not overwrite:
        raise OutputError(
            "the file exists already", where=str(path), hint="choose another name, or pass --overwrite"
        )
    # The suffix stays last, since writers choose their format by it.
    temporary = target.with_name(f".{secrets.token_hex(6)}.{target.name[-100:]}")
    try:
        try:
            yield temporary
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"the file cannot be written: {error.strerror or type(error).__name__}",
            where=str(path),
            allowed="a file name in a folder that exists and may be written to",
            hint="check the path and its permissions",
        ) from error


def write_folder(folder: str | Path, files: Mapping[str, bytes]) -> Path:
    """Write files (name -> content) into a folder, made if need be; each file whole or not at all.

    Raises OutputError where the folder cannot be made or written.
    """
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"the folder cannot be made: {error.strerror or type(error).__name__}",
            where=str(folder),
            allowed="a folder that exists or can be made, and may be written to",
            hint="check the path and its permissions",
        ) from error
    for name, content in files.items():
        with replaced(target / name) as path:
            path.write_bytes(content)
    return target
