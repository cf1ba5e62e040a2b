"""`sweep summary` and `sweep case`: text, JSON, page, the scene of a case, bad input."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
from tests.cli.conftest import Run
from tests.sweeps.store.conftest import KINDS, make_contents, make_result

pytest.importorskip("zarr")
pytest.importorskip("SALib")


def write_sweep(path: Path, cases: Cases, **identity: object) -> None:
    from tensegrity_codegen.sweeps.store.store import SweepStore, create_store

    create_store(path, make_contents(cases, 4, **identity))
    store = SweepStore(path)
    for task in range(store.layout.n_tasks):
        store.write(task, make_result(*store.layout.cases_of(task)), {})


@pytest.fixture
def stored(folder: Path, two_nodes: Path) -> Path:
    """A sweep over two numbers of the scene of two nodes, every third case of which failed."""
    cases = Cases(
        (Axis("classes.cord.spring_constant", np.array([50.0, 100.0])), Axis("gravity[2]", [-1, -9]))
    )
    document = tomllib.loads(two_nodes.read_text(encoding="utf-8"))
    write_sweep(folder / "a.zarr", cases, scene=document, operation={"do": "equilibrium", "keep": ["energy"]})
    return folder / "a.zarr"


def test_text_and_json_say_the_same(stored: Path, run: Run) -> None:
    text, data = run("sweep", "summary", stored), run("sweep", "summary", stored, "--json")
    assert text.code == data.code == 0
    assert "3 of 4 cases" in text.out
    assert data.data["headline"] in text.out
    assert (data.data["n_cases"], data.data["n_good"]) == (4, 3)
    assert [row["key"] for row in data.data["keys"]] == ["classes.cord.spring_constant", "gravity[2]"]
    assert {item["name"] for item in data.data["results"]} >= {"energy", "tension[max]"}


@pytest.mark.thorough
def test_chosen_results_and_keys_are_on_the_page(stored: Path, run: Run, folder: Path) -> None:
    pytest.importorskip("matplotlib")
    words = ("--result", "tension[c1]", "--result", "energy", "--over", "gravity[2]", "-o", "page.html")
    ended = run.good("sweep", "summary", stored, *words, "--json")
    assert [item["name"] for item in ended.data["results"]] == ["tension[c1]", "energy"]
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert "<title>3 of 4 cases converged, 1 did not" in page
    assert "sweep summary" in page
    assert "tension[c1]" in page
    again = run("sweep", "summary", stored, "-o", "page.html")
    assert again.code == 2
    assert (folder / "page.html").read_text(encoding="utf-8") == page
    replaced = run("sweep", "summary", stored, "-o", "page.html", "--overwrite")
    assert replaced.code == 0, replaced.err


def test_a_case_is_written_as_a_scene_of_its_own(stored: Path, run: Run, folder: Path) -> None:
    shown = run("sweep", "case", stored, 2, "--json").data
    assert shown["keys"] == {"classes.cord.spring_constant": 100.0, "gravity[2]": -1.0}
    assert shown["out"] is None
    run.good("sweep", "case", stored, 2, "-o", "case2.toml")
    document = tomllib.loads((folder / "case2.toml").read_text(encoding="utf-8"))
    assert document["classes"]["cord"]["spring_constant"] == 100.0
    assert document["gravity"][2] == -1.0
    run.good("check", "case2.toml")


def test_the_commands_of_a_case_run(stored: Path, run: Run) -> None:
    for command in run("sweep", "case", stored, 1, "--json").data["commands"]:
        run.good(*command.split()[1:])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("summary", "none.zarr"), "no such folder"),
        (("summary", "."), "not a sweep"),
        (("summary", "a.zarr", "--result", "enrgy"), "energy"),
        (("summary", "a.zarr", "--result", "tension[c9]"), "c1"),
        (("summary", "a.zarr", "--over", "gravity[1]"), "gravity[2]"),
        (("summary", "a.zarr", "-o", "page.txt"), ".html"),
        (("summary", "a.zarr", "-o", "two_nodes.toml"), ".html"),
        (("case", "a.zarr", "4"), "0 to 3"),
        (("case", "a.zarr", "-1"), "0 to 3"),
        (("case", "a.zarr", "one"), "integer"),
        (("case", "a.zarr", "1", "-o", "two_nodes.toml"), "exists"),
        (("case", "a.zarr", "1", "-o", "case.txt"), ".toml"),
        (("case", "none.zarr", "1"), "no such folder"),
    ],
)
@pytest.mark.usefixtures("stored")
def test_bad_input_is_named_and_nothing_is_written(
    words: tuple[str, ...], said: str, run: Run, folder: Path
) -> None:
    before = sorted(folder.iterdir())
    place = ("--",) if words[-1] == "-1" else ()
    ended = run.refused("sweep", *words[:1], "--json", *place, *words[1:])
    assert said in str(ended.data)
    assert sorted(folder.iterdir()) == before


def test_a_page_of_the_user_is_kept(stored: Path, run: Run, folder: Path) -> None:
    (folder / "mine.html").write_text("my own", encoding="utf-8")
    run.refused("sweep", "summary", stored, "-o", "mine.html")
    assert (folder / "mine.html").read_text(encoding="utf-8") == "my own"


@pytest.mark.parametrize("name", ["summary", "case"])
def test_sub_commands_have_help_with_an_example(name: str, run: Run) -> None:
    ended = run.good("sweep", name, "--help")
    assert f"Example: tensegrity-codegen sweep {name} " in ended.out
    assert f"tensegrity-codegen sweep {name} [OPTIONS]" in ended.out
    assert f"sweep {name}" in run("sweep", "--help").out


@pytest.mark.thorough
def test_all_kinds_of_cases_have_a_summary(run: Run, folder: Path) -> None:
    for kind, cases in KINDS.items():
        write_sweep(folder / f"{kind}.zarr", cases, operation={"do": "simulate", "t_end": 1.0})
        ended = run.good("sweep", "summary", f"{kind}.zarr", "--json")
        assert ended.data["n_cases"] == cases.count


def test_wrong_options_of_a_summary_are_named_as_options(stored: Path, run: Run) -> None:
    for option in ("--result", "--over"):
        ended = run("sweep", "summary", stored, option, "foo", "--json")
        assert (ended.code, ended.data["where"]) == (2, option)


def test_a_reader_is_shown_the_sweeps_that_there_are(stored: Path, run: Run, folder: Path) -> None:
    for name in ("b.zarr", "."):
        ended = run.refused("sweep", "summary", name)
        assert "a.zarr" in ended.err
        assert "remove" not in ended.err
        assert "new name" not in ended.err
