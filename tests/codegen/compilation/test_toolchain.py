import importlib.util
import sys

import pytest

from tensegrity_codegen.codegen.compilation import toolchain
from tensegrity_codegen.codegen.compilation.toolchain import check_compiler, find_compiler, find_compilers
from tensegrity_codegen.system.errors import CompileError, CompilerMissingError
from tests.codegen.compilers import FAMILIES, POSIX, require_compiler, script_compiler, write_script


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    monkeypatch.delenv("CC", raising=False)


@pytest.fixture
def no_compiler(monkeypatch, tmp_path):
    """A machine without any compiler: an empty PATH, no package ziglang."""
    programs = tmp_path / "programs"
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "ziglang" else real(name))
    return programs


@pytest.mark.optimised  # the C library that zig builds for other tests serves this one
@pytest.mark.parametrize("family", FAMILIES)
def test_each_real_compiler_works(family):
    compiler = require_compiler(family)
    assert compiler.name == family
    assert any(character.isdigit() for character in compiler.version)
    assert "computes" in check_compiler(compiler)


def test_no_compiler_is_an_error_that_says_how_to_get_one(no_compiler):
    assert find_compilers() == ()
    with pytest.raises(CompilerMissingError) as caught:
        find_compiler()
    assert "pip install '.[cc]'" in caught.value.hint
    assert caught.value.exit_code == 2


def test_the_package_ziglang_serves_where_path_has_nothing(monkeypatch, tmp_path):
    pytest.importorskip("ziglang")
    monkeypatch.setenv("PATH", str(tmp_path))
    compiler = find_compiler()
    assert compiler.name == "zig"
    assert compiler.command == (sys.executable, "-m", "ziglang", "cc")


def test_an_unknown_wish_lists_what_is_there(no_compiler):
    with pytest.raises(CompilerMissingError) as caught:
        find_compiler("no-such-compiler --loud")
    assert caught.value.given == "no-such-compiler --loud"
    assert caught.value.allowed == "none was found"


@POSIX
def test_the_order_is_cc_variable_then_cc_then_gcc_then_clang(no_compiler, monkeypatch):
    write_script(no_compiler / "cc", "echo 'some cc 1.0'")
    write_script(no_compiler / "gcc", "echo gcc 9; echo Free Software Foundation")
    write_script(no_compiler / "clang", "echo clang version 3")
    write_script(no_compiler / "mine", 'echo "mine: $*"')
    monkeypatch.setenv("CC", "mine 'one word' two")
    assert [compiler.name for compiler in find_compilers()] == ["mine", "cc", "gcc", "clang"]
    assert find_compiler().version == "mine: one word two --version"
    assert find_compiler("clang").version == "clang version 3"


@POSIX
def test_one_program_under_two_names_is_listed_once(no_compiler):
    write_script(no_compiler / "gcc", "echo gcc 9; echo Free Software Foundation")
    (no_compiler / "cc").symlink_to("gcc")
    assert [compiler.command[0] for compiler in find_compilers()] == [str(no_compiler / "cc")]


@POSIX
@pytest.mark.parametrize(
    "body", ["exit 1", "kill -9 $$", "exit 0", "sleep 100"], ids=["fails", "dies", "mute", "hangs"]
)
def test_a_compiler_that_does_not_answer_is_passed_over(no_compiler, monkeypatch, body):
    monkeypatch.setattr(toolchain, "VERSION_TIMEOUT", 0.3)
    monkeypatch.setenv("PATH", f"{no_compiler}:/bin:/usr/bin")
    write_script(no_compiler / "cc", body)
    assert str(no_compiler / "cc") not in {compiler.command[0] for compiler in find_compilers()}


@POSIX
def test_a_broken_cc_variable_is_an_error_not_passed_over(no_compiler, monkeypatch):
    write_script(no_compiler / "cc", "echo 'some cc 1.0'")
    monkeypatch.setenv("CC", "missing-compiler")
    with pytest.raises(CompilerMissingError) as caught:
        find_compiler()
    assert caught.value.where == "CC"
    assert "unset CC" in caught.value.hint
    assert [compiler.name for compiler in find_compilers()] == ["cc"]


@POSIX
def test_the_version_is_asked_once(no_compiler, tmp_path):
    write_script(no_compiler / "cc", f"echo asked >> '{tmp_path}/count'; echo some cc 1.0")
    assert find_compiler() == find_compiler()
    assert (tmp_path / "count").read_text(encoding="utf-8") == "asked\n"


@pytest.mark.parametrize(
    ("command", "driver"),
    [
        (("/opt/zig", "cc"), ("/opt/zig",)),
        (("python3", "-m", "ziglang", "cc"), ("python3", "-m", "ziglang")),
        (("zig", "c++"), None),
        (("zig",), None),
        (("gcc",), None),
        (("ccache", "gcc"), None),
    ],
)
def test_zig_is_known_by_how_it_is_called(command, driver):
    assert toolchain._find_zig(command) == driver


@POSIX
def test_a_compiler_whose_library_is_rubbish_fails_the_check(tmp_path):
    body = 'while [ "$1" != -o ]; do shift; done; echo rubbish > "$2"'
    with pytest.raises(CompileError, match="does not load"):
        check_compiler(script_compiler(tmp_path / "cc", body))


def test_a_compiler_named_by_a_relative_path_works(monkeypatch, tmp_path):
    real = find_compiler()
    write_script(tmp_path / "mycc", f'exec {" ".join(real.command)} "$@"')
    monkeypatch.chdir(tmp_path)
    found = find_compiler("./mycc")
    assert found.command == (str(tmp_path / "mycc"),)
    assert "computes" in check_compiler(found)
