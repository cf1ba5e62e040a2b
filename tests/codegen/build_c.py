"""Compiling and running generated C by hand, as an embedder does."""

import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.compile import compiler_environment
from tensegrity_codegen.codegen.compilation.flags import Compiler
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler, find_compilers
from tests.codegen.compilers import require_compiler
from tests.codegen.quickly import SANITIZE

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


def run_program(folder: Path, *words: str, family: str = "gcc") -> str:
    """Compile a program of these sources and options, run it, and return what it prints."""
    compiler = require_compiler(family)
    run([*compiler.command, *words, "-lm", "-o", "program"], folder, compiler)
    return run([str(folder / "program")], folder).stdout


def check_object(folder: Path, unit: str, *options: str) -> tuple[set[str], set[str]]:
    """Compile a file, which has no writable data; return the symbols that it needs and that it exports."""
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    compiler = find_compiler()
    run([*compiler.command, *options, "-c", unit, "-o", "checked.o"], folder, compiler)
    rows = [line.split()[-2:] for line in run(["nm", "checked.o"], folder).stdout.splitlines()]
    assert [symbol for kind, symbol in rows if kind in "dDbBcC"] == []
    own = {"memset", "memcpy", "memmove", "_GLOBAL_OFFSET_TABLE_"}
    needed = {symbol for kind, symbol in rows if kind == "U"} - own
    return needed, {symbol for kind, symbol in rows if kind in "TR"}


def check_sanitized(folder: Path, *units: str) -> None:
    """Run a program that prints "done" with the sanitizers, which find nothing to say."""
    able = (c for c in find_compilers() if c.name != "zig" and has_sanitizers(c, folder))
    compiler = next(able, None)
    if compiler is None:
        pytest.skip("no compiler here builds programs with the address sanitizer")
    run([*compiler.command, "-std=c99", *SANITIZE, *units, "-o", "driver", "-lm"], folder, compiler)
    done = run([str(folder / "driver")], folder, UBSAN_OPTIONS="print_stacktrace=1")
    assert (done.stdout, done.stderr) == ("done\n", "")


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
