"""The pages of docs/languages show the code of the examples and the commands by which they are run."""

import re
import shlex
import textwrap
from pathlib import Path

import pytest
from trial.recipes import BUNDLES, EXAMPLES, RECIPES, Recipe

ROOT = Path(__file__).resolve().parents[2]
PAGES = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs/languages").glob("*.md")}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def page_of(recipe: Recipe) -> str:
    return PAGES[recipe.folder.partition("/")[0]]


def quote(word: str) -> str:
    if "'" in word or ";" in word:
        return f'"{word}"'
    return word if "$" in word else shlex.quote(word)


def list_commands(recipe: Recipe) -> str:
    """Return the commands of a recipe as typed at the top of the checkout."""
    folders = {name: f"$out/{name}" for name in recipe.bundles}
    folders |= {"out": f"$out/build/{recipe.name}", "python": "/usr/bin/python3", "runner": "python3"}
    builds = [BUNDLES[name].command(f"$out/{name}") for name in recipe.bundles]
    move = ("cd", f"examples/{recipe.folder}")
    commands = [*builds, move, *recipe.commands(**folders), recipe.program("0.03", **folders)]
    lines = ["out=$PWD/output/examples", *(" ".join(map(quote, words)) for words in commands)]
    return "".join(f"{line}\n" for line in lines)


@pytest.mark.parametrize("name", [recipe.name for recipe in RECIPES])
def test_the_page_has_the_commands_that_build_and_run_the_example(name: str) -> None:
    recipe = next(item for item in RECIPES if item.name == name)
    blocks = [text for language, text in FENCE.findall(page_of(recipe)) if language == "sh"]
    assert list_commands(recipe) in blocks


def list_excerpts() -> list[tuple[str, str]]:
    return [
        (name, text)
        for name, page in PAGES.items()
        for language, text in FENCE.findall(page)
        if language not in ("sh", "text")
    ]


def is_excerpt(text: str, source: str) -> bool:
    """Whether a text stands in a source, line by line and with any indentation."""
    lines, wanted = source.splitlines(), text.splitlines()
    windows = (lines[k : k + len(wanted)] for k in range(len(lines) - len(wanted) + 1))
    return any(textwrap.dedent("\n".join(window)).splitlines() == wanted for window in windows)


@pytest.mark.parametrize(("name", "text"), list_excerpts())
def test_the_code_of_a_page_is_that_of_an_example(name: str, text: str) -> None:
    folder = EXAMPLES if name == "README" else EXAMPLES / name
    sources = [path.read_text(encoding="utf-8") for path in folder.rglob("*") if is_source(path)]
    assert any(is_excerpt(text, source) for source in sources), text


def is_source(path: Path) -> bool:
    return path.is_file() and path.suffix not in (".lock", ".pyc", ".mex") and "target" not in path.parts


def test_a_changed_line_is_no_excerpt() -> None:
    assert is_excerpt("b = 1\n  c", "a\n  b = 1\n    c\n")
    assert not is_excerpt("b = 2\n  c", "a\n  b = 1\n    c\n")


def test_each_example_has_a_page_and_every_page_is_listed() -> None:
    folders = {path.name for path in EXAMPLES.iterdir() if path.is_dir()} - {"trial", "__pycache__"}
    assert folders == set(PAGES) - {"README"}
    assert sorted(re.findall(r"\]\((\w+)\.md\)", PAGES["README"])) == sorted(folders)
    listed = re.findall(r"^\| `(\w+)` \|", (EXAMPLES / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(folders)
