"""A trial of a new library: a compiler that ends well may still have written something that does not load."""

import os
import shlex
import sys
from pathlib import Path

from tensegrity_codegen.codegen.compilation.child import run_limited
from tensegrity_codegen.codegen.compilation.flags import Compiler
from tensegrity_codegen.system.binaries import describe_binary
from tensegrity_codegen.system.errors import CompileError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import Target

SCRIPT = Path(__file__).with_name("load_once.py")
TIMEOUT = 60.0  # s


def check_library(library: Path, manifest: Manifest, compiler: Compiler, log: str = "") -> None:
    """Load a library in a process of its own, and compare it with its manifest.

    Raises CompileError if the library does not load, crashes, or is not what the manifest says.
    """
    symbols = [spec.symbol for spec in manifest.functions]
    words = [manifest.name, str(manifest.abi_version), manifest.scene_hash, *symbols]
    outcome = run_limited(
        [sys.executable, "-I", "-S", str(SCRIPT), str(library.absolute()), *words],
        folder=library.parent,
        environment=os.environ,
        timeout=TIMEOUT,
    )
    if not outcome.ok:
        reason = outcome.log.strip() or f"loading it ended with {outcome.ended} {outcome.number}"
        raise _refuse(reason, compiler, log)


def check_foreign_library(
    library: Path, manifest: Manifest, target: Target, compiler: Compiler, log: str = ""
) -> None:
    """Compare a library for another machine, which cannot be loaded here, with its manifest.

    Raises CompileError if it is for another machine than `target`, or lacks the scene's hash or the name of a
    function.
    """
    data = library.read_bytes()
    found = describe_binary(data)
    if found != target.binary:
        raise _refuse(f"it is {found or 'no library'}, and not {target.binary}", compiler, log)
    if manifest.scene_hash.encode("ascii") not in data:
        raise _refuse("it was made from another scene", compiler, log)
    missing = [spec.symbol for spec in manifest.functions if spec.symbol.encode("ascii") not in data]
    if missing:
        raise _refuse(f"it has no symbol {', '.join(missing[:5])}", compiler, log)


def _refuse(reason: str, compiler: Compiler, log: str) -> CompileError:
    return CompileError(
        f"the compiler reported success but wrote a library that cannot be used: {reason}",
        log=log,
        where=shlex.join(compiler.command),
        hint="check the compiler with `tensegrity-codegen doctor`, or choose another one with `compiler`",
    )
