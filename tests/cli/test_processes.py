"""The command line as processes: Ctrl-C, readers that go away, machines with other compilers or none."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tests.cases import thorough
from tests.codegen.compilers import POSIX, require_compiler, wait_until

pytestmark = POSIX
COMMAND = [sys.executable, "-m", "tensegrity_codegen"]
# Python without the package ziglang; the script runs the command line.
WITHOUT_ZIG = """
import importlib.util, sys
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *more: None if name == "ziglang" else find(name, *more)
from tensegrity_codegen.cli.app import main
main()
"""


def environment(**changed: str) -> dict[str, str]:
    kept = {key: value for key, value in os.environ.items() if key != "CC"}
    return kept | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)} | changed


def call(*words: object, program: list[str] = COMMAND, **changed: str) -> subprocess.CompletedProcess[str]:
    command = [*program, *(str(word) for word in words)]
    return subprocess.run(command, capture_output=True, text=True, env=environment(**changed), timeout=120)


def loads_library(pid: int) -> bool:
    """Whether a child of that process has loaded the library of the two nodes."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
        return any("libtwo_nodes" in Path(f"/proc/{child}/maps").read_text() for child in children)
    except OSError:
        return False


def test_ctrl_c_in_a_long_run_leaves_no_file_and_ends_with_130(folder: Path, two_nodes: Path) -> None:
    words = ["simulate", two_nodes.name, "--t-end", "1000", "--method", "rk4", "--step", "1e-5"]
    assert call("simulate", two_nodes.name, "--t-end", "0.001").returncode == 0  # the library is in the cache
    process = subprocess.Popen(
        [*COMMAND, *words, "--out", "a.npz", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
    )
    try:
        if sys.platform == "linux":
            wait_until(lambda: loads_library(process.pid), "the library is loaded", 60.0)
        else:
            time.sleep(2.5)  # the start takes under a second
        assert process.poll() is None  # the run would take minutes
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in err
    assert list(folder.iterdir()) == [two_nodes]


@pytest.mark.parametrize(
    "words", [["schema"], ["check", "two_nodes.toml", "--json"], *thorough((["build", "two_nodes.toml"],))]
)
def test_a_reader_that_goes_away_is_no_error(words: list[str], folder: Path, two_nodes: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()
    )
    assert process.stdout is not None
    process.stdout.close()
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0
    said = [line for line in err.splitlines() if " after " not in line]  # lines of progress may stand
    assert all(line.startswith("took ") for line in said)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("more", [["--json"], *thorough(([],))])
def test_a_full_disk_under_stdout_is_an_error(more: list[str], two_nodes: Path) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        ended = subprocess.run(
            [*COMMAND, "check", str(two_nodes), *more],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=environment(),
            timeout=60,
        )
    assert ended.returncode == 2
    assert "No space left" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.thorough
def test_a_closed_stdout_is_no_error(two_nodes: Path) -> None:
    line = " ".join(shlex.quote(word) for word in [*COMMAND, "check", str(two_nodes)])
    ended = subprocess.run(["sh", "-c", f"{line} >&-"], capture_output=True, text=True, env=environment())
    assert ended.returncode == 0
    assert ended.stderr.startswith("took ")


def test_an_ascii_terminal_gets_tables_too(two_nodes: Path) -> None:
    ended = call("check", two_nodes, PYTHONIOENCODING="ascii", LC_ALL="C")
    assert ended.returncode == 0
    assert ended.stdout.isascii()


@pytest.mark.parametrize(
    "verb", [["build"], *thorough((["simulate", "--t-end", "1"],), (["equilibrium"],), (["linearize"],))]
)
def test_no_compiler_at_all_is_refused_with_what_to_install(
    verb: list[str], folder: Path, two_nodes: Path
) -> None:
    program = [sys.executable, "-c", WITHOUT_ZIG]
    words = [verb[0], two_nodes.name, *verb[1:], "--out", "result", "--json"]
    ended = call(*words, program=program, PATH=str(folder / "empty"))
    assert ended.returncode == 2
    data = json.loads(ended.stdout)
    assert data["error"] == "CompilerMissingError"
    assert ".[cc]" in data["hint"]
    assert "Traceback" not in ended.stderr
    assert not Path("result").exists()


def test_doctor_without_a_compiler_lists_the_problem(folder: Path) -> None:
    ended = call("doctor", "--json", program=[sys.executable, "-c", WITHOUT_ZIG], PATH=str(folder / "empty"))
    assert ended.returncode == 2
    data = json.loads(ended.stdout)
    assert data["status"] == "error"
    assert data["compilers"] == []
    assert ["compiler" in problem for problem in data["problems"]] == [True]


@pytest.mark.thorough
def test_zig_alone_builds_and_runs(folder: Path, two_nodes: Path) -> None:
    require_compiler("zig")
    changed = {"PATH": str(folder / "empty"), CACHE_VARIABLE: str(folder / "cache")}
    built = call("build", two_nodes.name, "--out", "library", "--json", **changed)
    assert built.returncode == 0, built.stderr
    assert Path(json.loads(built.stdout)["library"]).is_file()
    ran = call("simulate", two_nodes.name, "--t-end", 0.2, "--out", "a.npz", "--json", **changed)
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["status"] == "ok"


@pytest.mark.thorough
def test_a_file_name_that_is_no_text_is_no_trouble(folder: Path) -> None:
    path = os.fsdecode(b"\xff\xfe.toml")
    ended = call("examples", "prism", "--out", path)
    assert ended.returncode == 0
    assert call("check", path).returncode == 0
    ended = call("check", os.fsdecode(b"none\xff.toml"), "--json")
    assert ended.returncode == 2
    assert json.loads(ended.stdout)["status"] == "error"
