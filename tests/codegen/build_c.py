"""Compiling and running generated C by hand, as an embedder does."""

import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.compile import compiler_environment
from tensegrity_codegen.codegen.compilation.flags import Compiler

STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")


def write_files(folder: Path, files: Mapping[str, str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return folder


def run(
    command: Sequence[str], folder: Path, compiler: Compiler | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder; its output is in the failure if it fails."""
    base = compiler_environment(compiler or Compiler("cc", ("cc",), ""), folder)
    done = subprocess.run(
        command, cwd=folder, env=base | environment, capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"
    return done


def require_cpp(family: str) -> tuple[str, ...]:
    """Return the command of a C++ compiler, or skip the test where it is not installed."""
    if family == "zig":
        pytest.importorskip("ziglang", reason="the package ziglang is not installed")
        return (sys.executable, "-m", "ziglang", "c++")
    program = shutil.which(family)
    if program is None:
        pytest.skip(f"{family} is not installed")
    return (program,)


def has_sanitizers(compiler: Compiler, folder: Path) -> bool:
    """Whether a program with the address and undefined-behaviour sanitizers can be built and run."""
    (folder / "empty.c").write_text("int main(void) { return 0; }\n", encoding="utf-8")
    command = [*compiler.command, "-fsanitize=address,undefined", "empty.c", "-o", "empty"]
    try:
        run(command, folder, compiler)
        run([str(folder / "empty")], folder)
    except (AssertionError, OSError, subprocess.SubprocessError):
        return False
    return True
