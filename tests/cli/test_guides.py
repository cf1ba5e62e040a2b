"""Commands and programs of docs/start.md and the how-to guides, page by page, each in an empty folder."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.report.live.pages import require_three

DOCS = Path(__file__).resolve().parents[2] / "docs"
GUIDES = sorted(path.name for path in (DOCS / "guides").glob("*.md") if path.name != "README.md")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FILE = re.compile(r"`([\w.]+\.(?:csv|c))`")
SCENE = re.compile(r"`([\w.]+\.toml)`")
NEEDS = {"sweep.md": ("zarr", "xarray", "SALib"), "plan.md": ("daqp",)}


def run_command(command: str, folder: Path, run: Run) -> None:
    words = shlex.split(command)
    if words[0] == "tensegrity-codegen":
        ended = run(*words[1:])
        assert ended.code == 0, (command, ended.out, ended.err)
        return
    if words[0] == "cc":
        words[0] = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang") or "cc"
    if shutil.which(words[0]) is None and not (folder / words[0]).exists():
        pytest.skip(f"no {words[0]} is installed; on Debian: apt install build-essential")
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (command, done.stdout, done.stderr)


def run_page(page: Path, folder: Path, run: Run) -> dict[str, object]:
    """Run all blocks of a page; return the names that its Python leaves."""
    text = page.read_text(encoding="utf-8")
    if "codegen show" in text:
        require_three()
    names: dict[str, object] = {}
    for block in BLOCK.finditer(text):
        language, code = block.groups()
        if language in ("text", "c"):
            name = FILE.findall(text[: block.start()])[-1]
            assert name.endswith(".csv" if language == "text" else ".c")
            (folder / name).write_text(code, encoding="utf-8")
        elif language == "toml":  # lines that the reader adds to a scene
            with (folder / SCENE.findall(text[: block.start()])[-1]).open("a", encoding="utf-8") as scene:
                scene.write("\n" + code)
        elif language == "sh":
            for command in code.splitlines():
                run_command(command, folder, run)
        else:
            assert language == "python", language
            exec(compile(code, page.name, "exec"), names)
    return names


@pytest.mark.thorough
def test_the_first_page_runs(folder: Path, run: Run) -> None:
    names = run_page(DOCS / "start.md", folder, run)
    assert names["rest"].status == "converged"  # type: ignore[attr-defined]
    assert names["motion"].status == "ok"  # type: ignore[attr-defined]
    assert "<canvas" in (folder / "mast.html").read_text(encoding="utf-8")


@pytest.mark.thorough
@pytest.mark.parametrize("page", GUIDES)
def test_every_guide_runs(page: str, folder: Path, run: Run) -> None:
    for package in NEEDS.get(page, ()):
        pytest.importorskip(package)
    names = run_page(DOCS / "guides" / page, folder, run)
    if page == "stiff_bars.md":
        runs = names["runs"]
        assert [run.status for run in runs.values()] == ["ok", "ok"]  # type: ignore[attr-defined]
        assert "radau" in runs[1e7].method  # type: ignore[index]


def test_commands_that_are_only_shown_name_verbs_and_options(run: Run) -> None:
    """Indented commands of guides take minutes: their verbs and options exist."""
    for page in (DOCS / "start.md", *(DOCS / "guides" / name for name in GUIDES)):
        for command in re.findall(r"^    tensegrity-codegen (.*)$", page.read_text("utf-8"), re.MULTILINE):
            verb, *words = shlex.split(command)
            shown = run(verb, "--help")
            assert shown.code == 0, command
            assert [word for word in words if word.startswith("-") and word not in shown.out] == [], command
