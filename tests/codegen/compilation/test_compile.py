import ctypes
import os
import signal
import subprocess
import sys
import tempfile
from itertools import product

import pytest

from tensegrity_codegen.codegen.compilation.compile import compile_library, compiler_environment, object_size
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS, Compiler
from tensegrity_codegen.system.errors import CompileError, InvalidNameError, InvalidValueError
from tests.cases import thorough
from tests.codegen.compilers import (
    EACH_FAMILY,
    FAMILIES,
    POSIX,
    SOURCES,
    hanging_body,
    is_running,
    read_pids,
    require_compiler,
    script_compiler,
    wait_until,
)

pytestmark = pytest.mark.optimised

REFERENCE = FLAG_SETS["reference"]
OVERFLOWING = "int next(int k);\nint next(int k) { return k + 1; }\n"
COMPILING = """
import sys
from tests.codegen.compilers import SOURCES
from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS, Compiler
compiler = Compiler("fake", (sys.argv[1],), "1.0")
compile_library(SOURCES, name="twice", compiler=compiler, flags=FLAG_SETS["reference"])
"""


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """The folder for temporary files, so that a test can see what is left there."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def load(artifact, folder):
    path = folder / artifact.file_name
    path.write_bytes(artifact.library)
    return ctypes.CDLL(str(path))


# zig builds its C library for each set of flags at first, which takes seconds.
LONG = [("zig", name) for name in FLAG_SETS if name != "reference"]
QUICK = [case for case in product(FAMILIES, FLAG_SETS) if case not in LONG]


@pytest.mark.parametrize(("family", "flags"), [*QUICK, *thorough(*LONG)])
def test_a_library_is_compiled_and_runs(family, flags, scratch, tmp_path):
    compiler = require_compiler(family)
    artifact = compile_library(SOURCES, name="twice", compiler=compiler, flags=FLAG_SETS[flags])
    assert list(scratch.iterdir()) == []
    assert artifact.log == ""
    assert artifact.seconds > 0.0
    assert artifact.peak_memory is None or 2**20 < artifact.peak_memory < 2**32
    assert str(scratch) not in " ".join(artifact.command)
    result = ctypes.c_double()
    twice = load(artifact, tmp_path).twice
    twice.argtypes = [ctypes.c_double, ctypes.POINTER(ctypes.c_double)]
    assert twice(1.5, result) == 0
    assert result.value == 3.0


SEVERAL = {
    "code.c": "extern const int table[3];\nint pick(int k);\nint pick(int k) { return table[k]; }\n",
    "table.c": "extern const int table[3];\nconst int table[3] = {5, 7, 11};\n",
}


@pytest.mark.parametrize("family", EACH_FAMILY)
def test_several_sources_become_one_library(family, scratch, tmp_path):
    compiler = require_compiler(family)
    first, second = (
        compile_library(SEVERAL, name="several", compiler=compiler, flags=REFERENCE) for _ in range(2)
    )
    pick = load(first, tmp_path).pick
    assert [pick(k) for k in range(3)] == [5, 7, 11]
    assert first.library == second.library
    assert first.log == ""
    assert list(scratch.iterdir()) == []


@pytest.mark.parametrize("bad", SEVERAL)
def test_of_several_sources_the_bad_one_is_named(bad, scratch):
    sources = SEVERAL | {bad: "int f( {\n"}
    with pytest.raises(CompileError, match="exit code") as caught:
        compile_library(sources, name="bad", compiler=require_compiler("gcc"), flags=REFERENCE)
    assert f"{bad}:1:" in caught.value.log
    assert list(scratch.iterdir()) == []


@pytest.mark.parametrize("family", EACH_FAMILY)
def test_the_same_source_gives_the_same_bytes(family):
    compiler = require_compiler(family)
    first, second = (
        compile_library(SOURCES, name="twice", compiler=compiler, flags=REFERENCE) for _ in range(2)
    )
    assert first.library == second.library


def test_zig_adds_no_trap_for_undefined_behaviour(tmp_path):
    compiler = require_compiler("zig")
    artifact = compile_library({"next.c": OVERFLOWING}, name="next", compiler=compiler, flags=REFERENCE)
    assert load(artifact, tmp_path).next(2**31 - 1) == -(2**31)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_failure_keeps_what_the_compiler_wrote(family, scratch):
    compiler = require_compiler(family)
    with pytest.raises(CompileError, match="exit code") as caught:
        compile_library({"bad.c": "int f( {\n"}, name="bad", compiler=compiler, flags=REFERENCE)
    assert "bad.c:1:" in caught.value.log
    assert "error:" in caught.value.log
    assert caught.value.log.rstrip() in str(caught.value)
    assert list(scratch.iterdir()) == []


def test_warnings_end_up_in_the_log():
    source = "int f(double x);\nint f(double x) { return x; }\n"
    artifact = compile_library({"f.c": source}, name="f", compiler=require_compiler("gcc"), flags=REFERENCE)
    assert "Wfloat-conversion" in artifact.log or "Wconversion" in artifact.log


@pytest.mark.parametrize("name", ["", "a b", "../a", "a;b", 'a"', "1a", "a\n", "-o", "é"])
def test_a_name_that_is_no_identifier_is_refused(name):
    with pytest.raises(InvalidNameError):
        compile_library(SOURCES, name=name, compiler=Compiler("none", ("none",), ""), flags=REFERENCE)


@pytest.mark.parametrize("name", ["../a.c", "a/b.c", "-o.c", "a.so", "a.c\n", "a b.c", ".c", "@a.c"])
def test_a_file_name_that_leads_elsewhere_is_refused(name, scratch):
    with pytest.raises(InvalidNameError) as caught:
        compile_library({name: ""}, name="a", compiler=Compiler("none", ("none",), ""), flags=REFERENCE)
    assert caught.value.given == name
    assert list(scratch.iterdir()) == []


def test_headers_alone_are_nothing_to_compile():
    with pytest.raises(InvalidValueError, match="no C file"):
        compile_library({"a.h": ""}, name="a", compiler=Compiler("none", ("none",), ""), flags=REFERENCE)


@POSIX
def test_a_compiler_that_is_gone_is_a_compile_error(tmp_path, scratch):
    compiler = Compiler("gone", (str(tmp_path / "gone"),), "1.0")
    with pytest.raises(CompileError) as caught:
        compile_library(SOURCES, name="twice", compiler=compiler, flags=REFERENCE)
    assert "cannot start" in caught.value.log


@POSIX
def test_success_without_a_library_is_a_compile_error(tmp_path):
    compiler = script_compiler(tmp_path / "cc", "echo all is well")
    with pytest.raises(CompileError, match="wrote no libtwice") as caught:
        compile_library(SOURCES, name="twice", compiler=compiler, flags=REFERENCE)
    assert caught.value.log == "all is well\n"


@POSIX
def test_a_hanging_compiler_meets_the_time_limit(tmp_path, scratch):
    compiler = script_compiler(tmp_path / "cc", hanging_body(tmp_path / "pids"))
    with pytest.raises(CompileError, match=r"time limit of 2 s"):
        compile_library(SOURCES, name="twice", compiler=compiler, flags=REFERENCE, timeout=2.0)
    assert list(scratch.iterdir()) == []
    for pid in read_pids(tmp_path / "pids"):
        wait_until(lambda pid=pid: not is_running(pid), "the compiler ended")


@pytest.mark.skipif(sys.platform != "linux", reason="macOS and Windows do not bound the address space")
@pytest.mark.parametrize("family", ["gcc", "clang"])
def test_a_greedy_compilation_meets_the_memory_limit(family, scratch):
    compiler = require_compiler(family)
    table = ", ".join(f"{k}.0" for k in range(300_000))
    sources = {"big.c": f"const double big[] = {{ {table} }};\n"}
    limit = {"gcc": 60, "clang": 100}[family] * 2**20
    with pytest.raises(CompileError, match=r"memory limit of \d+ MiB"):
        compile_library(sources, name="big", compiler=compiler, flags=REFERENCE, memory_limit=limit)
    assert list(scratch.iterdir()) == []


@POSIX
def test_ctrl_c_leaves_no_file_and_no_process(tmp_path, scratch):
    compiler = script_compiler(tmp_path / "cc", hanging_body(tmp_path / "pids"))
    starter = subprocess.Popen(
        [sys.executable, "-c", COMPILING, *compiler.command],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    pids = read_pids(tmp_path / "pids")
    assert list(scratch.iterdir()) != []
    starter.send_signal(signal.SIGINT)
    _, errors = starter.communicate(timeout=100)
    assert errors.rstrip().endswith("KeyboardInterrupt")
    assert list(scratch.iterdir()) == []
    for pid in pids:
        wait_until(lambda pid=pid: not is_running(pid), "the compiler ended")


@pytest.mark.parametrize("family", EACH_FAMILY)
def test_more_code_makes_a_larger_object(family):
    compiler = require_compiler(family)
    body = "double f{0}(double x);\ndouble f{0}(double x) {{ return x * (x + {0}.0) / (x - 1.0); }}\n"
    sizes = [
        object_size(
            {"f.c": "".join(body.format(k) for k in range(count))}, compiler=compiler, flags=REFERENCE
        )
        for count in (1, 10)
    ]
    assert 0 < sizes[0] < sizes[1] < 100 * sizes[0]


def test_the_objects_of_all_files_add_up():
    compiler = require_compiler("gcc")
    one = object_size({"next.c": OVERFLOWING}, compiler=compiler, flags=REFERENCE)
    two = object_size({"next.c": OVERFLOWING, **SOURCES}, compiler=compiler, flags=REFERENCE)
    other = object_size(SOURCES, compiler=compiler, flags=REFERENCE)
    assert two == one + other


@POSIX
def test_an_object_of_unknown_format_has_no_size(tmp_path):
    body = 'while [ "$1" != -o ]; do shift; done; echo rubbish > "$2"'
    compiler = script_compiler(tmp_path / "cc", body)
    assert object_size(SOURCES, compiler=compiler, flags=REFERENCE) is None


def test_the_environment_is_plain_and_scratch_files_stay_in_the_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("LANGUAGE", "de")
    environment = compiler_environment(Compiler("gcc", ("gcc",), ""), tmp_path)
    assert environment["LC_ALL"] == "C"
    assert environment["TMPDIR"] == str(tmp_path)
    assert "LANGUAGE" not in environment


def test_zig_keeps_its_library_in_the_cache_unless_that_cannot_be_written(tmp_path, monkeypatch):
    zig = Compiler("zig", ("zig", "cc"), "")
    monkeypatch.delenv("ZIG_GLOBAL_CACHE_DIR")
    monkeypatch.setenv("TENSEGRITY_CODEGEN_CACHE", str(tmp_path / "cache"))
    assert compiler_environment(zig, tmp_path)["ZIG_GLOBAL_CACHE_DIR"] == str(tmp_path / "cache" / "zig")
    (tmp_path / "file").touch()
    monkeypatch.setenv("TENSEGRITY_CODEGEN_CACHE", str(tmp_path / "file"))
    assert compiler_environment(zig, tmp_path)["ZIG_GLOBAL_CACHE_DIR"] == str(tmp_path / "zig-global")
