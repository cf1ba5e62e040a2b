"""The verb reproduce: files, JSON, wrong usage."""

import json
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from tests.cli.conftest import Run


def test_one_paper_becomes_a_page_and_its_data(run: Run, folder: Path) -> None:
    ended = run.good("reproduce", "lin", "--quick", "--out", "made", "--json")
    assert ended.data["status"] == "ok"
    names = ["journal", "reproduce.html", "reproduce.json"]
    assert [path.name for path in sorted((folder / "made").iterdir())] == names
    outcome = {row["source"]: row["verdict"] for row in ended.data["papers"]["lin"]}
    assert outcome["Table 2"] == "differs"
    assert outcome["Table 3"] == "agrees"
    data = json.loads((folder / "made" / "reproduce.json").read_text("utf-8"))
    assert [paper["name"] for paper in data["papers"]] == ["LIN"]
    html = (folder / "made" / "reproduce.html").read_text("utf-8")
    assert "LIN 3: Table 2 does not follow from the printed data" in html


@pytest.mark.thorough
def test_people_get_a_table_and_the_names_of_the_files(run: Run) -> None:
    ended = run.good("reproduce", "lin", "--quick", "--out", "made")
    assert "Table 1" in ended.out
    assert "wrote made/reproduce.html" in ended.out
    assert ended.err.startswith("took ")


def test_an_unknown_paper_is_refused_before_any_work(run: Run, folder: Path) -> None:
    ended = run.refused("reproduce", "lim", "--json")
    assert ended.data["error"] == "UnknownNameError"
    assert ended.data["hint"] == "did you mean 'lin'?"
    assert list(folder.iterdir()) == []


def test_a_folder_that_is_a_file_is_refused(run: Run, folder: Path) -> None:
    (folder / "made").write_text("", encoding="utf-8")
    ended = run.refused("reproduce", "lin", "--out", "made", "--json")
    assert ended.data["error"] == "OutputError"
    assert (folder / "made").read_text("utf-8") == ""


@pytest.mark.thorough
def test_all_papers_in_full_size(run: Run, folder: Path) -> None:
    ended = run.good("reproduce", "all", "--out", "made", "--json")
    assert set(ended.data["papers"]) == {"sk", "lin", "scs"}
    drift = next(row for row in ended.data["papers"]["sk"] if row["source"] == "Eq. (4.2)")
    assert "100,000 steps" in drift["result"]
