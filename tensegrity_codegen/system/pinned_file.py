"""Files of packages with pinned hashes: a file of the user, the copy in the cache, or a download by pip."""

import hashlib
import os
import secrets
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from tensegrity_codegen.system.cache_root import (
    check_parents,
    check_private,
    find_cache_root,
    make_private,
    warn_of_fallback,
    write_private,
)
from tensegrity_codegen.system.errors import MissingSourceError, UnsafeCacheError, describe_reason

TIMEOUT = 300.0  # s


@dataclass(frozen=True)
class PinnedFile:
    """A file that a package index offers, of one version and one SHA-256.

    package, version: for pip.
    file: name of the file.
    sha256: its hash; every other file is refused.
    title: its name in messages.
    is_source: whether it is a source archive; else a wheel.
    hand: how a user names the file, such as "daqp_sdist=PATH".
    largest: bytes that a file of a user may have.
    """

    package: str
    version: str
    file: str
    sha256: str
    title: str
    is_source: bool
    hand: str
    largest: int = 2**24

    @property
    def command(self) -> str:
        """The command with which a user downloads the file."""
        kind = "--no-binary" if self.is_source else "--only-binary"
        return f"pip download {self.package}=={self.version} {kind} {self.package} --no-deps"

    @property
    def hint(self) -> str:
        """A remedy if the file cannot be had."""
        return (
            f"download {self.file} of the package {self.package}, where there is a network "
            f"(`{self.command}`), and name the file: {self.hand}"
        )

    def find(self, file: str | Path | None = None) -> bytes:
        """Return the content of `file`, by default of the copy in the cache or of a download by pip."""
        if file is not None:
            return self._read_file(Path(file))
        root = find_cache_root()
        stored = root / "sources" / self.file
        content = self._read_kept(stored, root)
        if content is None:
            with _alone(stored, root):
                content = self._read_kept(stored, root)  # another process may have been faster
                if content is None:
                    content = self.download()
                    _keep(stored, root, content)
        return content

    def is_kept(self) -> bool:
        """Return whether the file is in the cache of this package, undamaged; nothing is downloaded."""
        root = find_cache_root()
        try:
            return self._read_kept(root / "sources" / self.file, root) is not None
        except UnsafeCacheError:
            return False

    def download(self) -> bytes:
        """Return the file that pip downloads from its index; raises MissingSourceError."""
        with tempfile.TemporaryDirectory(prefix="tensegrity_codegen_") as folder:
            requirements = Path(folder) / "wanted.txt"
            requirements.write_text(
                f"{self.package}=={self.version} --hash=sha256:{self.sha256}\n", encoding="ascii"
            )
            # pip runs code of a source archive to read its name; with hashes not before it is verified.
            kind = "--no-binary" if self.is_source else "--only-binary"
            command = [sys.executable, "-P", "-m", "pip", "download", "--require-hashes", kind, self.package]
            command += ["--no-deps", "--quiet", "--disable-pip-version-check", "--no-input", "--dest", folder]
            command += ["--requirement", str(requirements)]
            try:
                done = subprocess.run(
                    command, stdin=subprocess.DEVNULL, capture_output=True, timeout=TIMEOUT, check=False
                )
            except subprocess.TimeoutExpired as error:
                raise self._refuse_download(f"no answer within {TIMEOUT:g} s") from error
            except OSError as error:
                raise self._refuse_download(describe_reason(error)) from error
            path = Path(folder) / self.file
            if done.returncode or not path.is_file():
                raise self._refuse_download(done.stderr.decode("utf-8", "replace"))
            return self._read_file(path)

    def _read_file(self, path: Path) -> bytes:
        try:
            with path.open("rb") as stream:
                content = stream.read(self.largest + 1)
        except (OSError, ValueError) as error:
            problem, value = f"{self.title} cannot be read", describe_reason(error)
            raise MissingSourceError(problem, where=str(path), given=value, hint=self.hint) from error
        actual = hashlib.sha256(content).hexdigest()
        if actual != self.sha256:
            problem = f"this is not {self.title} {self.version}"
            allowed = f"{self.file} with SHA-256 {self.sha256}"
            value = f"SHA-256 {actual}"
            raise MissingSourceError(problem, where=str(path), given=value, allowed=allowed, hint=self.hint)
        return content

    def _read_kept(self, path: Path, root: Path) -> bytes | None:
        """Return the file in the cache; None if there is none, or a damaged one."""
        check_parents(root)
        for directory in (root, path.parent, path):
            check_private(directory, root)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        return content if hashlib.sha256(content).hexdigest() == self.sha256 else None

    def _refuse_download(self, reason: str) -> MissingSourceError:
        lines = [line.strip() for line in reason.splitlines() if line.strip()]
        lines = [line for line in lines if line.startswith("ERROR")] or lines
        return MissingSourceError(
            f"pip cannot download {self.title} {self.version}",
            where=f"{sys.executable} -m {self.command}",
            given=lines[-1] if lines else "no file",
            hint=self.hint,
        )


@contextmanager
def _alone(kept: Path, root: Path) -> Iterator[None]:
    """Let one process at a time download; if no lock can be had, each does."""
    lock = FileLock(f"{kept}.lock", mode=0o600)
    with suppress(OSError, NotImplementedError, Timeout):
        make_private(kept.parent, root)
        lock.acquire(timeout=2.0 * TIMEOUT)
    try:
        yield
    finally:
        lock.release()


def _keep(path: Path, root: Path, content: bytes) -> None:
    """Keep the file in the cache, for this user alone; a cache that cannot be written is left as it is."""
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
