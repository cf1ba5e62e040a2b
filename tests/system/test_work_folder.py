import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tensegrity_codegen.system.temporary_files import sweep_folders, work_folder
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


def test_folders_without_a_lock_go_after_a_day_and_others_are_not_touched(tmp_path: Path) -> None:
    for name, hours in (("tensegrity_codegen-old", 25), ("tensegrity_codegen-new", 1), ("other", 99)):
        (tmp_path / name).mkdir()
        then = time.time() - 3600 * hours
        os.utime(tmp_path / name, (then, then))
    (tmp_path / "tensegrity_codegen-file").touch()
    sweep_folders(tmp_path)
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"tensegrity_codegen-new", "tensegrity_codegen-file", "other"}


@POSIX
def test_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").touch()
    (tmp_path / "tensegrity_codegen-x").symlink_to("precious")
    (tmp_path / "tensegrity_codegen-x.lock").touch()
    sweep_folders(tmp_path)
    assert (tmp_path / "precious" / "file").exists()


def test_a_place_that_cannot_be_written_is_a_system_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="none"), work_folder(tmp_path / "none"):
        pass
