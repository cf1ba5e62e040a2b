from __future__ import annotations

import os
from pathlib import Path

import pytest

from tensegrity_codegen.errors import OutputError
from tensegrity_codegen.files import check_target, replaced, write_folder

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs POSIX files")


def write(path: Path, text: str, **options: bool) -> None:
    with replaced(path, **options) as temporary:
        temporary.write_text(text, encoding="utf-8")


def test_a_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with replaced(path) as temporary:
        temporary.write_text("half", encoding="utf-8")
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".txt"
        assert not path.exists()
    assert path.read_text(encoding="utf-8") == "half"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OutputError])
def test_an_error_leaves_the_old_file_and_nothing_else(error: type[BaseException], tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old", encoding="utf-8")

    def stop() -> None:
        with replaced(path) as temporary:
            temporary.write_text("new", encoding="utf-8")
            raise error("stop")

    with pytest.raises(error):
        stop()
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_system_error_names_the_file_and_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with pytest.raises(OutputError, match="No space left") as caught, replaced(path):
        raise OSError(28, "No space left on device")
    assert caught.value.where == str(path)
    assert caught.value.allowed
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_kept_without_overwrite(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write(path, "old", overwrite=False)
    with pytest.raises(OutputError, match="exists already"):
        write(path, "new", overwrite=False)
    assert path.read_text(encoding="utf-8") == "old"


@POSIX
def test_a_link_stays_a_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    link.symlink_to("real.txt")
    write(link, "new")
    assert link.is_symlink()
    assert real.read_text(encoding="utf-8") == "new"


@POSIX
def test_devices_and_pipes_are_never_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, Path(os.devnull)):
        with pytest.raises(OutputError, match="device or a pipe"):
            check_target(path)
    assert pipe.is_fifo()


@pytest.mark.parametrize(
    "path", ["", ".", "..", "folder", "missing/a.txt", "file/a.txt", "x" * 300, "loop/a.txt"]
)
def test_a_place_that_is_none_is_refused_before_anything_is_written(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("file").write_text("", encoding="utf-8")
    Path("loop").symlink_to("loop")
    before = sorted(tmp_path.rglob("*"))
    for overwrite in (True, False):
        with pytest.raises(OutputError) as caught:
            check_target(path, overwrite=overwrite)
        assert caught.value.where == path
        with pytest.raises(OutputError):
            write(Path(path), "new", overwrite=overwrite)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="may not be written to"):
        check_target(tmp_path / "a.txt")
    tmp_path.chmod(0o700)


def test_a_free_place_is_good(tmp_path: Path) -> None:
    assert check_target(tmp_path / "a.txt") == Path(os.path.realpath(tmp_path)) / "a.txt"
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    target = write_folder(tmp_path / "a" / "b", {"one.txt": b"1", "two.bin": b"\0"})
    assert {path.name: path.read_bytes() for path in target.iterdir()} == {"one.txt": b"1", "two.bin": b"\0"}
    write_folder(target, {"one.txt": b"new"})
    assert (target / "one.txt").read_bytes() == b"new"
    assert (target / "two.bin").exists()


@pytest.mark.parametrize("place", ["file", "file/folder"])
def test_a_file_in_the_way_of_a_folder_is_refused(place: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious", encoding="utf-8")
    with pytest.raises(OutputError, match="folder cannot be made") as caught:
        write_folder(tmp_path / place, {"a": b""})
    assert caught.value.where == str(tmp_path / place)
    assert (tmp_path / "file").read_text(encoding="utf-8") == "precious"
