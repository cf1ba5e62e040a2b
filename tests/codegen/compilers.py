"""Compilers for tests: the real ones that are here, and scripts that stand in for bad ones."""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.flags import Compiler
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.system.errors import CompilerMissingError
from tests.cases import thorough

FAMILIES = ("gcc", "clang", "zig")
# Where one compiler shows what the test says and the others show it again.
FIRST_FAMILY, *OTHERS = FAMILIES
EACH_FAMILY = (FIRST_FAMILY, *thorough(*OTHERS))
POSIX = pytest.mark.skipif(os.name != "posix", reason="needs POSIX processes and shell scripts")

SOURCES = {
    "twice.c": '#include "twice.h"\nint twice(double x, double *y) { *y = FACTOR * x; return 0; }\n',
    "twice.h": "#define FACTOR 2.0\nint twice(double x, double *y);\n",
}


def require_compiler(family: str) -> Compiler:
    try:
        return find_compiler(family)
    except CompilerMissingError:
        pytest.skip(f"{family} is not installed")


def chosen_compiler() -> str:
    """Return what tells make to use the compiler that the project itself would use here."""
    return f"CC={' '.join(find_compiler().command)}"


def write_script(path: Path, body: str) -> Path:
    """Write a shell script that can be run as a program."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


def script_compiler(path: Path, body: str) -> Compiler:
    return Compiler("fake", (str(write_script(path, body)),), "1.0")


def hanging_body(pid_file: Path) -> str:
    """Return a script that starts a child, notes both process ids and then hangs."""
    return f"sleep 100 &\necho $$ $! > '{pid_file}.part'\nmv '{pid_file}.part' '{pid_file}'\nwait"


def read_pids(pid_file: Path) -> list[int]:
    """Return the process ids that a hanging script wrote, once it has started."""
    wait_until(pid_file.exists, "the script started")
    return [int(word) for word in pid_file.read_text(encoding="utf-8").split()]


def is_running(pid: int) -> bool:
    """Whether that process runs; one that has ended and was not yet waited for does not."""
    if sys.platform == "linux":
        try:
            return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0] != "Z"
        except OSError:
            return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def wait_until(condition: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.01)
