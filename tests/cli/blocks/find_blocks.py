"""All blocks of the documents, fenced or indented, and what happens to each."""

import re
from dataclasses import dataclass
from pathlib import Path

from tests.cli.blocks.surroundings import ELSEWHERE, EXCLUDED

ROOT = Path(__file__).resolve().parents[3]
OUTSIDE = ("README.md", "CONTRIBUTING.md", "examples/README.md")
LIST_ITEM = re.compile(r"^\s*(?:[-*]|\d+\.) ")
COMMAND = re.compile(r"tensegrity-codegen |make |cc |pip |python |import |from ")


@dataclass(frozen=True)
class Block:
    """A block of code: its page, the line before it, its language ("indented" without a fence), its text."""

    page: str
    line: int
    language: str
    code: str

    @property
    def commands(self) -> list[str]:
        """The commands of a block of a shell, without what explains them after two spaces."""
        lines = re.sub(r"\\\n\s*", " ", self.code).splitlines()
        return [re.split(r"(?<=\S) {3,}", line.strip())[0] for line in lines if line.strip()]


def list_pages() -> list[str]:
    """Return the documents, as paths from the root."""
    found = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))
    return [*OUTSIDE, *found]


def find_blocks(page: str) -> list[Block]:
    """Return the blocks of a page, in their order."""
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    blocks, place, in_list = [], 0, False
    while place < len(lines):
        line = lines[place]
        fence = re.match(r"^\s*```(.*)$", line)
        if fence:
            end = next(k for k in range(place + 1, len(lines)) if lines[k].strip() == "```")
            code = "".join(f"{text}\n" for text in lines[place + 1 : end])
            blocks.append(Block(page, place + 1, fence[1].strip(), code))
            place = end + 1
            continue
        if line.strip() and not line.startswith(" "):
            in_list = LIST_ITEM.match(line) is not None
        if line.startswith("    ") and not in_list and not lines[place - 1].strip():
            end = place
            while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
                end += 1
            code = "".join(f"{text[4:]}\n" for text in lines[place:end])
            blocks.append(Block(page, place + 1, "indented", code))
            place = end
            continue
        place += 1
    return blocks


def classify(block: Block) -> str:
    """Return "run", "elsewhere" (another test runs it), "excluded", "shown" or "navigation"."""
    if block.language in ("math", "{toctree}", "{math}"):
        return "shown" if "math" in block.language else "navigation"
    if block.language == "indented":
        return "shown"
    if any(block.page.startswith(page) for page in ELSEWHERE):
        return "elsewhere"
    if any(block.code.startswith(start) for page, start, _ in EXCLUDED if block.page == page):
        return "excluded"
    return "run"


def is_code_without_language(block: Block) -> bool:
    """Return whether a block that is only shown begins like a command or a program."""
    return block.language in ("indented", "text", "") and COMMAND.match(block.code) is not None
