"""DAQP's solver as one C file: static functions, its licence, either precision, no memory of its own."""

import hashlib
import re
from pathlib import Path

import pytest

from tensegrity_codegen.control.embedded.daqp_source import (
    DAQP_SHA256,
    SILENCED,
    emit_daqp,
    read_daqp_licence,
)
from tensegrity_codegen.system.errors import MissingSourceError
from tests.codegen.build_c import STRICT, require_cpp, run
from tests.codegen.compilers import require_compiler
from tests.codegen.plain_c.alone import NEED_DAQP, NEED_SOFT_DAQP, compile_alone, options_for
from tests.control.embedded.daqp import require_daqp_archive

SINGLE = pytest.mark.parametrize("single", [False, True], ids=["double", "single"])


@pytest.fixture
def archive() -> bytes:
    return require_daqp_archive()


def write_unit(folder: Path, text: str, name: str = "unit.c") -> str:
    (folder / "daqp_static.h").write_text(text, encoding="utf-8")
    (folder / name).write_text(
        '#include "daqp_static.h"\n#include "daqp_static.h"\nextern int unit_;\nint unit_ = 0;\n',
        encoding="utf-8",
    )
    return name


@SINGLE
@pytest.mark.parametrize("family", ["gcc", "clang"])
@pytest.mark.parametrize("soft", [False, True], ids=["hard", "soft"])
def test_it_compiles_without_a_warning(
    archive: bytes, family: str, single: bool, soft: bool, tmp_path: Path
) -> None:
    name = write_unit(tmp_path, emit_daqp(archive, single=single, soft=soft))
    strict = [*require_compiler(family).command, "-std=c99", "-O2", *STRICT, "-Wshadow", "-Wdouble-promotion"]
    run([*strict, "-c", name, "-o", "unit.o"], tmp_path)


def test_it_compiles_as_cpp(archive: bytes, tmp_path: Path) -> None:
    name = write_unit(tmp_path, emit_daqp(archive), "unit.cpp")
    run([*require_cpp("g++"), "-std=c++11", *STRICT, "-c", name, "-o", "unit.o"], tmp_path)


@SINGLE
@pytest.mark.parametrize("name", sorted(NEED_DAQP | NEED_SOFT_DAQP))
@pytest.mark.parametrize("language", ["c", "c++"])
def test_the_files_of_the_controller_that_need_it_compile_alone(
    archive: bytes, name: str, language: str, single: bool, tmp_path: Path
) -> None:
    soft = name in NEED_SOFT_DAQP
    text = emit_daqp(archive, single=single, soft=soft)
    (tmp_path / "daqp_static.h").write_text(text, encoding="utf-8")
    setting = "-DWITH_MPC=1" if soft else "-DWITH_DISTRIBUTION=1"
    options = (*options_for(1, single), f"-I{tmp_path}", setting)
    compiler = "gcc" if language == "c" else "g++"
    compile_alone([f"control/{name}"], compiler, language, options, tmp_path)


def test_it_has_no_memory_and_no_symbols_of_its_own(archive: bytes, tmp_path: Path) -> None:
    text = emit_daqp(archive)
    assert not re.search(r"\b(malloc|calloc|free|printf) *\(", text)
    # Functions that nothing calls are removed, unless they are told to stay.
    name = write_unit(tmp_path, text)
    command = require_compiler("gcc").command
    run([*command, "-std=c99", "-O0", "-fkeep-static-functions", "-c", name, "-o", "unit.o"], tmp_path)
    table = [line.split()[-2:] for line in run(["nm", "unit.o"], tmp_path).stdout.splitlines()]
    assert {symbol for kind, symbol in table if kind.isupper()} <= {"unit_"}
    assert "daqp_ldp" in {symbol for kind, symbol in table if kind == "t"}
    assert {kind for kind, symbol in table if symbol != "unit_"} <= {"t", "r"}


def test_single_precision_has_no_double(archive: bytes, tmp_path: Path) -> None:
    text = emit_daqp(archive, single=True)
    code = re.sub(r"/\*.*?\*/|//[^\n]*", "", text, flags=re.DOTALL)
    assert not re.search(r"\bdouble\b", code)
    loud = "\n".join(line for line in text.splitlines() if not line.startswith("#pragma"))
    name = write_unit(tmp_path, loud)
    command = [
        *require_compiler("gcc").command,
        "-std=c99",
        "-Wdouble-promotion",
        "-Wfloat-conversion",
        "-Werror",
    ]
    run([*command, "-c", name, "-o", "unit.o"], tmp_path)


def test_only_warnings_about_its_own_text_are_silenced(archive: bytes) -> None:
    text = emit_daqp(archive)
    assert text.count("#pragma GCC diagnostic push") == text.count("#pragma GCC diagnostic pop") == 1
    assert text.count("#pragma GCC diagnostic ignored") == len(SILENCED)
    assert text.index("diagnostic push") < text.index("typedef") < text.index("diagnostic pop")


def test_it_names_its_licence_its_version_and_what_was_changed(archive: bytes) -> None:
    head = emit_daqp(archive)[:3000]
    assert "MIT License" in read_daqp_licence(archive)
    for line in read_daqp_licence(archive).split("\n"):
        assert line.strip() in head
    assert DAQP_SHA256 in head
    assert "Changed by tensegrity_codegen" in head


def test_a_damaged_archive_is_refused() -> None:
    with pytest.raises(MissingSourceError, match="damaged"):
        emit_daqp(b"not an archive")


# The source archive of DAQP is the pinned one.


def test_the_archive_is_the_pinned_one() -> None:
    assert hashlib.sha256(require_daqp_archive()).hexdigest() == DAQP_SHA256
