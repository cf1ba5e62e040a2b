"""Pages of figures: finding, commit, day, machine and how to repeat; one list of their programs."""

import re
import sys
from pathlib import Path

import pytest
import write_figures
from harness import turns
from site_pages.expand import expand_page
from write_figures import PROGRAMS, README, Program, list_lines, read_figures

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted({item.page for item in PROGRAMS})
MEASURED = re.compile(r"Measured at commit [0-9a-f]{8}( with changes)? on \d{4}-\d\d-\d\d; \S.+\.")
MOST_WORDS, MOST_ABOUT = 2500, 300


def test_every_page_of_figures_is_in_the_list() -> None:
    named = {"benchmarks.md", "stiffness.md", "stability.md", "simulate_calls.md", "reproduction.md"}
    assert named | {path.name for path in DOCS.glob("*_measured.md")} == set(PAGES)
    marked = {
        path.name for path in DOCS.glob("*.md") if "<!-- figures: benchmarks/" in path.read_text("utf-8")
    }
    assert marked >= set(PAGES)


@pytest.mark.parametrize("item", PROGRAMS, ids=lambda item: item.name)
def test_figures_begin_with_finding_origin_and_how_to_repeat(item: Program) -> None:
    finding, origin, repeat, *rest = read_figures(item).strip().split("\n\n")
    assert re.fullmatch(r"\*\*[^*]+[^*.]\*\*", finding)
    assert re.search(r"\d", finding)
    assert MEASURED.fullmatch(origin)
    assert re.fullmatch(rf"How to repeat: `python benchmarks/{item.name}\.py( [^`]+)? --write`", repeat)
    assert any(part.startswith("|") for part in rest)
    source = (ROOT / "benchmarks" / f"{item.name}.py").read_text("utf-8")
    assert "--write" in source
    assert "publish(" in source or "write_document(" in source


@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_its_finding_first_and_is_short(page: str) -> None:
    text = (DOCS / page).read_text("utf-8")
    assert len(text.split()) <= MOST_WORDS
    before = text.partition("<!-- figures: ")[0]
    assert "|" not in before
    assert len(before.split()) < 60
    for item in PROGRAMS:
        if item.page == page:
            _, _, about = read_figures(item).partition("What the rows are")
            prose = [line for line in about.splitlines() if not line.startswith("|")]
            assert len(" ".join(prose).split()) <= MOST_ABOUT, item.name
    if page != "reproduction.md":  # has a table whose rows are tests
        assert "\n|" not in re.sub(r"<!-- figures: .*?<!-- end of figures -->", "", text, flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES)
def test_a_chart_is_drawn_of_a_table(page: str) -> None:
    text = (DOCS / page).read_text("utf-8")
    assert "<!-- site: bars " in text
    assert '<span class="name">' in expand_page(text, f"docs/{page}")


def test_readme_says_what_the_pages_say() -> None:
    _, _, rest = (ROOT / "README.md").read_text("utf-8").partition(README)
    lines = rest.partition(turns.END)[0].strip().splitlines()
    assert lines == list_lines()
    assert len(" ".join(lines).split()) <= 120
    assert len(lines) <= 4


def test_what_needs_a_quiet_machine_runs_last() -> None:
    kinds = [item.is_timing for item in PROGRAMS]
    assert kinds == sorted(kinds)


def test_published_figures_stand_between_their_marks_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "docs" / "a.md"
    page.parent.mkdir()
    mark, other = "<!-- figures: benchmarks/some.py -->", "<!-- figures: benchmarks/other.py -->"
    page.write_text(f"# A\n{mark}\nold\n{turns.END}\n{other}\nkept\n{turns.END}\nend\n", "utf-8")
    monkeypatch.setattr(turns, "ROOT", tmp_path)
    monkeypatch.setattr(turns, "describe_origin", lambda: "Measured.")
    monkeypatch.setattr(sys, "argv", ["benchmarks/some.py", "--quick", "--in", "/srv/a/b.yaml", "--write"])
    turns.publish("a.md", "1 of 2", "| table |\n", write=True)
    repeat = "How to repeat: `python benchmarks/some.py --quick --in b.yaml --write`"
    wanted = f"{mark}\n**1 of 2**\n\nMeasured.\n\n{repeat}\n\n| table |\n{turns.END}\n"
    assert page.read_text("utf-8") == f"# A\n{wanted}{other}\nkept\n{turns.END}\nend\n"
    page.write_text("no marks", "utf-8")
    with pytest.raises(SystemExit, match="the marks"):
        turns.publish("a.md", "1 of 2", write=True)


def test_a_failure_is_named_and_the_others_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(write_figures, "ROOT", tmp_path)
    (tmp_path / "benchmarks").mkdir()
    for name, text in (
        ("ground", "1 / 0"),
        ("mpc", "print(__file__)"),
        ("sweep", "import time; time.sleep(60)"),
    ):
        (tmp_path / "benchmarks" / f"{name}.py").write_text(text, "utf-8")
    monkeypatch.setattr(write_figures, "describe_origin", lambda: "Measured at commit 01234567 with changes")
    monkeypatch.setattr(write_figures, "write_readme", lambda: None)
    monkeypatch.setattr(sys, "argv", ["write_figures.py", "ground", "mpc"])
    with pytest.raises(SystemExit, match="--dirty"):
        write_figures.main()
    assert not (tmp_path / "output").exists()
    monkeypatch.setattr(sys, "argv", ["write_figures.py", "ground", "mpc", "--dirty"])
    assert write_figures.main() == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["mpc", "ground", "failed:"]  # in the order of the list
    assert lines[-1] == "failed: ground"
    assert "ZeroDivisionError" in (tmp_path / "output" / "figures" / "ground.txt").read_text("utf-8")
    monkeypatch.setattr(write_figures, "MOST", 0.2)
    assert not write_figures.run(next(item for item in PROGRAMS if item.name == "sweep"))
