"""The fixtures that all tests share."""

import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT

LEAK = '''
import gc

gc.disable()  # so that nothing but the fixture of the module collects


class Cycle:
    """Only a collection of garbage finds it."""


def test_closes(tmp_path):
    (tmp_path / "a").write_text("")


def test_leaks(tmp_path):
    cycle = Cycle()
    cycle.itself, cycle.file = cycle, (tmp_path / "b").open("w")


def test_after():
    pass
'''


def test_a_module_that_leaves_a_file_open_fails_by_the_name_of_its_test(tmp_path: Path) -> None:
    module = tmp_path / "test_leak.py"
    module.write_text(LEAK, encoding="utf-8")
    options = ("-p", "tests.conftest", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "-q")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(module)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "3 passed, 1 error" in done.stdout
    assert "test_leak.py: unclosed file" in done.stdout
    assert "left open by: test_leaks\n" in done.stdout
