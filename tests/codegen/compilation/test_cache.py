import errno
import json
import multiprocessing
import os
import time
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation import cache as cache_module
from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE, find_cache_root
from tensegrity_codegen.system.errors import CompileError, OutputError
from tests.codegen.compilers import POSIX

KEY, OTHER, THIRD = "a" * 64, "b" * 64, "c" * 64
FILES = {
    "prism.c": b"int prism;\n",
    "manifest.json": b"{}\n",
    "libprism.so": bytes(range(256)) * 8,
    "compile.log": b"",
}


@pytest.fixture
def cache(tmp_path):
    return Cache(tmp_path / "cache")


def age(path, seconds):
    then = time.time() - seconds
    os.utime(path, (then, then))


def make_and_count(root, key, counter, barrier):
    """Make a library unless it is there, as two processes do that want the same one at once."""
    cache = Cache(Path(root))
    barrier.wait(100)
    with cache.lock(key):
        entry = cache.find(key)
        if entry is None:
            with counter.get_lock():
                counter.value += 1
            time.sleep(0.2)
            entry = cache.store(key, FILES)
    assert entry.library.read_bytes() == FILES["libprism.so"]


def store_many(root, key, barrier):
    """Store without asking first, as often as a race may need."""
    cache = Cache(Path(root))
    barrier.wait(100)
    for _ in range(20):
        assert cache.store(key, FILES).library.read_bytes() == FILES["libprism.so"]


def run_together(target, count, *arguments):
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(count)
    processes = [context.Process(target=target, args=(*arguments, barrier)) for _ in range(count)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(200)
    assert [process.exitcode for process in processes] == [0] * count


def test_the_folder_is_the_users_unless_the_variable_names_one(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert find_cache_root() == tmp_path
    assert Cache().root == tmp_path
    monkeypatch.delenv(CACHE_VARIABLE)
    assert find_cache_root().name.startswith("tensegrity_codegen")


def test_nothing_is_written_before_something_is_stored(cache):
    assert cache.find(KEY) is None
    assert cache.lookup_request(KEY) is None
    assert cache.size() == 0
    assert not cache.root.exists()


def test_what_is_stored_is_found_with_all_its_files(cache):
    stored = cache.store(KEY, FILES)
    found = cache.find(KEY)
    assert found == stored
    assert set(found.files) == set(FILES)
    assert {name: (found.folder / name).read_bytes() for name in found.files} == FILES
    assert found.library.name == "libprism.so"
    assert found.manifest.name == "manifest.json"
    assert list((cache.root / "temporary").iterdir()) == []
    assert Cache(cache.root).find(KEY) == stored


def test_entry_json_lists_sizes_and_hashes(cache):
    folder = cache.store(KEY, FILES).folder
    files = json.loads((folder / "entry.json").read_text(encoding="utf-8"))["files"]
    assert files["compile.log"] == {
        "size": 0,
        "sha256": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
    }
    assert set(files) == set(FILES)


def test_a_second_store_keeps_the_first_entry(cache):
    first = cache.store(KEY, FILES)
    inode = first.library.stat().st_ino
    second = cache.store(KEY, FILES | {"libprism.so": b"another"})
    assert second == first
    assert second.library.read_bytes() == FILES["libprism.so"]
    assert second.library.stat().st_ino == inode


def test_a_request_leads_to_its_library(cache):
    cache.store_request(OTHER, KEY)
    assert cache.lookup_request(OTHER) == KEY
    cache.store_request(OTHER, THIRD)
    assert cache.lookup_request(OTHER) == THIRD


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"version": 1}', '{"version": 1, "library": "../x"}', "\xff"]
)
def test_a_damaged_request_is_absent(cache, text):
    cache.store_request(OTHER, KEY)
    (cache.root / "requests" / f"{OTHER}.json").write_bytes(text.encode("latin-1"))
    assert cache.lookup_request(OTHER) is None


def cut(path):
    path.write_bytes(path.read_bytes()[:-7])


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def write(folder, text):
    (folder / "entry.json").write_text(text, encoding="utf-8")


def rewrite(folder, removed):
    """Remove a file and what entry.json says of it."""
    (folder / removed).unlink()
    data = json.loads((folder / "entry.json").read_text(encoding="utf-8"))
    del data["files"][removed]
    write(folder, json.dumps(data))


DAMAGES = {
    "library cut short": lambda folder: cut(folder / "libprism.so"),
    "library changed": lambda folder: flip(folder / "libprism.so"),
    "library missing": lambda folder: (folder / "libprism.so").unlink(),
    "manifest changed": lambda folder: flip(folder / "manifest.json"),
    "source cut short": lambda folder: cut(folder / "prism.c"),
    "log missing": lambda folder: (folder / "compile.log").unlink(),
    "entry cut short": lambda folder: cut(folder / "entry.json"),
    "entry empty": lambda folder: (folder / "entry.json").write_bytes(b""),
    "entry missing": lambda folder: (folder / "entry.json").unlink(),
    "entry of another shape": lambda folder: (folder / "entry.json").write_text(
        '{"version": 2, "scene": "", "files": [1]}'
    ),
    "entry without a manifest": lambda folder: rewrite(folder, "manifest.json"),
    "entry without a library": lambda folder: rewrite(folder, "libprism.so"),
    "entry of another version": lambda folder: (folder / "entry.json").write_text(
        '{"version": 0, "files": {}}'
    ),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_is_absent_then_removed_then_made_again(cache, damage):
    folder = cache.store(KEY, FILES).folder
    damage(folder)
    assert cache.find(KEY) is None
    assert not folder.exists()
    cache.store(KEY, FILES)
    assert cache.find(KEY).library.read_bytes() == FILES["libprism.so"]


def test_store_replaces_a_damaged_entry_but_not_its_open_file(cache):
    library = cache.store(KEY, FILES).library
    with library.open("rb") as loaded:
        cut(cache.find(KEY).manifest)
        cache.store(KEY, FILES | {"libprism.so": b"another"})
        assert loaded.read() == FILES["libprism.so"]
    assert cache.find(KEY).library.read_bytes() == b"another"


def test_a_file_in_the_place_of_an_entry_is_replaced(cache):
    (cache.root / "libraries").mkdir(parents=True, mode=0o700)
    (cache.root / "libraries" / KEY).write_text("no folder")
    assert cache.find(KEY) is None
    assert cache.store(KEY, FILES).library.exists()


def test_two_processes_make_one_library_once(tmp_path):
    counter = multiprocessing.get_context("spawn").Value("i", 0)
    run_together(make_and_count, 2, str(tmp_path), KEY, counter)
    assert counter.value == 1
    assert Cache(tmp_path).find(KEY) is not None


@pytest.mark.thorough
def test_processes_that_store_the_same_key_do_not_disturb_each_other(tmp_path):
    run_together(store_many, 2, str(tmp_path), KEY)
    assert [path.name for path in (tmp_path / "libraries").iterdir()] == [KEY]
    assert list((tmp_path / "temporary").iterdir()) == []


def test_a_lock_may_be_nested_and_is_free_again_after_an_error(cache):
    with cache.lock(KEY), pytest.raises(ValueError, match="file name"), Cache(cache.root).lock(KEY):
        cache.store(KEY, {"../x": b""})
    with cache.lock(KEY, timeout=0.0):
        pass


def test_a_lock_that_stays_taken_is_an_error(cache):
    context = multiprocessing.get_context("spawn")
    held, done = context.Event(), context.Event()
    holder = context.Process(target=hold, args=(str(cache.root), KEY, held, done))
    holder.start()
    try:
        assert held.wait(100)
        with pytest.raises(OutputError) as caught, cache.lock(KEY, timeout=0.1):
            pass
    finally:
        done.set()
        holder.join(100)
    assert caught.value.given == "another process holds the lock"
    with cache.lock(KEY, timeout=10.0):
        pass


def hold(root, key, held, done):
    with Cache(Path(root)).lock(key):
        held.set()
        done.wait(100)


def test_an_unusable_folder_is_an_error_that_names_the_variable(tmp_path):
    (tmp_path / "file").write_text("no folder")
    cache = Cache(tmp_path / "file")
    assert cache.find(KEY) is None
    assert cache.lookup_request(KEY) is None
    for attempt in (
        lambda: cache.store(KEY, FILES),
        lambda: cache.store_request(KEY, OTHER),
        lambda: cache.lock(KEY).__enter__(),
    ):
        with pytest.raises(OutputError) as caught:
            attempt()
        assert CACHE_VARIABLE in caught.value.hint
        assert str(tmp_path / "file") in caught.value.where


@POSIX
def test_a_file_that_cannot_be_written_whole_leaves_no_entry(cache):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
    try:
        with pytest.raises(OutputError) as caught:
            cache.store(KEY, FILES)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert os.strerror(errno.EFBIG) in caught.value.given
    assert list((cache.root / "temporary").iterdir()) == []
    assert cache.find(KEY) is None
    assert cache.store(KEY, FILES).library.exists()


def test_an_entry_is_found_where_nothing_can_be_written(cache, monkeypatch):
    cache.store(KEY, FILES)

    def refuse(*arguments, **options):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(cache_module.os, "utime", refuse)
    assert cache.find(KEY).library.exists()


@pytest.mark.parametrize("key", ["", "abc", "../" + "a" * 61, "A" * 64, "a" * 64 + "\n", "g" * 64])
def test_a_key_that_is_no_digest_is_refused(cache, key):
    for attempt in (cache.find, cache.lookup_request, lambda key: cache.store(key, FILES)):
        with pytest.raises(ValueError, match="hexadecimal"):
            attempt(key)


@pytest.mark.parametrize("name", ["", "entry.json", "../x", "a/b", "..", ".hidden", "a\n"])
def test_a_file_name_that_leads_elsewhere_is_refused(cache, name):
    with pytest.raises(ValueError, match="file name"):
        cache.store(KEY, {name: b""})
    assert cache.find(KEY) is None


def test_the_least_recently_used_entries_go_first(tmp_path):
    size = sum(map(len, FILES.values()))
    cache = Cache(tmp_path, limit=3 * size)
    for key, seconds in ((KEY, 300), (OTHER, 200)):
        age(cache.store(key, FILES).folder, seconds)
        cache.store_request(key, key)
    cache.find(KEY)  # used just now, so that OTHER is the older one
    cache.store(THIRD, FILES)
    assert cache.find(OTHER) is None
    assert cache.lookup_request(OTHER) is None
    assert cache.find(KEY) is not None
    assert cache.lookup_request(KEY) == KEY
    assert cache.find(THIRD) is not None
    assert cache.size() <= cache.limit


def test_an_entry_above_the_limit_is_still_handed_over(tmp_path):
    cache = Cache(tmp_path, limit=1)
    assert cache.store(KEY, FILES).library.exists()
    assert cache.store(OTHER, FILES).library.exists()
    assert cache.find(KEY) is None


def test_nothing_is_stored_that_the_check_refuses(cache):
    seen = []

    def refuse(folder):
        seen.extend(path.name for path in folder.iterdir())
        raise CompileError("no library")

    with pytest.raises(CompileError):
        cache.store(KEY, FILES, check=refuse)
    assert set(FILES) < set(seen)
    assert cache.find(KEY) is None
    assert list((cache.root / "temporary").iterdir()) == []


def test_an_entry_can_be_dropped(cache):
    cache.store(KEY, FILES)
    cache.drop(KEY)
    cache.drop(OTHER)
    assert cache.find(KEY) is None


def test_clear_removes_all_and_says_how_much(cache):
    cache.store(KEY, FILES)
    cache.store_request(OTHER, KEY)
    size = cache.size()
    assert size > sum(map(len, FILES.values()))
    assert cache.clear() == size
    assert cache.size() == 0
    assert cache.find(KEY) is None
    assert cache.lookup_request(OTHER) is None
