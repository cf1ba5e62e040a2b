"""Machines that libraries are compiled for: this one, and others by name.

A library for another machine is compiled by zig, which brings headers and C libraries of all of them.
"""

import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace

from tensegrity_codegen.system.errors import check_choice

WASM_STACK = 2**20  # bytes; batch functions use up to 200 kB


@dataclass(frozen=True)
class Target:
    """A machine to compile for, and the requirements of a library for it.

    name: its name on the command line and in manifests; empty for the machine that compiles.
    kind: of the product: ``"shared library"``, ``"WebAssembly module"`` or ``"static library"``.
    shared, position: options to link a library, and to compile code that can be loaded anywhere.
    prefix, suffix: beginning and ending of the file name of a library.
    libraries: libraries to link.
    options: options of zig that choose the machine.
    binary: the result of `describe_binary` for its libraries.
    wheel_tag: platform tag of wheels; empty if Python packages cannot hold such a library.
    """

    name: str
    kind: str
    shared: tuple[str, ...]
    position: tuple[str, ...]
    prefix: str
    suffix: str
    libraries: tuple[str, ...]
    options: tuple[str, ...] = ()
    binary: str = ""
    wheel_tag: str = ""

    @property
    def is_archive(self) -> bool:
        """Whether object files are collected in an archive, and not linked."""
        return self.suffix == ".a"


SHARED = "shared library"
# How this machine makes libraries, by operating system as in `sys.platform`.
SYSTEMS = {
    "linux": Target("", SHARED, ("-shared",), ("-fPIC",), "lib", ".so", ("-lm",)),
    "darwin": Target("", SHARED, ("-dynamiclib",), ("-fPIC",), "lib", ".dylib", ("-lm",)),
    "win32": Target("", SHARED, ("-shared",), (), "", ".dll", ("-lm",)),
}

# -s: without names that only debuggers need, for functions linked from zig's C libraries.
LINUX = replace(SYSTEMS["linux"], shared=("-shared", "-s"))
MACOS = replace(SYSTEMS["darwin"], shared=("-dynamiclib", "-s"))
WINDOWS = replace(SYSTEMS["win32"], shared=("-shared", "-s"))
WASM = Target(
    name="wasm32",
    kind="WebAssembly module",
    # A module without a main program, whose caller finds all public names and the free memory.
    shared=(
        *("-mexec-model=reactor", "-s", "-Wl,--export-dynamic", "-Wl,--export=__heap_base"),
        f"-Wl,-z,stack-size={WASM_STACK}",
    ),
    position=(),
    prefix="",
    suffix=".wasm",
    libraries=("-lm",),
    options=("-target", "wasm32-wasi"),
    binary="WebAssembly",
)
# Cortex-M4F and M7F: Thumb-2 with registers of single precision, in which arguments are passed. Headers of a
# C library, none of its code. zig's cortex_m4 alone has no floating-point unit.
THUMB = Target(
    name="thumbv7em", kind="static library", shared=(), position=("-ffunction-sections", "-fdata-sections"),
    prefix="lib", suffix=".a", libraries=(),
    options=(
        *("-target", "thumb-linux-musleabihf", "-mcpu=cortex_m4+vfp4d16sp"),
        *("-fno-pic", "-fno-unwind-tables"),
    ),
    binary="ELF for arm",
)  # fmt: skip

_ALL = (
    replace(
        LINUX, name="aarch64-linux", options=("-target", "aarch64-linux-gnu.2.17"), binary="ELF for aarch64",
        wheel_tag="manylinux_2_17_aarch64.manylinux2014_aarch64",
    ),
    replace(
        LINUX, name="x86_64-linux", options=("-target", "x86_64-linux-gnu.2.17"), binary="ELF for x86_64",
        wheel_tag="manylinux_2_17_x86_64.manylinux2014_x86_64",
    ),
    replace(
        WINDOWS, name="x86_64-windows", options=("-target", "x86_64-windows-gnu"), binary="PE for x86_64",
        wheel_tag="win_amd64",
    ),
    replace(
        MACOS, name="aarch64-macos", options=("-target", "aarch64-macos.11.0"), binary="Mach-O for aarch64",
        wheel_tag="macosx_11_0_arm64",
    ),
    replace(
        MACOS, name="x86_64-macos", options=("-target", "x86_64-macos.11.0"), binary="Mach-O for x86_64",
        wheel_tag="macosx_11_0_x86_64",
    ),
    WASM,
    THUMB,
)  # fmt: skip
# Machines that a library can be compiled for by name.
TARGETS: Mapping[str, Target] = {target.name: target for target in _ALL}

PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}
HOST_SYSTEMS = {"darwin": "macos", "win32": "windows"}


def find_system(system: str = sys.platform) -> Target:
    """Return the target of an operating system (as in `sys.platform`); an unknown one is taken as Linux."""
    return SYSTEMS["win32" if system == "cygwin" else system if system in SYSTEMS else "linux"]


def find_target(name: str | None, where: str = "target") -> Target:
    """Return the machine of that name, this one for None; UnknownNameError, naming `where`, if unknown."""
    if name is None:
        return find_system()
    check_choice(name, TARGETS, "target", where)
    return TARGETS[name]


def find_host() -> str:
    """Return the name of this machine, as targets are called: "x86_64-linux"."""
    processor = platform.machine().lower()
    return f"{PROCESSORS.get(processor, processor)}-{HOST_SYSTEMS.get(sys.platform, sys.platform)}"


def library_file_name(name: str, target: Target | None = None) -> str:
    """Return the file name of a library: lib<name>.so, .dylib or .a, <name>.dll or <name>.wasm."""
    target = target or find_system()
    return f"{target.prefix}{name}{target.suffix}"


def library_suffixes() -> tuple[str, ...]:
    """Return the endings of libraries of all machines."""
    return tuple(dict.fromkeys(target.suffix for target in (*SYSTEMS.values(), *_ALL)))
