"""The verb `export`: exit codes, messages and the JSON object."""

from pathlib import Path

import pytest

from tensegrity_codegen.export import exporter
from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource
from tests.cli.conftest import Run


def write_names(source: ExportSource, path: Path) -> Exported:
    path.write_text(" ".join(source.structure.node_name), encoding="utf-8")
    return Exported({"n_nodes": source.structure.n_nodes}, ("forces are not in the file",))


@pytest.fixture(autouse=True)
def formats(monkeypatch: pytest.MonkeyPatch) -> None:
    known = [Exporter("names", "names of nodes", (".txt",), write_names)]
    monkeypatch.setattr(exporter, "find_exporters", lambda: known)


def test_the_help_lists_the_formats(run: Run) -> None:
    assert "names of nodes" in run("export", "--help").out


def test_the_result_names_file_facts_and_notes(run: Run, two_nodes: Path, folder: Path) -> None:
    ended = run.good("export", "names", two_nodes, "-o", "names.txt", "--json")
    assert ended.facts == {
        "status": "ok",
        "format": "names",
        "out": "names.txt",
        "n_nodes": 2,
        "notes": ["forces are not in the file"],
        "warnings": ["forces are not in the file"],
    }
    assert (folder / "names.txt").is_file()
    assert "wrote n2.txt: n_nodes 2" in run("export", "names", two_nodes, "-o", "n2.txt").out


@pytest.mark.parametrize(
    ("words", "where"),
    [
        (("export", "nmaes", "two_nodes.toml", "-o", "names.txt"), "export"),
        (("export", "names", "two_nodes.toml", "-o", "two_nodes.toml"), "two_nodes.toml"),
        (("export", "names", "two_nodes.toml", "-o", "taken.txt"), "taken.txt"),
        (("export", "names", "nowhere.toml", "-o", "names.txt"), "nowhere.toml"),
    ],
)
@pytest.mark.usefixtures("two_nodes")
def test_wrong_input_is_refused(words: tuple[str, ...], where: str, run: Run, folder: Path) -> None:
    (folder / "taken.txt").write_text("mine", encoding="utf-8")
    ended = run(*words, "--json")
    assert (ended.code, ended.data["where"]) == (2, where)
    assert sorted(path.name for path in folder.iterdir()) == ["taken.txt", "two_nodes.toml"]


def test_an_existing_file_is_replaced_on_request(run: Run, two_nodes: Path, folder: Path) -> None:
    (folder / "taken.txt").write_text("mine", encoding="utf-8")
    run.good("export", "names", two_nodes, "-o", "taken.txt", "--overwrite")
    assert (folder / "taken.txt").read_text(encoding="utf-8") != "mine"
