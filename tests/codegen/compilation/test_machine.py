"""Native code on a machine that lacks its instructions: a status and an error, never a crash."""

import ctypes
import platform
import re
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import (
    FLAG_SETS,
    INSTRUCTION_SETS,
    Compiler,
    FlagSet,
    build_command,
    find_instruction_sets,
)
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.errors import CompileError, LibraryError, UnknownNameError
from tensegrity_codegen.tables.manifest import STATUS, Manifest
from tests.cases import thorough
from tests.codegen.build_c import STRICT, has_sanitizers, run, write_files
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.drive_c import format_driver
from tests.codegen.subjects import bare, everything

pytestmark = pytest.mark.optimised

ON_X86 = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="asks CPUID, which x86 has"
)
ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux: ELF, /proc or a simulated CPU")
UNSUPPORTED = STATUS.index("unsupported_machine")
# Two instruction sets that no machine has both of: AMD's of 2011, and that of Intel's many-core CPUs.
MADE_UP = ("fma4", "avx512er")
KERNEL_NAME = {  # where Linux says it otherwise
    "sse3": "pni",
    "sse4.1": "sse4_1",
    "sse4.2": "sse4_2",
    "bmi": "bmi1",
    "lzcnt": "abm",
    "avxvnni": "avx_vnni",
    "avx512vbmi": "avx512vbmi",
    "avx512vbmi2": "avx512_vbmi2",
    "avx512vnni": "avx512_vnni",
    "avx512bitalg": "avx512_bitalg",
    "avx512fp16": "avx512_fp16",
    "avx512vpopcntdq": "avx512_vpopcntdq",
    "avx512bf16": "avx512_bf16",
}


def source(flags: str = "native") -> GeneratedSource:
    """A library with functions, integrators and a solver."""
    structure, request = bare()
    request = replace(request, flags=flags, interfaces=("casadi",))
    wanted = ("member_tension", "acceleration", "potential_energy", "tangent_stiffness", "node_residual")
    integrators = ("rk4", "rk54", "rk853")
    return emit(structure, request.wanting(*wanted, integrators=integrators, solvers=("equilibrium",)))


def requiring(names: Sequence[str]) -> FlagSet:
    """Flags whose code says that it needs these instruction sets, and does not."""
    macros = tuple(f"-D{item.macro}" for item in INSTRUCTION_SETS if item.name in names)
    return FlagSet("made up", (*FLAG_SETS["reference"].options, "-DTENSEGRITY_NATIVE", *macros))


def library_requiring(names: Sequence[str], folder: Path) -> tuple[Path, Manifest]:
    made = source()
    code = {name: text for name, text in made.files.items() if name in ("triangle.c", "triangle.h")}
    artifact = compile_library(code, name="triangle", compiler=find_compiler(), flags=requiring(names))
    path = folder / artifact.file_name
    path.write_bytes(artifact.library)
    return path, made.manifest


def list_missing(path: Path) -> list[str]:
    library = ctypes.CDLL(str(path))
    library.triangle_missing_instruction_set.restype = ctypes.c_char_p
    found: list[str] = []
    while name := library.triangle_missing_instruction_set(len(found)):
        found.append(name.decode())
    assert library.triangle_missing_instruction_set(-1) is None
    return found


# --- a made-up requirement -------------------------------------------------------------------------


@pytest.mark.thorough
@ON_X86
def test_the_loader_names_what_is_missing_and_what_to_do(tmp_path: Path) -> None:
    path, manifest = library_requiring(MADE_UP, tmp_path)
    with pytest.raises(LibraryError, match="instructions that this machine lacks") as caught:
        CompiledModel(path, manifest)
    assert any(name in caught.value.given for name in MADE_UP)
    assert caught.value.where == str(path)
    assert 'flags="reference"' in caught.value.hint


@ON_X86
def test_every_function_refuses_and_writes_nothing(tmp_path: Path) -> None:
    path, manifest = library_requiring(MADE_UP, tmp_path)
    library = ctypes.CDLL(str(path))
    assert library.triangle_check_machine() == UNSUPPORTED
    for spec in manifest.functions:
        result = np.full(40, 7.0)
        pointers = [ctypes.c_void_p(result.ctypes.data)] * (len(spec.arguments) + 1)
        assert library[spec.symbol](*pointers) == UNSUPPORTED
        assert (result == 7.0).all()


@pytest.mark.thorough
@ON_X86
@ON_LINUX
def test_the_machine_is_asked_what_the_kernel_says_of_it(tmp_path: Path) -> None:
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    has = set(next(line for line in text.splitlines() if line.startswith("flags")).partition(":")[2].split())
    every = [item.name for item in INSTRUCTION_SETS]
    path, _ = library_requiring(every, tmp_path)
    expected = [name for name in every if KERNEL_NAME.get(name, name) not in has]
    assert list_missing(path) == expected


def test_reference_code_suits_every_machine() -> None:
    built = build_library(*bare())
    assert built.manifest.flags == "reference"
    assert built.manifest.instruction_sets == ()
    assert find_instruction_sets(built.path.read_bytes()) == ()
    name = built.manifest.name
    assert built.load().library.symbol(f"{name}_check_machine")() == 0


def test_the_check_is_in_native_sources_only(tmp_path: Path) -> None:
    for flags, expected in (("native", True), ("reference", False)):
        made = source(flags)
        assert ("cpuid" in made.files["triangle.c"]) is expected
        (part,) = [part for part in made.manifest.parts if part.name == "machine_check"]
        assert part.is_included is expected
    code = {name: text for name, text in made.files.items() if name in ("triangle.c", "triangle.h")}
    with pytest.raises(CompileError, match="no machine check in this file"):
        compile_library(code, name="triangle", compiler=find_compiler(), flags=requiring(()))


# --- native code -----------------------------------------------------------------------------------


@ON_X86
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_a_native_library_says_what_its_compiler_was_allowed(family: str, tmp_path: Path) -> None:
    compiler = require_compiler(family)
    built = build_library(*bare(), compiler=family, flags="native")
    assert built.manifest.flags == "native"
    write_files(tmp_path, {"empty.c": ""})
    command = build_command(compiler, FLAG_SETS["native"], ("empty.c",), "-", shared=False)
    macros = run([*command, "-dM", "-E"], tmp_path, compiler).stdout
    allowed = tuple(item.name for item in INSTRUCTION_SETS if f"#define {item.macro} 1" in macros)
    assert built.manifest.instruction_sets == allowed
    model = built.load()
    reference = build_library(*bare(), compiler=family).load()
    for quantity in model.quantities:
        np.testing.assert_array_equal(model.compute(quantity), reference.compute(quantity))


DRIVER = """
#include <stdio.h>
#include "triangle.h"
#define SHOW(call) printf("%d\\n", call)
int main(void)
{
  static double a[64], work[4096];
  static triangle_equilibrium_report report;
  const char *word;
  double time = 0.0, step = 0.0;
  long long count = 0, done = 0, n = 0;
  int k;
  SHOW(triangle_check_machine());
CALLS
  SHOW(triangle_integrate_rk4(0.0, 1e-3, 0, 1, a, 0, NULL, NULL, &count, &done, work));
  SHOW(triangle_integrate_rk54(1.0, 1e-3, 1e-3, 1, &time, &step, a, 0, NULL, NULL, &count, &done, &n, work));
  SHOW(triangle_integrate_rk853(1.0, 1e-3, 1e-3, 1, &time, &step, a, 0, NULL, NULL, &count, &done, &n, work));
  SHOW(triangle_find_equilibrium(a, 1e-9, 3, &report, work));
  for (k = 0; (word = triangle_missing_instruction_set(k)) != NULL; ++k) {
    puts(word);
  }
  return 0;
}
"""


def format_calls(manifest: Manifest) -> str:
    """Calls with the scene's values, then as CasADi calls."""
    lines = []
    for spec in manifest.functions:
        passed = "".join(f"triangle_nominal_{name}, " for name in spec.arguments)
        lines.append(f"  SHOW({spec.symbol}({passed}a));")
    return DRIVER.replace("CALLS", "\n".join(lines))


def build_driver(compiler: Compiler, flags: FlagSet, folder: Path) -> Path:
    """A program for every machine that uses a library compiled with `flags`."""
    made, plain = source(flags.name), FLAG_SETS["reference"]
    write_files(folder, made.files | {"driver.c": format_calls(made.manifest)})
    run(build_command(compiler, flags, ("triangle.c",), "triangle.o", shared=False), folder, compiler)
    run(build_command(compiler, plain, ("driver.c",), "driver.o", shared=False), folder, compiler)
    portable = ("-mcpu=baseline",) if compiler.name == "zig" else ()
    run([*compiler.command, *portable, "triangle.o", "driver.o", "-o", "driver", "-lm"], folder, compiler)
    return folder / "driver"


def run_on_nehalem(program: Path, folder: Path) -> list[str]:
    """Run it on a simulated CPU of 2008, without AVX; a signal makes the test fail."""
    return run(["qemu-x86_64", "-cpu", "Nehalem", str(program)], folder).stdout.split()


@pytest.mark.thorough
@ON_X86
@ON_LINUX
@pytest.mark.skipif(shutil.which("qemu-x86_64") is None, reason="qemu-user is not installed")
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_on_an_older_machine_native_code_is_a_status_and_no_crash(family: str, tmp_path: Path) -> None:
    compiler = require_compiler(family)
    found = run_on_nehalem(build_driver(compiler, FLAG_SETS["native"], tmp_path), tmp_path)
    if not any(item.startswith("avx") for item in found):
        pytest.skip("this machine has no AVX itself, so that its native code runs there too")
    statuses = [word for word in found if word.isdigit()]
    assert len(statuses) == 10
    assert set(statuses) == {str(UNSUPPORTED)}


@pytest.mark.thorough
@ON_X86
@ON_LINUX
@pytest.mark.skipif(shutil.which("qemu-x86_64") is None, reason="qemu-user is not installed")
def test_on_an_older_machine_reference_code_runs(tmp_path: Path) -> None:
    found = run_on_nehalem(build_driver(find_compiler(), FLAG_SETS["reference"], tmp_path), tmp_path)
    assert found[:6] == ["0"] * 6  # the machine, and the functions


@pytest.mark.thorough
@ON_X86
@ON_LINUX
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_native_code_has_no_warning_and_no_writable_data(family: str, tmp_path: Path) -> None:
    compiler, made = require_compiler(family), source()
    write_files(tmp_path, made.files)
    command = build_command(compiler, FLAG_SETS["native"], ("triangle.c",), "triangle.o", shared=False)
    run([*command, *STRICT], tmp_path, compiler)
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    rows = [line.split()[-2:] for line in run(["nm", "triangle.o"], tmp_path).stdout.splitlines()]
    assert [symbol for kind, symbol in rows if kind in "dDbBcC"] == []


@pytest.mark.thorough
@ON_X86
def test_no_sanitizer_has_anything_to_say_of_native_code(tmp_path: Path) -> None:
    compiler = find_compiler()
    if compiler.name == "zig" or not has_sanitizers(compiler, tmp_path):
        pytest.skip("no compiler here builds programs with the address sanitizer")
    made = source()
    write_files(
        tmp_path,
        made.files | {"driver.c": format_driver(made.manifest, made.files[f"{made.manifest.name}.c"])},
    )
    options = ["-std=c99", "-O1", "-march=native", "-DTENSEGRITY_NATIVE", "-fsanitize=address,undefined"]
    units = ["driver.c", "triangle.c"]
    run([*compiler.command, *options, *units, "-o", "run_all", "-lm"], tmp_path, compiler)
    assert run([str(tmp_path / "run_all")], tmp_path).stderr == ""


# What CasADi asks before it calls, and what names the missing: answers that need no instruction of their own.
ANSWERS = ("_checkout", "_work")


@pytest.mark.parametrize("subject", [bare, *thorough(everything)], ids=["bare", "everything"])
def test_every_public_function_asks_before_it_does_anything(subject: Any) -> None:
    """Also those that a later emitter adds: plain itself, the first statement the question."""
    structure, request = subject()
    request = replace(request, flags="native", interfaces=("casadi",))
    source = emit(structure, replace(request, integrators=request.integrators or ("rk4", "rk54", "rk853")))
    text, name = source.files[f"{source.manifest.name}.c"], source.manifest.name
    defined = re.findall(
        rf"^((?:\w+ )*)int ((?:jac_|adj1_|jac_adj1_)?{name}_\w+)\([^;{{]*?\)\s*\{{\s*(\S+)",
        text,
        re.MULTILINE,
    )
    asked = [(before, word) for before, symbol, word in defined if not symbol.endswith(ANSWERS)]
    assert len(asked) > len(source.manifest.functions) + len(source.manifest.integrators)
    assert set(asked) == {("TENSEGRITY_PLAIN ", "TENSEGRITY_CHECK_MACHINE")}
    public = {item.symbol for item in (*source.manifest.functions, *source.manifest.integrators)}
    assert public <= {symbol for _, symbol, _ in defined}


# --- who chooses -----------------------------------------------------------------------------------


def test_the_request_chooses_and_the_caller_overrides() -> None:
    structure, request = bare()
    native = replace(request, flags="native")
    assert build_library(structure, native).manifest.flags == "native"
    assert "-DTENSEGRITY_NATIVE" in build_library(structure, native).flags
    assert build_library(structure, native, flags="reference").manifest.flags == "reference"
    assert build_library(structure, request, flags="native").manifest.flags == "native"


def test_the_makefile_compiles_as_asked() -> None:
    structure, request = bare()
    for name, flags in FLAG_SETS.items():
        assert " ".join(flags.options) in emit(structure, replace(request, flags=name)).files["Makefile"]


@pytest.mark.parametrize("flags", ["natve", "-O3", ""])
def test_unknown_flags_are_refused(flags: str) -> None:
    structure, request = bare()
    with pytest.raises(UnknownNameError, match="unknown compile flags") as caught:
        build_library(structure, replace(request, flags=flags))
    assert caught.value.allowed == "reference, native, small"
    with pytest.raises(UnknownNameError, match="unknown compile flags"):
        build_library(structure, request, flags=flags)


def test_each_instruction_set_is_there_once() -> None:
    places = {(item.leaf, item.subleaf, item.register, item.bit) for item in INSTRUCTION_SETS}
    assert len(places) == len({item.macro for item in INSTRUCTION_SETS}) == len(INSTRUCTION_SETS)


def test_a_file_that_says_nothing_needs_nothing() -> None:
    assert find_instruction_sets(b"") == ()
    assert find_instruction_sets(b"\0instruction sets:\0") == ()
    assert find_instruction_sets(b"x\0instruction sets: avx sse4.1\0y") == ("avx", "sse4.1")
