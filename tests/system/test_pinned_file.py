"""Files of packages: verified, kept in the cache, and clear words where they cannot be had."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.system import pinned_file
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tensegrity_codegen.system.errors import MissingSourceError, UnsafeCacheError
from tensegrity_codegen.system.pinned_file import PinnedFile

CONTENT = b"what stands for the archive"
SOURCE = PinnedFile(
    package="daqp",
    version="0.11.0",
    file="daqp-0.11.0.tar.gz",
    sha256=hashlib.sha256(CONTENT).hexdigest(),
    title="the source archive of DAQP",
    is_source=True,
    hand="daqp_sdist=PATH",
)
WHEEL = replace(SOURCE, file="daqp-0.11.0.whl", is_source=False)


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """The content of the pinned file, with an empty cache and without a network."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(PinnedFile, "download", refuse)
    return CONTENT


def refuse(self: PinnedFile) -> bytes:
    raise AssertionError("downloaded")


def offer(self: PinnedFile) -> bytes:
    return CONTENT


def test_a_file_of_the_user_is_taken_where_it_is_the_right_one(tmp_path: Path, archive: bytes) -> None:
    path = tmp_path / "any_name.tar.gz"
    path.write_bytes(archive)
    assert SOURCE.find(path) == archive
    path.write_bytes(archive + b" ")
    with pytest.raises(MissingSourceError, match="this is not the source archive of DAQP") as caught:
        SOURCE.find(path)
    assert caught.value.exit_code == 2
    assert hashlib.sha256(archive + b" ").hexdigest() in str(caught.value)
    assert str(path) in str(caught.value)
    with pytest.raises(MissingSourceError, match="cannot be read"):
        SOURCE.find(tmp_path / "missing.tar.gz")
    with pytest.raises(MissingSourceError, match="cannot be read"):
        SOURCE.find(tmp_path)


def test_what_was_downloaded_is_kept_and_damage_is_noticed(
    tmp_path: Path, archive: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PinnedFile, "download", offer)
    assert SOURCE.find() == archive
    kept = tmp_path / "cache" / "sources" / SOURCE.file
    assert kept.read_bytes() == archive
    assert not [path for path in kept.parent.iterdir() if path.suffix not in (".gz", ".lock")]
    monkeypatch.setattr(PinnedFile, "download", refuse)
    assert SOURCE.find() == archive
    kept.write_bytes(archive[:-1])
    with pytest.raises(AssertionError, match="downloaded"):
        SOURCE.find()
    monkeypatch.setattr(PinnedFile, "download", offer)
    assert SOURCE.find() == kept.read_bytes() == archive


def test_an_archive_that_others_may_write_is_refused(
    tmp_path: Path, archive: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PinnedFile, "download", offer)
    SOURCE.find()
    (tmp_path / "cache" / "sources" / SOURCE.file).chmod(0o666)
    with pytest.raises(UnsafeCacheError):
        SOURCE.find()


def test_a_cache_that_cannot_be_written_is_no_obstacle(
    tmp_path: Path, archive: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").write_text("a file in the way", encoding="utf-8")
    monkeypatch.setattr(PinnedFile, "download", offer)
    assert SOURCE.find() == archive


@pytest.mark.parametrize("kind", [SOURCE, WHEEL])
def test_without_an_index_the_error_says_what_to_try(
    kind: PinnedFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    with pytest.raises(MissingSourceError, match="pip cannot download the source archive of DAQP") as caught:
        kind.download()
    assert "daqp_sdist=PATH" in caught.value.hint
    assert caught.value.exit_code == 2


def test_without_pip_the_error_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    kind = SOURCE
    monkeypatch.setattr(pinned_file.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(MissingSourceError, match="pip cannot download the source archive of DAQP"):
        kind.download()
