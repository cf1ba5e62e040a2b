"""The source archive of DAQP: verified, kept in the cache, and clear words where it cannot be had."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.cache_root import CACHE_VARIABLE
from tensegrity_codegen.controller import daqp_archive
from tensegrity_codegen.controller.daqp_archive import DAQP_ARCHIVE, DAQP_SHA256, find_daqp_archive
from tensegrity_codegen.errors import MissingSourceError, UnsafeCacheError
from tests.controller.daqp import require_daqp_archive


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """An archive that counts as the right one, in an empty cache, without a network."""
    content = b"what stands for the archive"
    monkeypatch.setattr(daqp_archive, "DAQP_SHA256", hashlib.sha256(content).hexdigest())
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(daqp_archive, "_download", refuse)
    return content


def refuse() -> bytes:
    raise AssertionError("downloaded")


def test_the_archive_is_the_pinned_one() -> None:
    assert hashlib.sha256(require_daqp_archive()).hexdigest() == DAQP_SHA256


def test_a_file_of_the_user_is_taken_where_it_is_the_right_one(tmp_path: Path, archive: bytes) -> None:
    path = tmp_path / "any_name.tar.gz"
    path.write_bytes(archive)
    assert find_daqp_archive(path) == archive
    path.write_bytes(archive + b" ")
    with pytest.raises(MissingSourceError, match="this is not the source archive of DAQP") as caught:
        find_daqp_archive(path)
    assert caught.value.exit_code == 2
    assert hashlib.sha256(archive + b" ").hexdigest() in str(caught.value)
    assert str(path) in str(caught.value)
    with pytest.raises(MissingSourceError, match="cannot be read"):
        find_daqp_archive(tmp_path / "missing.tar.gz")
    with pytest.raises(MissingSourceError, match="cannot be read"):
        find_daqp_archive(tmp_path)


def test_what_was_downloaded_is_kept_and_damage_is_noticed(
    tmp_path: Path, archive: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(daqp_archive, "_download", lambda: archive)
    assert find_daqp_archive() == archive
    kept = tmp_path / "cache" / "sources" / DAQP_ARCHIVE
    assert kept.read_bytes() == archive
    assert not [path for path in kept.parent.iterdir() if path.suffix not in (".gz", ".lock")]
    monkeypatch.setattr(daqp_archive, "_download", refuse)
    assert find_daqp_archive() == archive
    kept.write_bytes(archive[:-1])
    with pytest.raises(AssertionError, match="downloaded"):
        find_daqp_archive()
    monkeypatch.setattr(daqp_archive, "_download", lambda: archive)
    assert find_daqp_archive() == kept.read_bytes() == archive


def test_an_archive_that_others_may_write_is_refused(
    tmp_path: Path, archive: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(daqp_archive, "_download", lambda: archive)
    find_daqp_archive()
    (tmp_path / "cache" / "sources" / DAQP_ARCHIVE).chmod(0o666)
    with pytest.raises(UnsafeCacheError):
        find_daqp_archive()


def test_a_cache_that_cannot_be_written_is_no_obstacle(
    tmp_path: Path, archive: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").write_text("a file in the way", encoding="utf-8")
    monkeypatch.setattr(daqp_archive, "_download", lambda: archive)
    assert find_daqp_archive() == archive


def test_without_an_index_the_error_says_what_to_try(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    with pytest.raises(MissingSourceError, match="pip cannot download the source of DAQP") as caught:
        daqp_archive._download()
    assert "daqp_sdist=PATH" in caught.value.hint
    assert caught.value.exit_code == 2


def test_without_pip_the_error_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(daqp_archive.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(MissingSourceError, match="pip cannot download the source of DAQP"):
        daqp_archive._download()
