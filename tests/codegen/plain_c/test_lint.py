"""The plain C files under clang-tidy and cppcheck."""

import shutil
from pathlib import Path

import pytest

from tests.cases import thorough
from tests.codegen.build_c import run
from tests.codegen.plain_c.alone import GROUPS, options_for

# Not: sizes are whole numbers of int, far below its largest; equal types side by side are what numerics has.
CHECKS = (
    "-*,bugprone-*,cert-*,-bugprone-easily-swappable-parameters,"
    "-bugprone-implicit-widening-of-multiplication-result"
)


def require(program: str) -> str:
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    return found


@pytest.fixture(params=GROUPS)
def unit(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A unit that includes every file of a group."""
    lines = [f'#include "{name}"\n' for name in GROUPS[request.param] if name.endswith(".h")]
    path = tmp_path / "unit.c"
    path.write_text("".join(lines) + "extern int unit_;\nint unit_ = 0;\n", encoding="utf-8")
    return path


def test_clang_tidy_finds_nothing(unit: Path) -> None:
    tidy = [require("clang-tidy"), "--quiet", f"--checks={CHECKS}", "--warnings-as-errors=*"]
    command = [*tidy, "--header-filter=templates/c/.*", unit.name, "--", "-std=c99", *options_for(15, False)]
    run(command, unit.parent)


@pytest.mark.parametrize("single", [False, *thorough(True)])
def test_cppcheck_finds_nothing(unit: Path, single: bool) -> None:
    command = [require("cppcheck"), "-q", "--std=c99", "--enable=warning,performance,portability"]
    # Settings make some conditions constant.
    suppressed = "--suppress=knownConditionTrueFalse"
    run([*command, suppressed, "--error-exitcode=1", *options_for(15, single), unit.name], unit.parent)
