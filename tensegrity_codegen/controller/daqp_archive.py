"""The source archive of DAQP: a file of the user, the copy in the cache, or what pip downloads; verified."""

from __future__ import annotations

import hashlib
import os
import secrets
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from tensegrity_codegen.codegen.compilation.cache_root import find_cache_root, warn_of_fallback
from tensegrity_codegen.codegen.compilation.private_files import (
    check_parents,
    check_private,
    make_private,
    write_private,
)
from tensegrity_codegen.errors import MissingSourceError, UnsafeCacheError

__all__ = ["DAQP_ARCHIVE", "DAQP_SHA256", "DAQP_VERSION", "find_daqp_archive"]

DAQP_VERSION = "0.11.0"
DAQP_ARCHIVE = f"daqp-{DAQP_VERSION}.tar.gz"
DAQP_SHA256 = "2f27baf18d2acca14186498e651b34e0bed455627e777d3fd8ba655e7e40f920"
LARGEST = 2**24  # byte; the archive has 0.3 MB
TIMEOUT = 300.0  # s
HINT = (
    f"download {DAQP_ARCHIVE}, the source of the package daqp, where there is a network (`pip download "
    f"daqp=={DAQP_VERSION} --no-binary daqp --no-deps`), and name the file: daqp_sdist=PATH"
)


def find_daqp_archive(file: str | Path | None = None) -> bytes:
    """Return the source archive of DAQP, of the pinned version and SHA-256.

    Parameters
    ----------
    file : path, optional
        The archive; by default the copy in the cache of this package, else pip downloads it from the index
        that pip is configured for, and it is kept in the cache.

    Returns
    -------
    bytes
        The archive, a .tar.gz.

    Raises
    ------
    MissingSourceError
        The file cannot be read, is another one, or pip cannot download it.
    """
    if file is not None:
        return _read_file(Path(file))
    root = find_cache_root()
    kept = root / "sources" / DAQP_ARCHIVE
    content = _read_kept(kept, root)
    if content is None:
        with _alone(kept, root):
            content = _read_kept(kept, root)  # another process may have been faster
            if content is None:
                content = _download()
                _keep(kept, root, content)
    return content


@contextmanager
def _alone(kept: Path, root: Path) -> Iterator[None]:
    """Let one process at a time download; where no lock can be had, each does."""
    lock = FileLock(f"{kept}.lock", mode=0o600)
    with suppress(OSError, NotImplementedError, Timeout):
        make_private(kept.parent, root)
        lock.acquire(timeout=2.0 * TIMEOUT)
    try:
        yield
    finally:
        lock.release()


def _read_file(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            content = stream.read(LARGEST + 1)
    except (OSError, ValueError) as error:
        raise MissingSourceError(
            "the source of DAQP cannot be read", where=str(path), given=str(error), hint=HINT
        ) from error
    _check(content, str(path))
    return content


def _check(content: bytes, where: str) -> None:
    """Raise MissingSourceError for another archive than the pinned one."""
    found = hashlib.sha256(content).hexdigest()
    if found != DAQP_SHA256:
        raise MissingSourceError(
            f"this is not the source archive of DAQP {DAQP_VERSION}",
            where=where,
            given=f"SHA-256 {found}",
            allowed=f"{DAQP_ARCHIVE} with SHA-256 {DAQP_SHA256}",
            hint=HINT,
        )


def _read_kept(path: Path, root: Path) -> bytes | None:
    """Return the archive in the cache; None where there is none, or a damaged one."""
    check_parents(root)
    for place in (root, path.parent, path):
        check_private(place, root)
    try:
        content = path.read_bytes()
    except OSError:
        return None
    return content if hashlib.sha256(content).hexdigest() == DAQP_SHA256 else None


def _keep(path: Path, root: Path, content: bytes) -> None:
    """Keep the archive in the cache, for this user alone; a cache that cannot be written is left as it is."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.{secrets.token_hex(4)}")
    warn_of_fallback(root)
    try:
        make_private(path.parent, root)
        write_private(temporary, content)
        temporary.replace(path)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
    except UnsafeCacheError:
        temporary.unlink(missing_ok=True)
        raise


def _download() -> bytes:
    """Return what pip downloads from its index."""
    with tempfile.TemporaryDirectory(prefix="tensegrity_codegen_") as folder:
        wanted = Path(folder) / "wanted.txt"
        wanted.write_text(f"daqp=={DAQP_VERSION} --hash=sha256:{DAQP_SHA256}\n", encoding="ascii")
        # pip runs code of the archive to read its name and version; with hashes not before it is verified.
        command = [sys.executable, "-P", "-m", "pip", "download", "--require-hashes", "--no-binary", "daqp"]
        command += ["--no-deps", "--quiet", "--disable-pip-version-check", "--no-input", "--dest", folder]
        command += ["--requirement", str(wanted)]
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, timeout=TIMEOUT, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise _refuse_download(f"no answer within {TIMEOUT:g} s") from error
        except OSError as error:
            raise _refuse_download(str(error)) from error
        path = Path(folder) / DAQP_ARCHIVE
        if done.returncode or not path.is_file():
            raise _refuse_download(done.stderr.decode("utf-8", "replace"))
        return _read_file(path)


def _refuse_download(reason: str) -> MissingSourceError:
    lines = [line.strip() for line in reason.splitlines() if line.strip()]
    lines = [line for line in lines if line.startswith("ERROR")] or lines
    return MissingSourceError(
        f"pip cannot download the source of DAQP {DAQP_VERSION}",
        where=f"{sys.executable} -m pip download daqp=={DAQP_VERSION} --no-binary daqp",
        given=lines[-1] if lines else "no archive",
        hint=HINT,
    )
