"""Every plain C file compiles alone, without a warning, for any size, precision, compiler and as C++."""

from pathlib import Path

import pytest

from tests.codegen.compilers import FAMILIES
from tests.codegen.plain_c.alone import CONTROL, FILES, GROUPS, compile_alone, options_for

CPP = {"gcc": "g++", "clang": "clang++", "zig": "zig"}


@pytest.mark.parametrize("name", [*FILES, *CONTROL])
def test_each_file_needs_no_other_to_be_included_before(name: str, tmp_path: Path) -> None:
    compile_alone([name], "gcc", "c", options_for(15, False), tmp_path)


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("language", ["c", "c++"])
def test_all_compile_together(group: str, language: str, tmp_path: Path) -> None:
    family = "gcc" if language == "c" else CPP["gcc"]
    compile_alone(GROUPS[group], family, language, options_for(15, language == "c"), tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
@pytest.mark.parametrize("n", [1, 15, 300])
@pytest.mark.parametrize("language", ["c", "c++"])
@pytest.mark.parametrize("family", FAMILIES)
def test_every_compiler_takes_every_size(
    family: str, language: str, n: int, single: bool, tmp_path: Path
) -> None:
    compiler = family if language == "c" else CPP[family]
    for files in GROUPS.values():
        compile_alone(files, compiler, language, options_for(n, single), tmp_path)


@pytest.mark.parametrize("language", ["c", "c++"])
def test_a_controller_with_a_policy_compiles(language: str, tmp_path: Path) -> None:
    options = (*options_for(1, language == "c"), "-DWITH_POLICY=1", "-DWITH_GAINS=0", "-DWITH_ESTIMATOR=0")
    compile_alone(CONTROL, "gcc" if language == "c" else CPP["gcc"], language, options, tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
@pytest.mark.parametrize("gains", [0, 1])
def test_controllers_of_every_kind_compile(gains: int, single: bool, tmp_path: Path) -> None:
    options = (*options_for(1, single), f"-DWITH_GAINS={gains}", "-DWITH_ESTIMATOR=0")
    compile_alone(CONTROL, "gcc", "c", options, tmp_path)
