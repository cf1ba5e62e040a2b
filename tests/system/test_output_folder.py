import errno
import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.system.output_folder import LIST_FILE, check_folder, write_folder
from tests.codegen.compilers import POSIX

OLD = {"a.c": b"old a", "b.h": b"old b"}
NEW = {"a.c": b"new a", "b.h": b"new b", "c.so": b"new c" * 4000}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != LIST_FILE}


def test_a_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    target = write_folder(tmp_path / "a" / "b", {"one.txt": b"1", "two.bin": b"\0"})
    assert contents(target) == {"one.txt": b"1", "two.bin": b"\0"}
    write_folder(target, {"one.txt": b"new"}, overwrite=True)
    assert contents(target) == {"one.txt": b"new", "two.bin": b"\0"}
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"]


@pytest.mark.parametrize("place", ["file", "file/folder"])
def test_a_file_in_the_way_of_a_folder_is_refused(place: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious", encoding="utf-8")
    with pytest.raises(OutputError, match="folder cannot be made") as caught:
        write_folder(tmp_path / place, {"a": b""})
    assert caught.value.where == str(tmp_path / place)
    assert (tmp_path / "file").read_text(encoding="utf-8") == "precious"


def test_what_was_written_before_is_replaced_and_the_rest_stays(tmp_path: Path) -> None:
    write_folder(tmp_path, OLD, listed=True, overwrite=False)
    (tmp_path / "main.c").write_text("precious", encoding="utf-8")
    write_folder(tmp_path, NEW, listed=True, overwrite=False)
    assert contents(tmp_path) == NEW | {"main.c": b"precious"}
    lines = (tmp_path / LIST_FILE).read_text(encoding="utf-8").splitlines()
    assert [line.split("  ")[1] for line in lines] == sorted(NEW)


@pytest.mark.skipif(sys.platform != "linux", reason="needs sha256sum")
def test_the_list_is_one_that_sha256sum_reads(tmp_path: Path) -> None:
    write_folder(tmp_path, NEW, listed=True)
    subprocess.run(["sha256sum", "-c", "--strict", LIST_FILE], cwd=tmp_path, check=True, timeout=20)


@pytest.mark.parametrize("name", ["b.h", LIST_FILE])
def test_a_file_of_somebody_else_is_refused_before_anything_is_written(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("precious", encoding="utf-8")
    with pytest.raises(OutputError, match="of these names already") as caught:
        write_folder(tmp_path, NEW, listed=True, overwrite=False)
    assert caught.value.given == name
    assert "overwrite=True" in caught.value.hint
    assert {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == {name: "precious"}
    write_folder(tmp_path, NEW, listed=True, overwrite=True)
    assert contents(tmp_path) == NEW


def test_a_file_that_was_changed_since_is_the_users(tmp_path: Path) -> None:
    write_folder(tmp_path, OLD, listed=True)
    (tmp_path / "a.c").write_text("edited", encoding="utf-8")
    with pytest.raises(OutputError) as caught:
        check_folder(tmp_path, NEW, listed=True)
    assert caught.value.given == "a.c"
    assert check_folder(tmp_path, ["b.h", "c.so"], listed=True) == tmp_path


def test_only_folders_of_builds_replace_what_a_list_names(tmp_path: Path) -> None:
    write_folder(tmp_path, OLD, listed=True)
    with pytest.raises(OutputError, match="already") as caught:
        write_folder(tmp_path, OLD)
    assert caught.value.given == "a.c, b.h"


def test_a_list_of_the_users_keeps_its_entries(tmp_path: Path) -> None:
    (tmp_path / "data.bin").write_bytes(b"mine")
    line = f"{hashlib.sha256(b'mine').hexdigest()}  data.bin"
    (tmp_path / LIST_FILE).write_text(f"{line}\n{'0' * 64}  gone.bin\n", encoding="utf-8")
    write_folder(tmp_path, OLD, listed=True)
    lines = (tmp_path / LIST_FILE).read_text(encoding="utf-8").splitlines()
    assert line in lines
    assert [item.split("  ")[1] for item in lines] == ["a.c", "b.h", "data.bin"]


@POSIX
def test_inputs_and_links_are_not_replaced(tmp_path: Path) -> None:
    scene = tmp_path / "a.c"
    scene.write_text("name", encoding="utf-8")
    with pytest.raises(OutputError, match="would replace an input"):
        write_folder(tmp_path, NEW, inputs=[scene], overwrite=True)
    (tmp_path / "b.h").symlink_to("a.c")
    with pytest.raises(OutputError, match="of these names already"):
        check_folder(tmp_path, ["b.h"])


@pytest.fixture
def small_files() -> Iterator[None]:
    """Let no file grow over 8 KiB, as on a full disk."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@POSIX
@pytest.mark.usefixtures("small_files")
def test_a_full_disk_leaves_the_folder_as_it_was(tmp_path: Path) -> None:
    write_folder(tmp_path / "there", OLD, listed=True)
    before = {path.name: path.read_bytes() for path in (tmp_path / "there").iterdir()}
    for folder in ("there", "new", "a/b/c"):
        with pytest.raises(OutputError, match=os.strerror(errno.EFBIG)):
            write_folder(tmp_path / folder, NEW, listed=True)
    assert {path.name: path.read_bytes() for path in (tmp_path / "there").iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


@POSIX
@pytest.mark.parametrize("failing", range(1, 5))
def test_an_interruption_between_two_files_is_undone(
    failing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_folder(tmp_path, OLD, listed=True)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    real, calls = Path.replace, [0]

    def interrupt(path: Path, target: Path) -> Path:
        calls[0] += 1
        if calls[0] == failing:
            raise KeyboardInterrupt
        return real(path, target)

    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_folder(tmp_path, NEW, listed=True)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


KILLED = """
import os, signal, sys
from pathlib import Path
from tensegrity_codegen.system.output_folder import write_folder
calls, folder, last = [0], Path(sys.argv[1]), int(sys.argv[2])
def count(real):
    def call(*words, **more):
        calls[0] += 1
        if calls[0] == last:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*words, **more)
    return call
for name in ("replace", "rename", "write_bytes", "mkdir"):
    setattr(Path, name, count(getattr(Path, name)))
write_folder(folder, {"a.c": b"new a", "b.h": b"new b"}, listed=True, overwrite=False)
"""


@pytest.mark.thorough
@POSIX
@pytest.mark.parametrize("exists", [False, True])
def test_killed_anywhere_each_file_is_whole_and_the_next_call_heals(exists: bool, tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    killed = 0
    for step in range(1, 12):
        folder = tmp_path / f"{step}" / "made"
        if exists:
            write_folder(folder, OLD, listed=True)
        ended = subprocess.run([sys.executable, "-c", KILLED, str(folder), str(step)], env=environment)
        killed += ended.returncode != 0
        whole = {b"old a", b"new a", b"old b", b"new b"}
        left = list(folder.glob("*.[ch]")) if folder.exists() else []
        assert len(left) == 2 or not folder.exists() or not exists
        assert all(path.read_bytes() in whole for path in left)
        write_folder(folder, {"a.c": b"new a", "b.h": b"new b"}, listed=True, overwrite=False)
        assert {path.name for path in folder.iterdir()} == {"a.c", "b.h", LIST_FILE}
        assert contents(folder) == {"a.c": b"new a", "b.h": b"new b"}
        if ended.returncode == 0:
            break
    assert killed >= 4
