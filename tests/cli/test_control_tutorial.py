"""The tutorial docs/control_tutorial.md: every command, the program in C, the lines of Python."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.cli.conftest import Run

pytestmark = pytest.mark.thorough

PAGE = Path(__file__).resolve().parents[2] / "docs" / "control_tutorial.md"


def read_commands(text: str) -> list[str]:
    """Return the lines of the page's blocks of commands, in order."""
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return [line for block in blocks for line in block.splitlines()]


@pytest.mark.timeout(1800)  # 12 commands one after the other
def test_every_command_runs(run: Run, folder: Path) -> None:
    text = PAGE.read_text(encoding="utf-8")
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or shutil.which("make") is None:
        pytest.skip("no cc and make are installed; on Debian: apt install build-essential")
    (program,) = re.findall(r"```c\n(.*?)```", text, re.DOTALL)
    (folder / "loop.c").write_text(program, encoding="utf-8")
    commands = read_commands(text)
    assert len(commands) == 12
    for command in commands:
        words = shlex.split(command)
        if words[0] == "tensegrity-codegen":
            ended = run(*words[1:])
            assert ended.code == 0, (command, ended.err)
        else:
            words[0] = compiler if words[0] == "cc" else words[0]
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
            assert done.returncode == 0, (command, done.stdout, done.stderr)
    errors = [float(found) for found in re.findall(r"error ([\d.]+) deg", done.stdout)]
    assert errors[0] == pytest.approx(1.1459, abs=1e-3)
    assert errors[-1] < 1e-2
    assert (folder / "first.html").exists()


def test_the_python_runs(run: Run, folder: Path) -> None:
    run("examples", "pinned_prism")
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, PAGE.name, "exec"), names)
    assert names["study"].status == "holds"  # type: ignore[attr-defined]
    assert (folder / "ctl_python" / "pinned_prism_control.c").exists()
