"""The examples print the numbers of Python in every language whose tools are installed."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import run
from trial.browser import find_browser, read_page, read_text, serve
from trial.recipes import CARGO, RECIPES, Recipe, Tool, find_missing
from trial.rows import compare_rows, parse_rows
from trial.trial import Libraries, Outcome, run_examples

from tests.cases import thorough

ROOT = Path(__file__).resolve().parents[2]
BY_NAME = {recipe.name: recipe for recipe in RECIPES}
QUICK, *OTHERS = BY_NAME
QUANTITIES = {"tension_at_rest", "tension_moved", "position_moved", "energy", "slack", "taut"}

# Runs a program with its argument, and spoils what it prints or how it ends.
SPOIL = """
import subprocess, sys
how, *command = sys.argv[1:]
done = subprocess.run(command, capture_output=True, text=True)
lines = done.stdout.splitlines()
if how == "value" and lines:
    words = lines[-3].split()
    lines[-3] = f"{words[0]} {words[1]} {1.00001 * float(words[2])} {words[3]}"
if how == "line":
    lines = lines[:-1]
if how == "words":
    lines.append("done")
if how == "silent":
    done.stderr = ""
print("\\n".join(lines))
sys.stderr.write(done.stderr)
sys.exit(0 if how == "accepts" else 3 if how == "exit" else done.returncode)
"""


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Libraries:
    return Libraries(tmp_path_factory.mktemp("examples"))


@pytest.fixture(scope="module")
def libraries_of_users(tmp_path_factory: pytest.TempPathFactory) -> Libraries:
    """Libraries compiled as users do, with optimisation."""
    return Libraries(tmp_path_factory.mktemp("compiled"))


def try_recipe(recipe: Recipe, libraries: Libraries) -> Outcome:
    """Run a recipe; skip where its tools are missing."""
    (outcome,) = run_examples([recipe], libraries)
    if outcome.missing:
        tools = ", ".join(f"{tool.program} ({tool.install})" for tool in outcome.missing)
        pytest.skip(f"not installed: {tools}")
    return outcome


def check_numbers(name: str, libraries: Libraries) -> None:
    outcome = try_recipe(BY_NAME[name], libraries)
    assert outcome.status == "same numbers", outcome.message
    assert set(outcome.largest) >= QUANTITIES


def test_the_example_in_c_prints_the_numbers_of_python(libraries: Libraries) -> None:
    check_numbers(QUICK, libraries)


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.timeout(1800)  # zig compiles parts of its C library once
@pytest.mark.parametrize("name", OTHERS)
def test_an_example_prints_the_numbers_of_python(name: str, libraries_of_users: Libraries) -> None:
    check_numbers(name, libraries_of_users)


# Shows the page at a width, and measures it when it has computed.
FRAME = """<!doctype html>
<iframe id="frame" style="border:0;width:{width}px" src="index.html"></iframe>
<script>
const timer = setInterval(() => {{
  const page = document.getElementById("frame").contentDocument;
  if (page.getElementById("done")?.hidden !== false) return;
  clearInterval(timer);
  const root = page.documentElement, found = document.createElement("pre");
  found.id = "found";
  found.textContent = [root.clientWidth, root.scrollWidth, page.querySelectorAll("#picture line").length,
    page.querySelectorAll("#tensions tr").length, page.getElementById("value").textContent].join(" ");
  document.body.append(found);
}}, 50);
</script>"""


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.timeout(1800)
def test_the_page_shows_all_members_and_fits_its_width(libraries_of_users: Libraries) -> None:
    browser = find_browser()
    assert try_recipe(BY_NAME["browser"], libraries_of_users).status == "same numbers"
    assert browser is not None
    folder = libraries_of_users.out / "build" / "browser"
    for width in (400, 1400):
        (folder / f"frame{width}.html").write_text(FRAME.format(width=width), encoding="utf-8")
        with serve(folder) as address:
            document = read_page(browser, f"{address}/frame{width}.html")
        shown, content, *others = read_text(document, "found").split()
        assert width - 30 < int(content) <= int(shown) <= width  # less a scroll bar
        assert others == ["9", "9", "30", "mm"]


def test_the_numbers_of_the_page_are_those_of_python(libraries: Libraries) -> None:
    page = (ROOT / "docs/languages/README.md").read_text(encoding="utf-8")
    block = re.search(r"^```text\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert block is not None
    shown = parse_rows(block[1])
    expected = {row[:2]: row for row in reversed(libraries.expected("mast"))}
    assert compare_rows(shown, tuple(expected[row[:2]] for row in shown)).problems == ()


@pytest.mark.parametrize(
    ("how", "text"),
    [
        ("value", "other numbers than Python\nslack top3"),
        ("accepts", "exit code 0, expected: not 0"),
        *thorough(
            ("line", "other lines than Python: missing [('energy', 'end', 'J')]"),
            ("words", "not a quantity, a name, a value and a unit: 'done'"),
            ("exit", "exit code 3"),
            ("silent", "message '', expected: 'an argument holds a NAN or an infinity' in it"),
        ),
    ],
)
def test_an_example_that_prints_or_ends_otherwise_has_failed(
    how: str, text: str, libraries: Libraries
) -> None:
    script = libraries.out / "spoil.py"
    script.write_text(SPOIL, encoding="utf-8")
    recipe = BY_NAME[QUICK]
    outcome = try_recipe(replace(recipe, run=f"{sys.executable} {script} {how} {recipe.run}"), libraries)
    assert outcome.status == "failed"
    assert text in outcome.message


def test_an_example_that_does_not_compile_has_failed(libraries: Libraries) -> None:
    outcome = try_recipe(replace(BY_NAME[QUICK], build=("make no_such_program",)), libraries)
    assert outcome.status == "failed"
    assert "make no_such_program" in outcome.message


def test_an_example_without_its_tools_is_not_run_and_says_what_to_install(libraries: Libraries) -> None:
    tool = Tool("no-such-program", "apt-get install no-such-package")
    (outcome,) = run_examples([replace(BY_NAME[QUICK], tools=(tool,), build=("false",))], libraries)
    assert outcome == Outcome(QUICK, "not run", missing=(tool,))
    assert "no-such-program (apt-get install no-such-package)" in run.describe(outcome)


@pytest.mark.parametrize(
    ("statuses", "code"),
    [(["same numbers", "not run"], 0), (["not run"], 0), (["same numbers", "failed", "not run"], 1)],
)
def test_the_exit_code_is_1_where_an_example_failed(
    statuses: list[str], code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes = [Outcome(f"example{k}", status) for k, status in enumerate(statuses)]
    monkeypatch.setattr(run, "run_examples", lambda *_: outcomes)
    monkeypatch.setattr(sys, "argv", ["run.py"])
    assert run.main() == code


def test_an_unknown_example_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(sys, "argv", ["run.py", "cobol"])
    with pytest.raises(SystemExit) as stopped:
        run.main()
    assert stopped.value.code == 2
    assert "cobol" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="the launcher of the test is a script of a shell")
def test_a_launcher_without_a_toolchain_is_a_missing_tool(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    launcher = tmp_path / CARGO.program
    for code in (1, 0):
        launcher.write_text(f"#!/bin/sh\nexit {code}\n", encoding="utf-8")
        launcher.chmod(0o755)
        monkeypatch.setenv("PATH", str(tmp_path))
        assert find_missing(CARGO) == bool(code)
