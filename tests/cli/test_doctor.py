from __future__ import annotations

import pytest

from tensegrity_codegen.cli import doctor as doctor_module
from tensegrity_codegen.codegen.flags import Compiler
from tensegrity_codegen.version import VERSION
from tests.cli.conftest import Run


def use_compilers(monkeypatch: pytest.MonkeyPatch, *found: Compiler) -> None:
    monkeypatch.setattr(doctor_module, "find_compilers", lambda: found)


def test_it_says_what_is_here(run: Run) -> None:
    ended = run("doctor", "--json")
    assert ended.code == 0
    assert ended.data["version"] == VERSION
    assert ended.data["problems"] == []
    assert any(row["works"] for row in ended.data["compilers"])
    assert all(ended.data["packages"][name] for name in doctor_module.NEEDED)


def test_people_see_each_compiler_by_name(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    use_compilers(monkeypatch, Compiler("none", ("/nowhere/cc",), "cc 1.0"))
    ended = run("doctor")
    assert ended.code == 2
    assert "BAD none" in ended.out
    assert "problem: no working C compiler" in ended.out


def test_a_broken_compiler_is_a_problem(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    use_compilers(monkeypatch, Compiler("none", ("/nowhere/cc",), "cc 1.0"))
    ended = run("doctor", "--json")
    assert ended.code == 2
    assert ended.data["status"] == "error"
    assert [row["works"] for row in ended.data["compilers"]] == [False]
    assert "tensegrity_codegen[cc]" in ended.data["problems"][0]


def test_a_package_that_is_missing_is_a_problem(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_module, "NEEDED", (*doctor_module.NEEDED, "no_such_package"))
    ended = run("doctor", "--json")
    assert ended.code == 2
    assert ended.data["problems"] == ["no_such_package is not installed"]
