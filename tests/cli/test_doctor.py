from pathlib import Path

import pytest

from tensegrity_codegen.cli import installation
from tensegrity_codegen.codegen.compilation import toolchain
from tensegrity_codegen.codegen.compilation.flags import Compiler
from tensegrity_codegen.system.version import VERSION
from tests.cli.conftest import Run
from tests.codegen.compilers import POSIX, write_script


def use_compilers(monkeypatch: pytest.MonkeyPatch, *found: Compiler) -> None:
    monkeypatch.setattr(installation, "find_compilers", lambda: found)


def test_it_says_what_is_here(run: Run) -> None:
    ended = run.good("doctor", "--json")
    assert ended.data["version"] == VERSION
    assert ended.data["problems"] == []
    assert ended.data["three"]["where"]
    assert any(row["works"] for row in ended.data["compilers"])
    assert all(ended.data["packages"][name] for name in installation.NEEDED)


@pytest.mark.thorough
def test_every_compiler_that_is_here_works(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "find_compilers", toolchain.find_compilers)
    rows = run("doctor", "--json").data["compilers"]
    assert len(rows) == len(toolchain.find_compilers())
    assert all(row["works"] for row in rows)


def test_people_see_each_compiler_by_name(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    use_compilers(monkeypatch, Compiler("none", ("/nowhere/cc",), "cc 1.0"))
    ended = run.refused("doctor")
    assert "BAD none" in ended.out
    assert "problem: no working C compiler" in ended.out


def test_a_broken_compiler_is_a_problem(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    use_compilers(monkeypatch, Compiler("none", ("/nowhere/cc",), "cc 1.0"))
    ended = run.refused("doctor", "--json")
    assert ended.data["status"] == "error"
    assert [row["works"] for row in ended.data["compilers"]] == [False]
    assert ".[cc]" in ended.data["problems"][0]


def test_a_package_that_is_missing_is_a_problem(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "NEEDED", (*installation.NEEDED, "no_such_package"))
    ended = run.refused("doctor", "--json")
    assert ended.data["problems"] == ["no_such_package is not installed"]


@POSIX
@pytest.mark.parametrize("body", ['echo garbage > out; cp out "$out"', ': > "$out"'])
def test_a_chosen_compiler_that_writes_garbage_is_a_problem_though_others_work(
    body: str, run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = 'if [ "$1" = --version ]; then echo "liar 1.0"; exit 0; fi\n'
    script += f'while [ $# -gt 0 ]; do if [ "$1" = -o ]; then out="$2"; fi; shift; done\n{body}'
    monkeypatch.setenv("CC", str(write_script(folder / "liar", script)))
    ended = run.refused("doctor", "--json")
    assert ended.data["status"] == "error"
    assert [row["works"] for row in ended.data["compilers"]][:2] == [False, True]
    assert len(ended.data["problems"]) == 1
    assert "CC" in ended.data["problems"][0]
    assert "liar" in ended.data["problems"][0]


@POSIX
def test_a_chosen_compiler_that_does_not_answer_is_a_problem(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "/nowhere/cc")
    ended = run.refused("doctor", "--json")
    assert "/nowhere/cc" in ended.data["problems"][0]
