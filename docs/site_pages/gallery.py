"""Scenes of the gallery: each as the text of its file and as a live page of the site."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from itertools import takewhile
from pathlib import Path

from site_pages.links import ROOT
from site_pages.markdown import escape

__all__ = ["find_scenes", "write_gallery", "write_live_pages"]


def find_scenes() -> list[Path]:
    """Return the scene files: the packaged examples, the mast of examples/, those of docs/gallery/."""
    packaged = sorted((ROOT / "tensegrity_codegen" / "scene" / "examples").glob("*.toml"))
    return [*packaged, ROOT / "examples" / "mast.toml", *sorted((ROOT / "docs" / "gallery").glob("*.toml"))]


def write_gallery() -> str:
    """Return Markdown: a section for each scene, with its first comment, its live page and its file."""
    return "\n\n".join(_write_scene(path) for path in find_scenes())


def write_live_pages(folder: Path) -> list[str]:
    """Write the live page of each scene that has none newer than its file; return the names that failed."""
    folder.mkdir(parents=True, exist_ok=True)
    failed = []
    for scene in find_scenes():
        page = folder / f"{scene.stem}.html"
        if page.exists() and page.stat().st_mtime > scene.stat().st_mtime:
            continue
        command = ["show", str(scene), "--out", str(page), "--overwrite"]
        words = [sys.executable, "-m", "tensegrity_codegen", *command]
        if subprocess.run(words, check=False, stdout=sys.stderr).returncode != 0:
            failed.append(scene.stem)
    return failed


def is_comment(line: str) -> bool:
    """Return whether a line of a scene file is a comment."""
    return line.startswith("#")


def _write_scene(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    name = tomllib.loads(text)["name"].replace("_", " ")
    comment = " ".join(line.lstrip("# ") for line in takewhile(is_comment, text.splitlines()))
    return (
        f"## {name[0].upper()}{name[1:]}\n\n{escape(comment)}\n\n"
        f'<a href="gallery/{path.stem}.html">Open its live page</a>: turn it, click a member.\n\n'
        f"<details><summary>The scene file</summary>\n\n```toml\n{text}```\n\n</details>"
    )
