import os
import subprocess
import sys
from pathlib import Path

import pytest

from tensegrity_codegen.system.temporary_files import PREFIX, name_owner, remove_abandoned, work_folder
from tests.codegen.compilers import POSIX

HOLDING = """
import sys, time
from pathlib import Path
from tensegrity_codegen.system.temporary_files import work_folder
with work_folder(Path(sys.argv[1])) as folder:
    (folder / "file").touch()
    print(folder, flush=True)
    time.sleep(60)
"""


def start_holder(parent: Path) -> tuple[subprocess.Popen[str], Path]:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDING, str(parent)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


def test_the_folder_is_private_and_gone_at_the_end(tmp_path: Path) -> None:
    with work_folder(tmp_path) as folder:
        assert folder.parent == tmp_path
        if os.name == "posix":
            assert folder.stat().st_mode & 0o777 == 0o700
    assert list(tmp_path.iterdir()) == []


@POSIX
def test_what_a_killed_process_left_is_removed_and_what_is_in_use_stays(tmp_path: Path) -> None:
    process, folder = start_holder(tmp_path)
    with process:
        with work_folder(tmp_path, sweep=True):
            assert (folder / "file").exists()
        process.kill()
    assert (folder / "file").exists()
    with work_folder(tmp_path, sweep=True):
        assert not folder.exists()
    assert list(tmp_path.iterdir()) == []


@POSIX
def test_what_another_machine_or_program_left_is_not_touched(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    machine, _, token = name_owner().split("-")
    names = {f"{PREFIX}000000-{ended.pid}-{token}", f"{PREFIX}{machine}-{token}", f"{PREFIX}old", "other"}
    for name in names:
        (tmp_path / name).mkdir()
    (tmp_path / f"{PREFIX}{machine}-{ended.pid}-{token}").mkdir()
    remove_abandoned(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == names


@POSIX
def test_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").touch()
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    machine, _, token = name_owner().split("-")
    link = tmp_path / f"{PREFIX}{machine}-{ended.pid}-{token}"
    link.symlink_to("precious")
    remove_abandoned(tmp_path)
    assert (tmp_path / "precious" / "file").exists()
    assert not link.is_symlink()


def test_a_place_that_cannot_be_written_is_a_system_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="none"), work_folder(tmp_path / "none"):
        pass
