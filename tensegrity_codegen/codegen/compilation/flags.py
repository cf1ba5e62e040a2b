"""Compilers and their options, on each system, for each way to compile.

Instruction sets beyond the baseline of x86 have names for compilers, and CPUID bits that report them: Intel
and AMD number these by leaf, subleaf, register and bit (Intel SDM 2A, CPUID; AMD APM 3, appendix E); the
operating system must also save the registers of AVX and AVX-512 (bits of XCR0).
"""

import hashlib
import platform
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tensegrity_codegen.system.errors import FormulationError, check_choice
from tensegrity_codegen.tables.targets import Target, find_system

WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion")


@dataclass(frozen=True)
class Compiler:
    """A C compiler: family ("gcc", "clang", "zig", else the program's name), how to call it, version."""

    name: str
    command: tuple[str, ...]
    version: str


@dataclass(frozen=True)
class FlagSet:
    """A named way to compile; portable: whether the library runs on any CPU of the same architecture."""

    name: str
    options: tuple[str, ...]
    portable: bool = True


# No contraction: a*b+c keeps its two roundings, so that a result is the same on every machine. No errno and
# no traps, which nobody reads here: roots become one instruction, loops vectors; no result changes by it.
REFERENCE = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
ARM = ("aarch64", "arm64")
X86 = ("x86_64", "amd64")
THIS_CPU = "-mcpu=native" if platform.machine().lower() in ARM else "-march=native"

# clang halves the registers of 512 bits unless told otherwise; loops over lanes fill them.
WHOLE_REGISTERS = ("-mprefer-vector-width=512",) if platform.machine().lower() in X86 else ()

# Never -Ofast or -ffast-math: they delete the checks for NaN.
FLAG_SETS = {
    "reference": FlagSet("reference", REFERENCE),
    "native": FlagSet(
        "native", (*REFERENCE, THIS_CPU, *WHOLE_REGISTERS, "-DTENSEGRITY_NATIVE"), portable=False
    ),
    "small": FlagSet(
        "small",
        (
            *(option if option != "-O2" else "-Os" for option in REFERENCE),
            "-ffunction-sections",
            "-fdata-sections",
        ),
    ),
}
MEASURED = ("reference", "native")  # flag sets that are compared for speed

# gcc's vectoriser of straight-line code makes fused multiply-adds where additions and subtractions
# alternate, whatever -ffp-contract says (gcc 12), and slows unrolled code down. Its loops become vectors,
# also those whose length is no multiple of a vector's, which -O2 alone leaves as they are (decision 24).
# Its search for partial redundancies takes time that grows with the square of straight-line code (decision
# 20).
# zig compiles for the CPU it runs on, with debug information and (without -O) with traps for undefined
# behaviour, unless told otherwise. These come first, so that a flag set has the last word.
OWN_OPTIONS = {
    "gcc": ("-fno-tree-slp-vectorize", "-fvect-cost-model=dynamic", "-fno-tree-pre", "-fno-code-hoisting"),
    "zig": ("-mcpu=baseline", "-g0", "-fno-sanitize=undefined"),
}


def find_flags(name: str, where: str = "model.flags") -> FlagSet:
    """Return the flag set of that name; raises UnknownNameError, naming `where`, for an unknown one."""
    check_choice(name, FLAG_SETS, "compile flags", where)
    return FLAG_SETS[name]


def compile_quickly(flags: FlagSet) -> FlagSet:
    """Return the flag set with less optimisation, for functions that are called a few hundred times."""
    options = tuple("-O1" if option == "-O2" else option for option in flags.options)
    return replace(flags, options=options)


def build_command(
    compiler: Compiler,
    flags: FlagSet,
    sources: Sequence[str],
    output: str,
    *,
    shared: bool = True,
    target: Target | None = None,
) -> tuple[str, ...]:
    """Return the command that makes a library of all sources, or (shared=False) an object of one."""
    target = target or find_system()
    if shared and target.is_archive:
        return (*compiler.command[:-1], "ar", "rcsD", output, *sources)  # zig cc -> zig ar
    kind = target.shared if shared else ("-c",)
    libraries = target.libraries if shared else ()
    # A target that chooses a processor replaces the compiler's own choice.
    chosen = any(option.startswith("-mcpu=") for option in target.options)
    defaults = tuple(
        option
        for option in OWN_OPTIONS.get(compiler.name, ())
        if not (chosen and option.startswith("-mcpu="))
    )
    options = (*defaults, *flags.options, *WARNINGS, *target.position, *target.options)
    return (*compiler.command, *options, *kind, *sources, "-o", output, *libraries)


def build_program_command(
    compiler: Compiler, flags: FlagSet, sources: Sequence[str], output: str
) -> tuple[str, ...]:
    """Return the command that makes a program of all sources."""
    options = (*OWN_OPTIONS.get(compiler.name, ()), *flags.options)
    return (*compiler.command, *options, *sources, "-o", output, *find_system().libraries)


def check_target_flags(flags: FlagSet, target: Target, where: str) -> None:
    """Raise FormulationError, naming `where`, for native flags with a target, another machine."""
    if target.name and not flags.portable:
        raise FormulationError(
            "these flags compile for the machine at hand, and a target names another one",
            where=where,
            given=f"flags {flags.name}, target {target.name}",
            allowed='flags "reference"',
            hint='use `flags="reference"`, or build on that machine',
        )


def describe_toolchain(compiler: Compiler, flags: FlagSet, target: Target | None = None) -> str:
    """Return all that makes two compilations of one source differ, as one text to hash into a cache key."""
    command = build_command(compiler, flags, ("SOURCE.c",), "OUTPUT", target=target)
    machine = f"{sys.platform} {platform.machine()}"
    lines = [compiler.name, compiler.version, *command, machine]
    if target is not None and target.name:
        lines += [
            target.name,
            *build_command(compiler, flags, ("SOURCE.c",), "O", shared=False, target=target),
        ]
    return "\n".join(lines if flags.portable else [*lines, describe_cpu()])


def describe_cpu() -> str:
    """Return the CPU's model and abilities, short; a library made for one CPU may not run on another."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor()
    keys = ("model name", "flags", "Features", "CPU part", "isa")
    rows = {line for line in text.splitlines() if line.split("\t")[0].strip(" :") in keys}
    return hashlib.sha256("\n".join(sorted(rows)).encode("utf-8")).hexdigest()


EAX, EBX, ECX, EDX = 0, 1, 2, 3  # result registers of CPUID, numbered as in templates/machine.c.j2
YMM_STATE, ZMM_STATE = 0x06, 0xE6  # bits of XCR0: the system saves registers of AVX, of AVX-512
EXTENDED_LEAF = 0x80000001  # CPUID leaf of extensions by AMD


@dataclass(frozen=True)
class InstructionSet:
    """One instruction set of x86: its name after the compiler option -m, and the CPUID bit that reports it.

    register: 0 to 3 for EAX, EBX, ECX, EDX; saved_state: bits of XCR0 that must be set too, 0 for none.
    """

    name: str
    leaf: int
    subleaf: int
    register: int
    bit: int
    saved_state: int = 0

    @property
    def macro(self) -> str:
        """The macro that compilers define where they may use it."""
        return f"__{self.name.replace('.', '_').upper()}__"


INSTRUCTION_SETS = (
    InstructionSet("sse3", 1, 0, ECX, 0),
    InstructionSet("ssse3", 1, 0, ECX, 9),
    InstructionSet("sse4.1", 1, 0, ECX, 19),
    InstructionSet("sse4.2", 1, 0, ECX, 20),
    InstructionSet("movbe", 1, 0, ECX, 22),
    InstructionSet("popcnt", 1, 0, ECX, 23),
    InstructionSet("avx", 1, 0, ECX, 28, YMM_STATE),
    InstructionSet("f16c", 1, 0, ECX, 29, YMM_STATE),
    InstructionSet("fma", 1, 0, ECX, 12, YMM_STATE),
    InstructionSet("bmi", 7, 0, EBX, 3),
    InstructionSet("bmi2", 7, 0, EBX, 8),
    InstructionSet("lzcnt", EXTENDED_LEAF, 0, ECX, 5),
    InstructionSet("xop", EXTENDED_LEAF, 0, ECX, 11, YMM_STATE),
    InstructionSet("fma4", EXTENDED_LEAF, 0, ECX, 16, YMM_STATE),
    InstructionSet("avx2", 7, 0, EBX, 5, YMM_STATE),
    InstructionSet("avxvnni", 7, 1, EAX, 4, YMM_STATE),
    InstructionSet("avx512f", 7, 0, EBX, 16, ZMM_STATE),
    InstructionSet("avx512dq", 7, 0, EBX, 17, ZMM_STATE),
    InstructionSet("avx512ifma", 7, 0, EBX, 21, ZMM_STATE),
    InstructionSet("avx512pf", 7, 0, EBX, 26, ZMM_STATE),
    InstructionSet("avx512er", 7, 0, EBX, 27, ZMM_STATE),
    InstructionSet("avx512cd", 7, 0, EBX, 28, ZMM_STATE),
    InstructionSet("avx512bw", 7, 0, EBX, 30, ZMM_STATE),
    InstructionSet("avx512vl", 7, 0, EBX, 31, ZMM_STATE),
    InstructionSet("avx512vbmi", 7, 0, ECX, 1, ZMM_STATE),
    InstructionSet("avx512vbmi2", 7, 0, ECX, 6, ZMM_STATE),
    InstructionSet("avx512vnni", 7, 0, ECX, 11, ZMM_STATE),
    InstructionSet("avx512bitalg", 7, 0, ECX, 12, ZMM_STATE),
    InstructionSet("avx512vpopcntdq", 7, 0, ECX, 14, ZMM_STATE),
    InstructionSet("avx512fp16", 7, 0, EDX, 23, ZMM_STATE),
    InstructionSet("avx512bf16", 7, 1, EAX, 5, ZMM_STATE),
)

# The text in a compiled library that lists the sets: see templates/machine.c.j2.
LISTED_SETS = re.compile(rb"instruction sets:((?: [a-z0-9.]+)*)\0")


def find_instruction_sets(library: bytes) -> tuple[str, ...]:
    """Return the instruction sets beyond the baseline that a compiled library says it may use."""
    listing = LISTED_SETS.search(library)
    return tuple(listing[1].decode("ascii").split()) if listing else ()
