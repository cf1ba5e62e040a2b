import ctypes
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tests.cli.conftest import Run
from tests.codegen.compilers import POSIX, chosen_compiler, write_script


def test_the_folder_holds_all_that_is_needed_to_embed(run: Run, folder: Path, two_nodes: Path) -> None:
    data = run("build", two_nodes, "--out", "library", "--json").data
    names = {path.name for path in (folder / "library").iterdir()}
    library = Path(data["library"])
    made = {"Makefile", "example.c", "manifest.json", "two_nodes.c", "two_nodes.h", library.name}
    package = "tensegrity_two_nodes"
    cmake = {f"{package}{part}.cmake" for part in ("Config", "ConfigVersion", "Sources")}
    bundle = {"CMakeLists.txt", *cmake, "README.md", "NOTICE.md"}
    assert names == made | bundle | {f"{package}.pc", f"{package}.pc.in", "SHA256SUMS"}
    assert library.parent == Path("library")
    manifest = json.loads((folder / "library" / "manifest.json").read_text(encoding="utf-8"))
    assert data["name"] == manifest["name"] == "two_nodes"
    loaded = ctypes.CDLL(str(library.resolve()))
    wanted = {"member_tension", "acceleration", "total_energy"}
    assert set(data["functions"]) == wanted  # no margins of events, which the scene does not name
    for symbol in data["functions"].values():
        assert hasattr(loaded, symbol)
    assert all(count > 0 for count in data["operations"].values())


def test_the_second_build_comes_from_the_cache(run: Run, two_nodes: Path) -> None:
    run("build", two_nodes)
    again = run("build", two_nodes, "--json").data
    assert again["from_cache"] is True
    assert Path(again["library"]).is_file()
    assert "from the cache" in run("build", two_nodes).out


@pytest.mark.optimised
def test_only_the_wanted_quantities_are_built(run: Run, two_nodes: Path) -> None:
    data = run("build", two_nodes, "-q", "member_length", "--quantity", "node_force", "--json").data
    assert set(data["functions"]) == {"member_length", "node_force"}
    assert any(row["what"] == "unwanted functions" for row in data["left_out"])


def test_an_integrator_stays_with_the_acceleration_alone(run: Run, two_nodes: Path) -> None:
    for quantity, kept in (("acceleration", True), ("member_length", False)):
        run.good("build", two_nodes, "-q", quantity, "--out", quantity)
        assert ("rk4" in (Path(quantity) / "two_nodes.h").read_text(encoding="utf-8")) == kept


@pytest.mark.thorough
@pytest.mark.optimised
def test_measured_bytes_are_marked(run: Run, two_nodes: Path) -> None:
    rows = run("build", two_nodes, "--measure", "--json").data["left_out"]
    assert rows
    assert all(row["measured"] for row in rows)
    assert not any(row["measured"] for row in run("build", two_nodes, "--json").data["left_out"])


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_exported_makefile_builds_an_example_that_runs(run: Run, folder: Path, two_nodes: Path) -> None:
    run("build", two_nodes, "--out", "library")
    subprocess.run(
        ["make", chosen_compiler()], cwd=folder / "library", check=True, capture_output=True, timeout=60
    )
    program = folder / "library" / "example"
    outcome = subprocess.run([str(program)], check=True, capture_output=True, text=True, timeout=20)
    assert outcome.stdout.strip()


@pytest.mark.parametrize("words", [["--flags", "fast"], ["--quantity", "speed"], ["--compiler", "nope"]])
def test_an_unknown_choice_is_refused_with_the_known_ones(
    words: list[str], run: Run, two_nodes: Path
) -> None:
    ended = run.refused("build", two_nodes, *words, "--out", "library", "--json")
    assert words[1] in ended.data["given"]
    assert ended.data["allowed"] or "known" in ended.data["hint"]
    assert not Path("library").exists()


@pytest.mark.parametrize("out", ["file", "file/library"])
def test_a_file_is_no_output_folder(out: str, run: Run, folder: Path, two_nodes: Path) -> None:
    (folder / "file").write_text("precious", encoding="utf-8")
    ended = run.refused("build", two_nodes, "--out", out, "--json")
    assert ended.data["error"] == "OutputError"
    assert ended.data["where"] == out
    assert (folder / "file").read_text(encoding="utf-8") == "precious"


def test_a_cache_that_cannot_be_written_is_refused(
    run: Run, folder: Path, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv(CACHE_VARIABLE, str(folder / "file"))
    ended = run.refused("build", two_nodes, "--out", "library", "--json")
    assert ended.data["error"] == "OutputError"
    assert CACHE_VARIABLE in ended.data["hint"]
    assert not Path("library").exists()


@POSIX
def test_a_failing_compiler_is_an_error_with_its_log(
    run: Run, folder: Path, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = 'case "$1" in --version) echo "bad cc 1.0";; *) echo "it hurts here" >&2; exit 7;; esac'
    monkeypatch.setenv("CC", str(write_script(folder / "bad_cc", body)))
    monkeypatch.setenv(CACHE_VARIABLE, str(folder / "cache"))
    ended = run.refused("build", two_nodes, "--out", "library", "--json")
    assert ended.data["error"] == "CompileError"
    assert "exit code 7" in ended.data["problem"]
    assert "it hurts here" in ended.data["log"]
    assert "bad_cc" in ended.data["where"]
    assert not Path("library").exists()
    assert list((folder / "cache").glob("libraries/*")) == []


@POSIX
def test_a_program_that_is_no_compiler_is_refused(
    run: Run, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "/bin/false")
    ended = run.refused("build", two_nodes, "--json")
    assert ended.data["error"] == "CompilerMissingError"
    assert ended.data["where"] == "CC"


@pytest.mark.thorough
@pytest.mark.parametrize(
    "spoil", [lambda data: data[: len(data) // 2], lambda data: b"", lambda data: b"x" * 99]
)
def test_a_cache_entry_cut_short_is_rebuilt_silently(
    spoil: object, run: Run, folder: Path, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(folder / "cache"))
    words = ("build", two_nodes, "-q", "member_length", "--json")
    library = Path(run(*words).data["library"])
    whole = library.read_bytes()
    library.unlink()  # never written in place: this process has it loaded
    library.write_bytes(spoil(whole))  # type: ignore[operator]
    ended = run.good(*words)
    assert ended.err == ""
    assert ended.data["from_cache"] is False
    assert library.read_bytes() == whole
    assert run(*words).data["from_cache"] is True


def test_the_emitter_of_the_scene_can_be_overruled(run: Run, two_nodes: Path) -> None:
    assert run("build", two_nodes, "--json").data["emitter"] == "unrolled"
    data = run("build", two_nodes, "--emitter", "table", "--out", "tables", "--json").data
    assert data["emitter"] == "table"
    assert "for (e = 0;" in (Path("tables") / "two_nodes.c").read_text(encoding="utf-8")


def test_an_unknown_emitter_is_refused_with_the_known_ones(run: Run, two_nodes: Path) -> None:
    ended = run.refused("build", two_nodes, "--emitter", "tabel")
    assert "'table'" in ended.err


def test_batch_functions_are_built_where_asked(run: Run, two_nodes: Path) -> None:
    data = run("build", two_nodes, "--batch-width", "4", "--out", "library", "--json").data
    assert data["batch_width"] == 4
    loaded = ctypes.CDLL(str(Path(data["library"]).resolve()))
    for symbol in data["functions"].values():
        assert hasattr(loaded, f"{symbol}_batch")
    plain = run("build", two_nodes, "--json").data
    assert plain["batch_width"] == 0
    assert not hasattr(ctypes.CDLL(plain["library"]), f"{data['functions']['acceleration']}_batch")


def test_the_casadi_interface_is_built_where_asked(run: Run, two_nodes: Path) -> None:
    data = run("build", two_nodes, "--interface", "casadi", "--out", "library", "--json").data
    assert data["interfaces"] == ["casadi"]
    assert [part["is_included"] for part in data["parts"] if part["name"] == "casadi_interface"] == [True]
    assert hasattr(ctypes.CDLL(str(Path(data["library"]).resolve())), "two_nodes_acceleration_n_in")
    plain = run("build", two_nodes, "--json").data
    assert plain["interfaces"] == []
    assert not hasattr(ctypes.CDLL(plain["library"]), "two_nodes_acceleration_n_in")
    assert "without casadi interface: interfaces does not name casadi" in run("build", two_nodes).out
    text = two_nodes.read_text(encoding="utf-8").replace("[model]", '[model]\ninterfaces = ["casadi"]')
    two_nodes.write_text(text, encoding="utf-8")
    assert run("build", two_nodes, "--json").data["interfaces"] == ["casadi"]
    narrow = run("build", two_nodes, "--quantity", "member_tension", "--json").data
    assert narrow["interfaces"] == ["casadi"]
    failed = run("build", two_nodes, "--interface", "matlab", "--json")
    assert failed.code == 2
    assert (failed.data["where"], failed.data["allowed"]) == ("--interface", "casadi, casadi_hessian, acados")


def test_a_batch_width_that_is_no_power_of_two_is_refused(run: Run, two_nodes: Path) -> None:
    failed = run("build", two_nodes, "--batch-width", "3", "--json")
    assert failed.code == 2
    assert failed.data["where"] == "--batch-width"
    assert "power of two" in failed.data["allowed"]


def test_auto_says_which_emitter_it_took_and_why(run: Run, prism: Path) -> None:
    for _ in range(2):  # the second time from the cache
        data = run("build", prism, "--emitter", "auto", "--json").data
        assert data["emitter"] == "unrolled"
        assert "12 members" in data["why_emitter"]
    assert run("build", prism, "--emitter", "unrolled", "--json").data["why_emitter"] == "asked for by name"


@pytest.mark.thorough
def test_a_tuned_build_lists_its_candidates_and_remembers_the_fastest(run: Run, two_nodes: Path) -> None:
    words = ("build", two_nodes, "--tune", "--json")
    first, again = run(*words).data, run(*words).data
    rows = [row for row in first["tuned"]["candidates"] if row["total"] is not None]
    best = min(rows, key=lambda row: row["total"])
    assert {row["emitter"] for row in rows} == {"unrolled", "table"}
    assert all(row["total"] == pytest.approx(sum(row["ns"].values())) for row in rows)
    assert all(row["ns"].keys() == first["functions"].keys() for row in rows)
    assert first["emitter"] == best["emitter"]
    assert first["compiler"].endswith(best["version"])  # of zig, which says its number only, after its name
    assert (first["tuned"]["from_cache"], again["tuned"]["from_cache"]) == (False, True)
    assert again["tuned"]["candidates"] == first["tuned"]["candidates"]
    assert again["library"] == first["library"]
    assert "candidates" in run("build", two_nodes, "--tune").out


@pytest.mark.parametrize("words", [["--tune-for", "speed"], ["--any-flags"]])
def test_a_tuning_that_makes_no_sense_is_refused(words: list[str], run: Run, two_nodes: Path) -> None:
    ended = run.refused("build", two_nodes, *words, "--json")
    assert ended.data["where"] == words[0]


def test_a_preset_of_the_scene_reports_as_that_of_the_command_line(run: Run, two_nodes: Path) -> None:
    by_option = run("build", two_nodes, "--preset", "mcu", "--json").data
    text = two_nodes.read_text(encoding="utf-8").replace("[model]", '[model]\npreset = "mcu"')
    two_nodes.write_text(text, encoding="utf-8")
    by_scene = run("build", two_nodes, "--json").data
    assert by_option["memory"]["code_bytes"] > 0
    assert by_scene["memory"] == by_option["memory"]
    assert "code and constants: " in run("build", two_nodes).out
