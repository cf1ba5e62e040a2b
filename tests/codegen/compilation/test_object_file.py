import subprocess
import sys

import pytest

from tensegrity_codegen.codegen.compilation.compile import read_code_size
from tests.codegen.compilers import require_compiler

SOURCE = """
extern double table_of_four[4];
double table_of_four[4] = {1, 2, 3, 4};
static const double constant[3] = {0.1, 0.2, 0.3};
double pick(int k);
double pick(int k) { return constant[k % 3] + table_of_four[k % 4]; }
"""


def compile_for(target, folder, *options):
    (folder / "pick.c").write_text(SOURCE, encoding="utf-8")
    zig = require_compiler("zig")
    command = [*zig.command, "-target", target, "-O2", "-g0", *options, "-c", "pick.c", "-o", "pick.o"]
    subprocess.run(command, cwd=folder, check=True)
    return (folder / "pick.o").read_bytes()


@pytest.mark.parametrize(
    "target",
    [
        *("x86_64-linux-gnu", "aarch64-linux-gnu", "x86-linux-gnu", "powerpc64-linux-gnu", "aarch64-macos"),
        *("x86_64-windows-gnu", "wasm32-wasi"),
    ],
)
def test_every_format_gives_code_and_constants_but_no_data(target, tmp_path):
    size = read_code_size(compile_for(target, tmp_path))
    assert 24 + 16 <= size <= 400  # three constants and some instructions


def test_constants_count_and_data_does_not(tmp_path):
    before = read_code_size(compile_for("x86_64-linux-gnu", tmp_path))
    with_symbols = read_code_size(compile_for("x86_64-linux-gnu", tmp_path, "-g"))
    assert with_symbols == before


@pytest.mark.skipif(sys.platform != "linux", reason="compares with the program `size` on ELF files")
def test_the_size_is_that_of_text_without_unwind_tables(tmp_path):
    data = compile_for("x86_64-linux-gnu", tmp_path, "-fno-asynchronous-unwind-tables", "-fno-unwind-tables")
    try:
        answer = subprocess.run(["size", "pick.o"], cwd=tmp_path, capture_output=True, text=True, check=True)
    except OSError:
        pytest.skip("the program `size` is not installed")
    assert read_code_size(data) == int(answer.stdout.splitlines()[1].split()[0])


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x7fELF",
        b"rubbish",
        b"\xcf\xfa\xed\xfe",
        b"\x64\x86\xff\xff",
        b"\x7fELF\x02\x01" + b"\xff" * 80,
    ],
)
def test_rubbish_has_no_size(data):
    assert read_code_size(data) is None


@pytest.mark.parametrize("length", [5, 40, 70, 200])
def test_a_file_cut_short_has_no_size(length, tmp_path):
    data = compile_for("x86_64-linux-gnu", tmp_path)
    assert read_code_size(data[:length]) is None
