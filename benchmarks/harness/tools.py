"""What peers need to make a candidate: compilers, a folder for what is compiled, the timing loops."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness.candidate import Candidate
from harness.compiled import Compilation
from harness.runner import Runner
from tensegrity_codegen.codegen.compilation.flags import Compiler
from tensegrity_codegen.codegen.compilation.toolchain import find_compilers

Way = tuple[str, Callable[[], Candidate]]  # title, and what makes the candidate or raises Unavailable

WANTED = ("gcc", "clang")


@dataclass(frozen=True)
class Tools:
    """compilers: gcc first where it is there; compilation: the folder of libraries; runner: timing loops."""

    compilers: tuple[Compiler, ...]
    compilation: Compilation
    runner: Runner


def find_tools(folder: Path, time_limit: float) -> Tools:
    """Return the tools of this machine; libraries go to `folder`, no compiler runs above time_limit [s]."""
    found = find_compilers()
    named = [compiler for name in WANTED for compiler in found if compiler.name == name][: len(WANTED)]
    compilers = tuple(named) or found[:1]
    compilation = Compilation(folder, time_limit)
    return Tools(compilers, compilation, Runner(compilation, compilers[0]))
