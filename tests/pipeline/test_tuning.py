"""Emitter and compiler by measurement: the fastest wins, is remembered, and what fails is a row."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.codegen import measure
from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS, Compiler, FlagSet
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.pipeline.tuning import TuningRow, build_tuned, fastest
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import CompileError, FormulationError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.compilers import POSIX, write_script
from tests.runtime.build import make_structure, prism, spring

pytestmark = pytest.mark.optimised

REQUEST = ModelRequest(("member_tension", "node_residual"), emitter="auto")
Answers = Mapping[str, dict[str, float] | CompileError]


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache")


def fake(monkeypatch: pytest.MonkeyPatch, answers: Answers) -> list[str]:
    """Let every emitter take the times named here; return the list of those that get measured."""
    measured: list[str] = []

    def build(source: GeneratedSource, compiler: Compiler, flags: FlagSet, folder: Path) -> Path:
        measured.append(source.manifest.emitter)
        return folder / source.manifest.emitter

    def run(programs: Sequence[Path]) -> list[dict[str, float] | CompileError]:
        return [answers[program.name] for program in programs]

    monkeypatch.setattr(measure, "build_driver", build)
    monkeypatch.setattr(measure, "run_drivers", run)
    return measured


def two_nodes() -> Structure:
    return make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 0.9)])


TIMES: Answers = {
    "unrolled": {"member_tension": 1.0, "node_residual": 9.0},
    "table": {"member_tension": 5.0, "node_residual": 3.0},
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("by", "name"), [(None, "table"), ("member_tension", "unrolled"), ("node_residual", "table")]
)
def test_the_least_time_wins(
    by: str | None, name: str, monkeypatch: pytest.MonkeyPatch, cache: Cache
) -> None:
    fake(monkeypatch, TIMES)
    tuned = build_tuned(prism(), REQUEST, compiler=find_compiler().command[0], tune_for=by, cache=cache)
    assert tuned.chosen.emitter == tuned.built.manifest.emitter == name
    assert len(tuned.rows) == 2
    assert "the least of 2 candidates" in tuned.built.why_emitter


@pytest.mark.thorough
def test_a_decision_is_remembered_until_something_changes(
    monkeypatch: pytest.MonkeyPatch, cache: Cache
) -> None:
    measured = fake(monkeypatch, TIMES)
    command = find_compiler().command[0]
    first = build_tuned(prism(), REQUEST, compiler=command, cache=cache)
    again = build_tuned(prism(), REQUEST, compiler=command, cache=cache)
    assert (first.from_cache, again.from_cache) == (False, True)
    assert again.rows == first.rows
    assert again.built.path == first.built.path
    assert measured == ["unrolled", "table"]
    assert not build_tuned(
        prism(), REQUEST, compiler=command, tune_for="node_residual", cache=cache
    ).from_cache
    other = prism().with_changes(name="other")
    assert not build_tuned(other, REQUEST, compiler=command, cache=cache).from_cache
    cache.clear()
    assert not build_tuned(prism(), REQUEST, compiler=command, cache=cache).from_cache


@pytest.mark.thorough
def test_a_candidate_that_fails_is_a_row_with_the_reason(
    monkeypatch: pytest.MonkeyPatch, cache: Cache
) -> None:
    fake(monkeypatch, {**TIMES, "table": CompileError("it broke", log="")})
    tuned = build_tuned(prism(), REQUEST, compiler=find_compiler().command[0], cache=cache)
    assert tuned.chosen.emitter == "unrolled"
    assert [row.problem for row in tuned.rows] == ["", "it broke"]


def test_an_emitter_that_does_not_serve_the_request_is_a_row(
    monkeypatch: pytest.MonkeyPatch, cache: Cache
) -> None:
    fake(monkeypatch, {"unrolled": {"parameter_jacobian": 1.0}})
    request = ModelRequest(("parameter_jacobian",), {"rest_length": (0,)}, emitter="auto")
    tuned = build_tuned(two_nodes(), request, compiler=find_compiler().command[0], cache=cache)
    assert [row.emitter for row in tuned.rows] == ["unrolled", "table"]
    assert "does not serve" in tuned.rows[1].problem
    assert tuned.rows[1].total is None


def test_only_the_emitter_named_is_measured(monkeypatch: pytest.MonkeyPatch, cache: Cache) -> None:
    measured = fake(monkeypatch, TIMES)
    request = replace(REQUEST, emitter="unrolled")
    build_tuned(two_nodes(), request, compiler=find_compiler().command[0], cache=cache)
    assert measured == ["unrolled"]


@pytest.mark.thorough
@POSIX
def test_a_compiler_that_fails_is_a_row_and_where_none_works_its_error_is_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache: Cache
) -> None:
    body = 'case "$1" in --version) echo "bad cc 1.0";; *) echo "it hurts here" >&2; exit 7;; esac'
    bad = write_script(tmp_path / "bad_cc", body)
    monkeypatch.setenv("CC", str(bad))
    request = ModelRequest(("member_length",), emitter="unrolled")
    tuned = build_tuned(prism(), request, cache=cache)
    assert tuned.rows[0].compiler == "bad_cc"
    assert "exit code 7" in tuned.rows[0].problem
    assert tuned.chosen.compiler != "bad_cc"
    with pytest.raises(CompileError) as caught:
        build_tuned(prism(), request, compiler=str(bad), cache=cache)
    assert "it hurts here" in caught.value.log


def test_a_request_that_nobody_serves_is_refused(cache: Cache) -> None:
    with pytest.raises(FormulationError, match="unknown emitter"):
        build_tuned(prism(), replace(REQUEST, emitter="tables"), cache=cache)


def test_only_a_wanted_quantity_can_decide(cache: Cache) -> None:
    with pytest.raises(UnknownNameError) as caught:
        build_tuned(prism(), REQUEST, tune_for="member_tensoin", cache=cache)
    assert "'member_tension'" in caught.value.hint


def test_rows_without_a_time_never_win() -> None:
    rows = (TuningRow("table", problem="refused"), TuningRow("unrolled", total=2.0))
    assert fastest(rows).emitter == "unrolled"


@pytest.mark.parametrize("precision", ["double", *thorough("single")])
def test_measured_times_are_those_of_the_functions(precision: str) -> None:
    """A chain of 300 springs takes longer than one of 10, by any clock."""
    request = ModelRequest(("member_length", "node_residual"), emitter="table", precision=precision)
    times = []
    for count in (10, 300):
        nodes = [[float(k), 0.0, 0.0] for k in range(count + 1)]
        structure = make_structure(nodes, [spring(k, k + 1, 0.9) for k in range(count)], anchored={0: "xyz"})
        source = emit(structure, request)
        times.append(measure.time_functions(source, find_compiler(), FLAG_SETS["reference"]))
    assert set(times[0]) == {"member_length", "node_residual"}
    assert all(0.5 < times[0][name] < times[1][name] / 2 for name in times[0]), times
