import os
import subprocess
import sys
from pathlib import Path

import pytest

from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.system.files import check_output, replaced

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs POSIX files")


def write(path: Path, text: str, **options: bool) -> None:
    with replaced(path, **options) as temporary:
        temporary.write_text(text, encoding="utf-8")


def test_a_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with replaced(path, overwrite=True) as temporary:
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
        with replaced(path, overwrite=True) as temporary:
            temporary.write_text("new", encoding="utf-8")
            raise error("stop")

    with pytest.raises(error):
        stop()
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_system_error_names_the_file_and_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with pytest.raises(OutputError, match="No space left") as caught, replaced(path, overwrite=True):
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
    write(link, "new", overwrite=False)
    assert link.is_symlink()
    assert real.read_text(encoding="utf-8") == "new"


@POSIX
def test_devices_and_pipes_are_never_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, Path(os.devnull)):
        with pytest.raises(OutputError, match="device or a pipe"):
            check_output(path)
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
            check_output(path, overwrite=overwrite)
        assert caught.value.where == path
        with pytest.raises(OutputError):
            write(Path(path), "new", overwrite=overwrite)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="may not be written to"):
        check_output(tmp_path / "a.txt")
    tmp_path.chmod(0o700)


def test_a_free_place_is_good(tmp_path: Path) -> None:
    assert check_output(tmp_path / "a.txt") == Path(os.path.realpath(tmp_path)) / "a.txt"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["precious", "", "written by tensegrity_codegen", "case,status,x\n0,ok,1\n"])
def test_no_file_that_exists_is_replaced_unless_that_is_asked_for(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    assert check_output(path) == path
    path.write_text(text, encoding="utf-8")
    with pytest.raises(OutputError, match="exists already") as caught:
        check_output(path)
    assert "overwrite=True" in caught.value.hint
    check_output(path, overwrite=True)


@POSIX
@pytest.mark.parametrize("name", ["a.toml", "folder/../a.toml", "link", "hard"])
def test_an_input_is_never_an_output_under_any_name(name: str, tmp_path: Path) -> None:
    source = tmp_path / "a.toml"
    source.write_text("name", encoding="utf-8")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("a.toml")
    (tmp_path / "hard").hardlink_to(source)
    with pytest.raises(OutputError, match="would replace an input"):
        check_output(tmp_path / name, inputs=[source], overwrite=True)
    check_output(tmp_path / "other", inputs=[source, tmp_path / "missing"])


KILLED = """
import os, signal, sys
from tensegrity_codegen.system.files import replaced
with replaced(sys.argv[1], overwrite=True) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@POSIX
def test_what_a_killed_process_left_goes_with_the_next_writing(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    subprocess.run([sys.executable, "-c", KILLED, str(path)], env=environment, timeout=60)
    assert len(list(tmp_path.iterdir())) == 1
    with (
        replaced(path, overwrite=True) as first,
        replaced(path, overwrite=True) as second,
    ):  # those in use stay
        first.write_text("old", encoding="utf-8")
        second.write_text("new", encoding="utf-8")
    assert list(tmp_path.iterdir()) == [path]
