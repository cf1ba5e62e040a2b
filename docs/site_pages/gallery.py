"""Scenes of the gallery: cards with pictures, and for each scene its live page and the text of its file."""

import html
import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from site_pages.links import ROOT
from site_pages.thumbnail import write_thumbnail
from tensegrity_codegen import load_scene

PACKAGED = ROOT / "tensegrity_codegen" / "scene" / "examples"
FOLDERS = (PACKAGED, ROOT / "docs" / "gallery")


def find_scenes() -> dict[str, Path]:
    """Return scene files by name: packaged examples, those of docs/gallery/, the mast of examples/."""
    scenes = [path for folder in FOLDERS for path in sorted(folder.glob("*.toml"))]
    return {path.stem: path for path in [*scenes, ROOT / "examples" / "mast.toml"]}


def write_cards(names: Sequence[str], page: str) -> str:
    """Return a row of cards, each a picture, the title and the first sentence of a scene's page."""
    up = "../" * (page.count("/") - 1)
    return f'<div class="cards">\n{"".join(_write_card(name, up) for name in names)}</div>'


def write_count() -> str:
    """Return the number of scenes of the gallery."""
    return f"{len(find_scenes())} structures."


def write_live_frame(name: str, page: str) -> str:
    """Return the live page of a scene in a frame, and links to it and to the scene's file."""
    if name not in find_scenes():
        raise ValueError(f"{page}: no scene of the gallery is called {name!r}")
    up = "../" * (page.count("/") - 1)
    page_name = f"{up}live/{name}.html"
    return (
        f'<iframe class="live" src="{page_name}" title="live page of {name}" loading="lazy"></iframe>\n'
        f'<p class="below"><a href="{page_name}">Whole window</a> · '
        f'<a href="{up}scenes/{name}.toml" download>{name}.toml</a></p>'
    )


def write_scene_file(name: str) -> str:
    """Return the text of a scene's file, folded."""
    path = find_scenes()[name]
    text = path.read_text(encoding="utf-8")
    return (
        f"<details><summary>The scene file, {len(text.splitlines())} lines</summary>\n\n"
        f"```toml\n{text}```\n\n</details>"
    )


def read_summary(path: Path) -> str:
    """Return the first paragraph of the comment at the top of a scene file, as one line."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return " ".join(line.lstrip("# ") for line in takewhile(is_comment, lines))


def is_comment(line: str) -> bool:
    """Return whether a line of a scene file is a comment that is not empty."""
    return line.startswith("# ")


def _write_card(name: str, up: str) -> str:
    path = find_scenes()[name]
    title = re.search(
        r"^# (.*)$", (ROOT / "docs" / "gallery" / f"{name}.md").read_text("utf-8"), re.MULTILINE
    )
    if title is None:
        raise ValueError(f"docs/gallery/{name}.md has no title")
    first = re.split(r"(?<=[.:]) ", read_summary(path))[0].rstrip(":")
    picture = write_thumbnail(load_scene(path)[0], name)
    return (
        f'<a class="card" href="{up}gallery/{name}.html">{picture}'
        f"<strong>{html.escape(title[1])}</strong><span>{html.escape(first)}</span></a>\n"
    )
