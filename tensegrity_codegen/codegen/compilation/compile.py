"""From C text to a shared library: compiler runs with limits that leave nothing behind.

A single source is compiled and linked by one command. Several are compiled side by side, one process a CPU,
and then linked: of a large scene, the tables take longer to compile than the code.

The size of machine code is read from the section headers of object files. Layouts: System V ABI chapter 4
(ELF), Apple's mach-o/loader.h (Mach-O, 64 bit), Microsoft's PE/COFF specification section 4, WebAssembly core
specification section 5.5.
"""

import os
import re
import struct
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from tensegrity_codegen.codegen.compilation.child import ChildOutcome, run_several
from tensegrity_codegen.codegen.compilation.flags import Compiler, FlagSet, build_command
from tensegrity_codegen.system.cache_root import make_cache_folder
from tensegrity_codegen.system.errors import (
    CompileError,
    InvalidNameError,
    InvalidValueError,
    describe_reason,
)
from tensegrity_codegen.system.temporary_files import work_folder
from tensegrity_codegen.tables.targets import Target, find_system, library_file_name

ELF_ALLOCATED, ELF_WRITABLE, ELF_NO_BITS = 2, 1, 8
MACHO_64 = 0xFEEDFACF
MACHO_SEGMENT_64 = 0x19
COFF_MACHINES = (0x8664, 0xAA64, 0x014C)
WASM_CODE, WASM_DATA = 10, 11
CODE_NAMES = (".text", ".rodata", ".rdata")


def read_code_size(data: bytes) -> int | None:
    """Return the bytes of code and constants in an object file, None if its format is not known.

    Counted are .text*, .rodata* and .rdata* sections, and those of the segment __TEXT; not counted are data,
    symbols, relocations, debug and unwind information.
    """
    try:
        if data[:4] == b"\x7fELF":
            return _read_elf(data)
        if data[:4] == b"\0asm":
            return _read_wasm(data)
        if len(data) >= 4 and struct.unpack_from("<I", data)[0] == MACHO_64:
            return _read_macho(data)
        if len(data) >= 2 and struct.unpack_from("<H", data)[0] in COFF_MACHINES:
            count = struct.unpack_from("<H", data, 2)[0]
            headers_start = 20 + struct.unpack_from("<H", data, 16)[0]
            headers = [headers_start + 40 * k for k in range(count)]
            code = [at for at in headers if _text(data, at, 8).startswith(CODE_NAMES)]
            size: int = sum(struct.unpack_from("<I", data, at + 16)[0] for at in code)
            return size
    except (struct.error, IndexError, ValueError, OverflowError):
        return None
    return None


def _read_elf(data: bytes) -> int:
    order = "<" if data[5] == 1 else ">"
    wide = data[4] == 2
    table = struct.unpack_from(order + ("Q" if wide else "I"), data, 0x28 if wide else 0x20)[0]
    entry_size, count, names_at = struct.unpack_from(order + "HHH", data, 0x3A if wide else 0x2E)
    layout = order + ("IIQQQQ" if wide else "IIIIII")  # name, type, flags, address, offset, size
    sections = [struct.unpack_from(layout, data, table + k * entry_size) for k in range(count)]
    names = sections[names_at][4]
    total = 0
    for name, kind, flags, _, _, size in sections:
        stored = flags & ELF_ALLOCATED and not flags & ELF_WRITABLE and kind != ELF_NO_BITS
        if stored and _text(data, names + name).startswith(CODE_NAMES):
            total += size
    return total


def _read_macho(data: bytes) -> int:
    commands = struct.unpack_from("<I", data, 16)[0]
    total, at = 0, 32
    for _ in range(commands):
        command, size = struct.unpack_from("<II", data, at)
        if command == MACHO_SEGMENT_64:
            for k in range(struct.unpack_from("<I", data, at + 64)[0]):
                section = at + 72 + 80 * k
                if _text(data, section + 16, 16) == "__TEXT" and _text(data, section, 16) != "__eh_frame":
                    total += struct.unpack_from("<Q", data, section + 40)[0]
        at += size
    return total


def _read_wasm(data: bytes) -> int:
    """Add up the sections of code and of data; constants are among the latter."""
    total, at = 0, 8
    while at < len(data):
        kind = data[at]
        size, at = _read_leb128(data, at + 1)
        if kind in (WASM_CODE, WASM_DATA):
            total += size
        at += size
    return total


def _read_leb128(data: bytes, at: int) -> tuple[int, int]:
    """Return an unsigned number of variable length, and the place after it."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def _text(data: bytes, start: int, size: int | None = None) -> str:
    """Return the text that starts there and ends at a zero byte, or after `size` bytes."""
    end = data.find(b"\0", start)
    end = len(data) if end < 0 else end
    return data[start : end if size is None else min(end, start + size)].decode("ascii", "replace")


def read_stack_use(text: str) -> dict[str, int]:
    """Return the bytes of each function in the output of gcc and clang with -fstack-usage."""
    rows = (line.split("\t") for line in text.splitlines())
    return {row[0].rpartition(":")[2]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}


COMPILE_TIMEOUT = 300.0  # s
MEMORY_LIMIT = 8 * 2**30  # byte of address space, for each process of the compiler
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
FILE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,90}\.[ch]")
OUT_OF_MEMORY = re.compile(
    r"out of memory|outofmemory|memory exhausted|cannot allocate|bad_alloc|failed to map segment"
    r"|allocation failed|resource temporarily unavailable|systemresources",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class CompiledArtifact:
    """A compiled library and how it came about.

    file_name: as library_file_name gives it; library: its bytes; log: all that the compiler wrote; command:
    what made the library, the last one run, with file names relative to its folder; seconds: wall
    time of all runs [s]; peak_memory: largest resident set of one run [byte], None if unknown.
    """

    file_name: str
    library: bytes
    log: str
    command: tuple[str, ...]
    seconds: float
    peak_memory: int | None


def compile_library(
    sources: Mapping[str, str],
    *,
    name: str,
    compiler: Compiler,
    flags: FlagSet,
    target: Target | None = None,
    timeout: float = COMPILE_TIMEOUT,
    memory_limit: int | None = MEMORY_LIMIT,
) -> CompiledArtifact:
    """Compile sources (file name -> text; every .c is compiled, every .h can be included) into one library.

    name: C identifier that names the library; target: machine to compile for, this one by default; timeout
    [s]; memory_limit: address space of each process of the compiler [byte], None for no limit, no effect on
    Windows and macOS. Ctrl-C kills the compiler with all its children and removes all files.
    """
    if not NAME.fullmatch(name):
        raise InvalidNameError(
            "the library's name is no C identifier", where="name", given=name, allowed="letters, digits, _"
        )
    target = target or find_system()
    output, units = library_file_name(name, target), _units(sources)
    started = time.monotonic()
    with _written(sources) as folder:
        limits = (compiler, folder, timeout, memory_limit)
        has_objects = len(units) > 1 or target.is_archive
        outcomes = _compile_objects(units, flags, target, *limits) if has_objects else []
        inputs = tuple(f"{unit}.o" for unit in units) if outcomes else units
        command = build_command(compiler, flags, inputs, output, target=target)
        outcomes += run_compiler([command], *limits)
        library = _read_output(folder / output, outcomes[-1], compiler)
    peaks = [outcome.peak_memory for outcome in outcomes]
    return CompiledArtifact(
        file_name=output,
        library=library,
        log="".join(outcome.log for outcome in outcomes),
        command=command,
        seconds=time.monotonic() - started,
        peak_memory=max((peak for peak in peaks if peak is not None), default=None),
    )


def object_size(
    sources: Mapping[str, str], *, compiler: Compiler, flags: FlagSet, target: Target | None = None
) -> int | None:
    """Return the bytes of code and constants that `sources` compile to, None for an unknown format."""
    with _compiled(sources, compiler, flags, target) as folder:
        sizes = [read_code_size(path.read_bytes()) for path in folder.glob("*.o")]
    return None if None in sizes else sum(size for size in sizes if size is not None)


def stack_use(
    sources: Mapping[str, str], *, compiler: Compiler, flags: FlagSet, target: Target | None = None
) -> dict[str, int]:
    """Return the bytes of stack of each function that is not inlined, none if the compiler reports none."""
    flags = replace(flags, options=(*flags.options, "-fstack-usage"))
    with _compiled(sources, compiler, flags, target) as folder:
        return read_stack_use("".join(path.read_text("utf-8") for path in sorted(folder.rglob("*.su"))))


@contextmanager
def _compiled(
    sources: Mapping[str, str], compiler: Compiler, flags: FlagSet, target: Target | None
) -> Iterator[Path]:
    """Compile the sources to object files in a new temporary folder, removed at the end."""
    units = _units(sources)
    with _written(sources) as folder:
        limits = (compiler, folder, COMPILE_TIMEOUT, MEMORY_LIMIT)
        outcomes = _compile_objects(units, flags, target or find_system(), *limits)
        for unit, done in zip(units, outcomes, strict=True):
            _read_output(folder / f"{unit}.o", done, compiler)
        yield folder


def compiler_environment(compiler: Compiler, folder: Path) -> dict[str, str]:
    """Return the environment of a compiler that works in `folder`: English messages, scratch files in there.

    zig keeps its own builds of the C run-time library (about 50 MB, made in some seconds on first use) in the
    folder that ZIG_GLOBAL_CACHE_DIR names, else below the cache root, else (not writable) in `folder`.
    """
    environment = {key: value for key, value in os.environ.items() if key not in ("LANGUAGE", "GCC_COLORS")}
    environment |= {"LC_ALL": "C", "TMPDIR": str(folder), "TMP": str(folder), "TEMP": str(folder)}
    if compiler.name == "zig":
        environment["ZIG_GLOBAL_CACHE_DIR"] = str(_find_zig_folder() or folder / "zig-global")
        environment["ZIG_LOCAL_CACHE_DIR"] = str(folder / "zig-local")
    return environment


@contextmanager
def _written(sources: Mapping[str, str]) -> Iterator[Path]:
    """Write the sources into a new temporary folder, removed at the end."""
    for file_name in sources:
        if not FILE_NAME.fullmatch(file_name):
            raise InvalidNameError(
                "not a name for a C file",
                where="sources",
                given=file_name,
                allowed="letters, digits, _ and .c or .h",
            )
    if not _units(sources):
        raise InvalidValueError(
            "no C file to compile", where="sources", given=sorted(sources), allowed="a .c file"
        )
    with work_folder(sweep=True) as folder:
        for file_name, text in sources.items():
            (folder / file_name).write_text(text, encoding="utf-8", newline="\n")
        yield folder


def _units(sources: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(sorted(name for name in sources if name.endswith(".c")))


def _compile_objects(
    units: Sequence[str],
    flags: FlagSet,
    target: Target,
    compiler: Compiler,
    folder: Path,
    timeout: float,
    memory_limit: int | None,
) -> list[ChildOutcome]:
    """Compile each unit to an object file `<unit>.o`, the longest text first."""
    order = sorted(units, key=lambda unit: -(folder / unit).stat().st_size)
    commands = [
        build_command(compiler, flags, (unit,), f"{unit}.o", shared=False, target=target) for unit in order
    ]
    outcomes = dict(zip(order, run_compiler(commands, compiler, folder, timeout, memory_limit), strict=True))
    return [outcomes[unit] for unit in units]


def run_compiler(
    commands: Sequence[tuple[str, ...]],
    compiler: Compiler,
    folder: Path,
    timeout: float = COMPILE_TIMEOUT,
    memory_limit: int | None = MEMORY_LIMIT,
) -> list[ChildOutcome]:
    """Run commands of a compiler in `folder`, several at a time; limits and errors as in compile_library."""
    try:
        outcomes = run_several(
            commands,
            folder=folder,
            environment=compiler_environment(compiler, folder),
            timeout=timeout,
            memory_limit=memory_limit,
            workers=os.cpu_count() or 1,
        )
    except OSError as error:
        program = compiler.command[0]
        raise CompileError(
            "the compiler could not be started", log=describe_reason(error), where=program
        ) from error
    for outcome in outcomes:
        if not outcome.ok:
            problem, hint = _explain_failure(outcome, timeout, memory_limit)
            raise CompileError(problem, log=outcome.log, where=" ".join(compiler.command), hint=hint)
    return outcomes


def _explain_failure(outcome: ChildOutcome, timeout: float, memory_limit: int | None) -> tuple[str, str]:
    """Return what went wrong and what to try."""
    smaller = "request fewer quantities"
    if outcome.ended == "time":
        return (f"the compiler met the time limit of {timeout:g} s", f"allow more time, or {smaller}")
    if memory_limit is not None and OUT_OF_MEMORY.search(outcome.log):
        return (
            f"the compiler met the memory limit of {memory_limit / 2**20:g} MiB",
            f"allow more memory, or {smaller}",
        )
    if outcome.ended == "signal":
        return f"the compiler was killed by signal {outcome.number}", f"free some memory, or {smaller}"
    return (
        f"the compiler failed with exit code {outcome.number}",
        "check the compiler with `tensegrity-codegen doctor`, or choose another one",
    )


def _read_output(path: Path, outcome: ChildOutcome, compiler: Compiler) -> bytes:
    try:
        data = path.read_bytes()
    except OSError:
        data = b""
    if not data:
        raise CompileError(
            f"the compiler reported success but wrote no {path.name}",
            log=outcome.log,
            where=" ".join(compiler.command),
            hint="check the compiler with `tensegrity-codegen doctor`, or choose another one",
        )
    return data


def _find_zig_folder() -> Path | None:
    """Return the folder for zig's builds of the C run-time library, None if it cannot be written."""
    chosen = os.environ.get("ZIG_GLOBAL_CACHE_DIR")
    if not chosen:
        return make_cache_folder("zig")
    folder = Path(chosen).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return None
