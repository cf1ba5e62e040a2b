"""The cache is used only if no other user can have written to it."""

import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.system.errors import UnsafeCacheError
from tests.codegen.compilers import POSIX

pytestmark = POSIX
KEY, REQUEST = "a" * 64, "b" * 64
FILES = {"manifest.json": b"{}", "libprism.so": b"library", "compile.log": b""}
NOBODY = 65534
ROOT_ONLY = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may give files to another user"
)


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    made = Cache(tmp_path / "cache")
    made.store(KEY, FILES)
    made.store_request(REQUEST, KEY)
    return made


@pytest.fixture
def open_umask() -> Iterator[None]:
    """Let new files be writable by all users, as on a badly set up machine."""
    before = os.umask(0)
    yield
    os.umask(before)


def places(cache: Cache) -> dict[str, Path]:
    """Return what another user must not be able to write, by name."""
    entry = cache.root / "libraries" / KEY
    return {
        "root": cache.root,
        "libraries": cache.root / "libraries",
        "entry": entry,
        "library": entry / "libprism.so",
        "manifest": entry / "manifest.json",
        "log": entry / "compile.log",
        "entry.json": entry / "entry.json",
    }


PLACES = ("root", "libraries", "entry", "library", "manifest", "log", "entry.json")


def find_refused(cache: Cache) -> UnsafeCacheError:
    with pytest.raises(UnsafeCacheError) as caught:
        cache.find(KEY)
    with pytest.raises(UnsafeCacheError):
        cache.store(KEY, FILES)
    return caught.value


@pytest.mark.usefixtures("open_umask")
def test_all_that_is_made_is_for_this_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "new" / "cache")
    cache.store(KEY, FILES)
    cache.store_request(REQUEST, KEY)
    made = [tmp_path / "new", *(tmp_path / "new").rglob("*")]
    assert len(made) > 10
    for path in made:
        mode = path.stat().st_mode
        assert not mode & (stat.S_IWGRP | stat.S_IWOTH), path
        assert path.is_file() or stat.S_IMODE(mode) == 0o700, path
    assert cache.find(KEY) is not None
    assert cache.lookup_request(REQUEST) == KEY


@pytest.mark.parametrize("mode", [0o020, 0o002])
@pytest.mark.parametrize("name", PLACES)
def test_what_other_users_may_write_is_refused(name: str, mode: int, cache: Cache) -> None:
    path = places(cache)[name]
    path.chmod(path.stat().st_mode | mode)
    error = find_refused(cache)
    assert error.where == str(path)
    assert "other users may write" in str(error.given)
    assert "chmod 700" in error.hint
    assert error.exit_code == 2


@ROOT_ONLY
@pytest.mark.parametrize("name", PLACES)
def test_what_belongs_to_another_user_is_refused(name: str, cache: Cache) -> None:
    path = places(cache)[name]
    os.chown(path, NOBODY, NOBODY)
    assert f"belongs to user {NOBODY}" in str(find_refused(cache).given)


@pytest.mark.parametrize("name", PLACES)
def test_links_are_refused(name: str, cache: Cache, tmp_path: Path) -> None:
    path = places(cache)[name]
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    error = find_refused(cache)
    assert (error.where, error.given) == (str(path), "a symbolic link")


def link(path: Path) -> None:
    path.rename(path.with_suffix(".moved"))
    path.symlink_to(path.with_suffix(".moved"))


@pytest.mark.parametrize("change", [lambda path: path.chmod(0o666), link])
def test_an_unsafe_request_is_refused(change: Callable[[Path], None], cache: Cache) -> None:
    change(cache.root / "requests" / f"{REQUEST}.json")
    with pytest.raises(UnsafeCacheError):
        cache.lookup_request(REQUEST)


@pytest.mark.parametrize("name", ["locks", "temporary", "requests"])
def test_no_file_is_written_through_a_link(name: str, tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "cache").mkdir(mode=0o700)
    (tmp_path / "cache" / name).symlink_to(tmp_path / "theirs")
    cache = Cache(tmp_path / "cache")

    def use() -> None:
        cache.store(KEY, FILES)
        cache.store_request(REQUEST, KEY)

    with pytest.raises(UnsafeCacheError):
        use()
    assert list((tmp_path / "theirs").iterdir()) == []


def test_a_parent_folder_whose_content_any_user_may_replace_is_refused(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    cache = Cache(tmp_path / "open" / "cache")
    with pytest.raises(UnsafeCacheError) as caught:
        cache.store(KEY, FILES)
    assert caught.value.where == str(tmp_path / "open")
    (tmp_path / "open").chmod(0o1777)  # as /tmp is
    assert cache.store(KEY, FILES).library is not None


def test_a_pipe_is_refused_instead_of_waited_for(cache: Cache) -> None:
    path = places(cache)["manifest"]
    path.unlink()
    os.mkfifo(path)
    assert find_refused(cache).given == "neither a file nor a folder"


def test_without_user_ids_links_are_still_refused(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tensegrity_codegen.system.cache_root.HAS_OWNERS", False)
    cache.root.chmod(0o777)
    assert cache.find(KEY) is not None
    cache.root.rename(cache.root.with_name("moved"))
    cache.root.symlink_to(cache.root.with_name("moved"))
    with pytest.raises(UnsafeCacheError):
        cache.find(KEY)
