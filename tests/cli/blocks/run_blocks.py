"""Runs the blocks of a page in its folder, in their order; names of Python last from block to block."""

import contextlib
import io
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.cli.blocks.find_blocks import ROOT, Block, classify, find_blocks
from tests.cli.blocks.snippets import run_snippet
from tests.cli.blocks.surroundings import BEFORE, EXITS, FILES, SCENES
from tests.cli.conftest import Run
from tests.live.pages import require_three

EXAMPLES = ROOT / "tensegrity_codegen" / "scene" / "examples"
FILE = re.compile(r"`?([\w.]+\.(?:csv|c|json|toml))`?")
ENDINGS = {"c": ".c", "json": ".json", "toml": ".toml", "text": ".csv"}


@dataclass
class PageRun:
    """One page in one folder, which is the current one."""

    page: str
    folder: Path
    run: Run
    names: dict[str, object] = field(default_factory=lambda: {"__name__": "page"})
    added: list[str] = field(default_factory=list)
    count: int = 0
    shown: str = ""  # what commands and programs have printed

    def all_blocks(self) -> None:
        """Run all blocks that are to be run."""
        self.prepare()
        text = (ROOT / self.page).read_text(encoding="utf-8")
        if re.search(r"codegen (?:show \S+ .*\.html|play)", text):
            require_three()
        try:
            blocks = [block for block in find_blocks(self.page) if classify(block) == "run"]
            for block in sorted(blocks, key=lambda item: item.language != "json"):  # files first
                self.block(block)
                self.count += 1
        finally:
            for path in self.added:
                sys.path.remove(path)

    def prepare(self) -> None:
        """Write the files that the page presupposes."""
        scenes = [EXAMPLES / f"{name}.toml" for name in SCENES.get(self.page, ())]
        if "gallery" in self.page:
            own = (ROOT / self.page).with_suffix(".toml")
            scenes += [
                path for path in (own, own.with_suffix(".csv"), ROOT / "examples" / own.name) if path.exists()
            ]
        for path in scenes:
            shutil.copy(path, self.folder)
        for name, content in FILES.get(self.page, {}).items():
            (self.folder / name).write_text(content, encoding="utf-8")

    def block(self, block: Block) -> None:
        """Run one block: commands and programs are executed, files written."""
        if block.language == "sh":
            for line in block.commands:
                for command in line.split(" && "):
                    self.command(command)
        elif block.language in ("python", "py"):
            self.python(block)
        elif block.language == "c" and "int main" not in block.code:
            run_snippet(block, self.folder)
        else:
            name = find_name(block)
            if name is not None and (self.folder / name).exists() and block.language == "toml":
                with (self.folder / name).open("a", encoding="utf-8") as scene:  # lines that a reader adds
                    scene.write(f"\n{block.code}")
            elif name is None and block.language == "text":
                missing = [line for line in block.code.splitlines() if line not in self.shown]
                assert missing == [], (block.page, block.line, self.shown)
            elif name is None:
                check_excerpt(block)
            else:
                (self.folder / name).write_text(block.code, encoding="utf-8")

    def python(self, block: Block) -> None:
        """Execute Python, after what the page presupposes for it; a program with processes runs alone."""
        if '__name__ == "__main__"' in block.code:
            program = self.folder / "program.py"
            program.write_text(block.code, encoding="utf-8")
            self.shown += execute([sys.executable, str(program)], self.folder)
            return
        for page, start, code in BEFORE:
            if page == block.page and block.code.startswith(start):
                exec(compile(code, f"before a block of {page}", "exec"), self.names)
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(block.code, f"{block.page}:{block.line}", "exec"), self.names)
        self.shown += printed.getvalue()

    def command(self, command: str) -> None:
        """Run a command as typed in the folder."""
        words = shlex.split(command)
        if words[0] == "tensegrity-codegen":
            if words[1] == "examples":  # the beginning of a section, each of which stands alone
                (self.folder / f"{words[2]}.toml").unlink(missing_ok=True)
            ended = self.run(*words[1:])
            assert ended.code == EXITS.get(command, 0), (command, ended.out, ended.err)
            self.shown += ended.out
            return
        if words[0] == "pip":
            self.install(words)
            return
        if words[0] == "cc":
            words[0] = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang") or "cc"
        if shutil.which(words[0]) is None and not (self.folder / words[0]).exists():
            pytest.skip(f"no {words[0]} is installed; on Debian: apt install build-essential")
        self.shown += execute(words, self.folder)

    def install(self, words: list[str]) -> None:
        """Install a wheel of the folder into a folder of its own, without what it needs."""
        (wheel,) = self.folder.glob(words[-1])
        target = self.folder / "installed"
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
        execute([*pip, "--target", str(target), str(wheel)], self.folder)
        self.added.append(str(target))
        sys.path.insert(0, str(target))


def execute(words: list[str], folder: Path) -> str:
    """Run a program, whose exit code is 0, and return what it printed."""
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (words, done.stdout, done.stderr)
    return done.stdout


def find_name(block: Block) -> str | None:
    """Return the name of the file that a block is, which the page states before or after it."""
    lines = (ROOT / block.page).read_text(encoding="utf-8").splitlines()
    before, after = lines[: block.line - 1], lines[block.line + len(block.code.splitlines()) :]
    if block.language == "toml" and not block.code.startswith("name = "):
        added = re.findall(r"Add to `(\w+\.toml)`", before[-2])
        return added[0] if added else None
    compiled = [re.findall(r"(?<= )\w+\.c\b", line) for line in after[:12] if line.startswith("cc ")]
    if block.language == "c" and compiled:
        return str(compiled[0][0])
    places = [*reversed(before[-8:]), *after[:8]]
    names = [name for line in places for name in reversed(FILE.findall(line))]
    return next((name for name in names if name.endswith(ENDINGS[block.language])), None)


def check_excerpt(block: Block) -> None:
    """Check that an excerpt of a scene stands in an example: tables and entries of lists, comments aside."""
    scenes = [tomllib.loads(path.read_text(encoding="utf-8")) for path in EXAMPLES.glob("*.toml")]
    part = tomllib.loads(block.code)
    assert any(is_part(part, scene) for scene in scenes), (block.page, block.line)


def is_part(part: object, whole: object) -> bool:
    """Return whether all values of a document stand in another one at the same keys."""
    if isinstance(part, dict) and isinstance(whole, dict):
        return all(key in whole and is_part(value, whole[key]) for key, value in part.items())
    if isinstance(part, list) and isinstance(whole, list) and part and isinstance(part[0], dict):
        return all(any(is_part(entry, other) for other in whole) for entry in part)
    return part == whole
