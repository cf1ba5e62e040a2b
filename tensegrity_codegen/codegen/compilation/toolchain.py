"""C compilers of this machine, whether they work, and trials of the libraries that they write.

A compiler that ends well may still have written a library that does not load.
"""

import functools
import importlib.util
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tensegrity_codegen.codegen.compilation.child import run_alone, run_limited
from tensegrity_codegen.codegen.compilation.compile import compile_library, compiler_environment
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS, Compiler
from tensegrity_codegen.system.binaries import describe_binary
from tensegrity_codegen.system.errors import CompileError, CompilerMissingError, name_list
from tensegrity_codegen.system.extras import name_install
from tensegrity_codegen.system.temporary_files import work_folder
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import Target

PROGRAMS = ("cc", "gcc", "clang")
VERSION_TIMEOUT = 10.0  # s, for one answer to --version
CHECK_TIMEOUT = 60.0  # s, for a tiny program; zig builds its C library first
INSTALL_HINT = f"install gcc or clang, or a compiler as a Python package: {name_install('cc')}"

CHECK_SOURCE = """\
#include <math.h>

double tensegrity_check(double square);
double tensegrity_check(double square) { return sqrt(square) + 0.5; }
"""
CHECK_PROGRAM = """\
import ctypes, sys
check = ctypes.CDLL(sys.argv[1]).tensegrity_check
check.restype, check.argtypes = ctypes.c_double, [ctypes.c_double]
sys.exit(0 if check(2.25) == 2.0 else 3)
"""


def find_compilers() -> tuple[Compiler, ...]:
    """Return the compilers that answer, each once, in the order $CC, cc, gcc, clang, zig (package)."""
    return tuple(_list_compilers())


def find_compiler(requested: str | None = None) -> Compiler:
    """Return the compiler to use: the first one found, or the one that is requested.

    requested: "gcc", "clang" or "zig", or a command such as "cc", "/usr/bin/gcc-12" or "ccache gcc".
    """
    if requested is None:
        return _choose_first()
    named = (compiler for compiler in _list_compilers() if compiler.name == requested)
    compiler = (next(named, None) or _probe(_split(requested))) if isinstance(requested, str) else None
    if compiler is None:
        raise CompilerMissingError(
            "the requested compiler was not found or does not work",
            where="compiler",
            given=requested,
            allowed=_list_names(),
            hint=INSTALL_HINT,
        )
    return compiler


def find_cross_compiler(target: Target, requested: str | None = None) -> Compiler:
    """Return the compiler for another machine, which is zig."""
    if requested is None:
        compiler = next((item for item in _list_compilers() if item.name == "zig"), None)
    else:
        compiler = find_compiler(requested)
    if compiler is None or compiler.name != "zig":
        raise CompilerMissingError(
            "libraries for other machines are compiled by zig"
            + (", which is not installed" if compiler is None else ""),
            where="compiler",
            given=f"target {target.name}" + ("" if compiler is None else f", compiler {requested}"),
            allowed="zig",
            hint=f"install zig as a Python package: {name_install('cc')}"
            if compiler is None
            else 'leave out `compiler`, or use `compiler="zig"`',
        )
    return compiler


def check_compiler(compiler: Compiler) -> str:
    """Compile, load and run a tiny library; return one line on the outcome and the time."""
    artifact = compile_library(
        {"check.c": CHECK_SOURCE},
        name="check",
        compiler=compiler,
        flags=FLAG_SETS["reference"],
        timeout=CHECK_TIMEOUT,
    )
    with work_folder() as folder:
        library = folder / artifact.file_name
        library.write_bytes(artifact.library)
        outcome = run_limited(
            [sys.executable, "-I", "-S", "-c", CHECK_PROGRAM, str(library)],
            folder=folder,
            environment=os.environ,
            timeout=CHECK_TIMEOUT,
        )
    if not outcome.ok:
        raise CompileError(
            f"the compiled library does not load or computes wrongly ({outcome.ended} {outcome.number})",
            log=artifact.log + outcome.log,
            where=" ".join(compiler.command),
            hint="choose another compiler",
        )
    return f"compiles, loads and computes; {artifact.seconds:.2f} s for a tiny library"


def _choose_first() -> Compiler:
    chosen = os.environ.get("CC", "").strip()
    if chosen and _probe(_split(chosen)) is None:
        raise CompilerMissingError(
            "the compiler that the environment variable CC names was not found or does not work",
            where="CC",
            given=chosen,
            allowed=_list_names(),
            hint="unset CC, or set it to a working C compiler",
        )
    compiler = next(_list_compilers(), None)
    if compiler is None:
        raise CompilerMissingError(
            "no C compiler was found",
            where="PATH",
            allowed="$CC, cc, gcc, clang or ziglang",
            hint=INSTALL_HINT,
        )
    return compiler


def _list_compilers() -> Iterator[Compiler]:
    """Give each compiler as soon as it is found, so that looking for the first one stays quick."""
    seen: set[tuple[str, ...]] = set()
    for command in _candidates():
        compiler = _probe(command)
        if compiler is None:
            continue
        program = (compiler.name, os.path.realpath(compiler.command[0]), *compiler.command[1:])
        if program not in seen:
            seen.add(program)
            yield compiler


def _candidates() -> Iterator[tuple[str, ...]]:
    chosen = os.environ.get("CC", "").strip()
    if chosen:
        yield _split(chosen)
    for program in PROGRAMS:
        yield (program,)
    if importlib.util.find_spec("ziglang") is not None:
        yield (sys.executable, "-m", "ziglang", "cc")


def _list_names() -> str:
    names = dict.fromkeys(compiler.name for compiler in _list_compilers())
    return ", ".join(names) or "none was found"


def _split(text: str) -> tuple[str, ...]:
    try:
        words = shlex.split(text, posix=os.name == "posix")
    except ValueError:  # an unclosed quote
        words = []
    return tuple(word.strip('"') for word in words)


def _probe(command: tuple[str, ...]) -> Compiler | None:
    """Return the compiler behind a command, None if there is none that answers."""
    program = shutil.which(command[0]) if command else None
    # Compilers run in folders of their own, where "./gcc" would be another file.
    return _ask_version((os.path.abspath(program), *command[1:])) if program else None  # noqa: PTH100 - links stay


@functools.cache
def _ask_version(command: tuple[str, ...]) -> Compiler | None:
    """Ask a command for its version, once a process."""
    driver = _find_zig(command)
    zig = driver is not None
    question = [*driver, "version"] if driver else [*command, "--version"]
    candidate = Compiler("zig" if zig else "", command, "")
    environment = compiler_environment(candidate, Path(tempfile.gettempdir()))
    root = Path(Path.cwd().anchor)  # a question writes nothing: it needs no folder of its own
    try:
        outcome = run_alone(question, root, environment, VERSION_TIMEOUT)  # a supervisor takes 12 ms
    except OSError:
        return None
    lines = outcome.log.strip().splitlines()
    if not outcome.ok or not lines:
        return None
    return Compiler("zig" if zig else _name_family(command[0], outcome.log), command, lines[0].strip())


def _find_zig(command: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return the part of a command that calls zig itself, if it is `zig cc` or `python -m ziglang cc`."""
    driver = command[:3] if command[1:3] == ("-m", "ziglang") else command[:1]
    is_zig = len(driver) == 3 or Path(command[0]).stem.lower() == "zig"
    return driver if is_zig and command[len(driver) :][:1] == ("cc",) else None


def _name_family(program: str, answer: str) -> str:
    if "clang" in answer.lower():
        return "clang"
    if "Free Software Foundation" in answer:
        return "gcc"
    return Path(program).stem


SCRIPT = Path(__file__).with_name("load_once.py")
TIMEOUT = 60.0  # s


def check_library(library: Path, manifest: Manifest, compiler: Compiler, log: str = "") -> None:
    """Load a library in a process of its own, and compare it with its manifest."""
    symbols = [spec.symbol for spec in manifest.functions]
    arguments = [manifest.name, str(manifest.abi_version), manifest.scene_hash, *symbols]
    outcome = run_limited(
        [sys.executable, "-I", "-S", str(SCRIPT), str(library.absolute()), *arguments],
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
    """Compare a library for another machine, which cannot be loaded here, with its manifest."""
    data = library.read_bytes()
    binary = describe_binary(data)
    if binary != target.binary:
        raise _refuse(f"it is {binary or 'no library'}, and not {target.binary}", compiler, log)
    if manifest.scene_hash.encode("ascii") not in data:
        raise _refuse("it was made from another scene", compiler, log)
    missing = [spec.symbol for spec in manifest.functions if spec.symbol.encode("ascii") not in data]
    if missing:
        raise _refuse(f"it has no symbol {name_list(missing)}", compiler, log)


def _refuse(reason: str, compiler: Compiler, log: str) -> CompileError:
    return CompileError(
        f"the compiler reported success but wrote a library that cannot be used: {reason}",
        log=log,
        where=shlex.join(compiler.command),
        hint="check the compiler with `tensegrity-codegen doctor`, or choose another one with `compiler`",
    )
