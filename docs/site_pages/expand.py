"""Marks in pages, `<!-- site: ... -->`, that are replaced when the site is built.

    <!-- site: include README.md -->               the file, from the root; `after TEXT` begins after a text
                                                   and `before TEXT` ends before one
    <!-- site: command line -->                    every verb with its help
    <!-- site: cards NAME NAME ... -->             scenes of the gallery, each with picture and title
    <!-- site: number of scenes -->                "31 structures."
    <!-- site: live NAME -->                       the live page of a scene, in a frame
    <!-- site: scene NAME -->                      the text of a scene's file, folded
    <!-- site: file docs/derivations/bodies.py --> a program, as code
    <!-- site: bars NAME, NAME: PART, PART -->     the next table as bars: columns of names, of parts
    <!-- site: pages 0* -->                        navigation: pages of this folder, by name or pattern
    <!-- site: python NAME NAME ... -->            public names with their docstrings

In a view of the repository a mark is not shown; a page says beside it where to read the same there.
"""

import re
from collections.abc import Callable

from site_pages.bars import write_bars
from site_pages.command_line import write_command_line
from site_pages.gallery import write_cards, write_count, write_live_frame, write_scene_file
from site_pages.links import ROOT, point_links
from site_pages.python_names import write_names

MARK = re.compile(r"^<!-- site: (.+?) -->$", re.MULTILINE)


def expand_page(text: str, page: str) -> str:
    """Return the Markdown of a page, a path from the root, with its marks replaced and its links pointed."""
    parts = MARK.split(point_links(text, page, page))
    for place in range(1, len(parts), 2):
        mark, following = parts[place : place + 2]
        is_bars = mark.startswith("bars ")
        parts[place] = write_bars(mark[5:], following, page) if is_bars else _replace(mark, page)
    return "".join(parts)


def _replace(mark: str, page: str) -> str:
    makers: dict[str, Callable[[], str]] = {
        "command line": write_command_line,
        "number of scenes": write_count,
    }
    if mark in makers:
        return makers[mark]()
    word, _, rest = mark.partition(" ")
    if word == "cards":
        return write_cards(rest.split(), page)
    if word == "live":
        return write_live_frame(rest, page)
    if word == "scene":
        return write_scene_file(rest)
    if word == "python":
        return write_names(rest.split())
    if word == "include":
        return _include(rest, page)
    if word == "file":
        return f"```python\n{(ROOT / rest).read_text(encoding='utf-8')}```"
    if word == "pages":
        names = "\n".join(rest.split())
        return f"```{{toctree}}\n:hidden:\n:glob:\n\n{names}\n```"
    allowed = ", ".join([*makers, "bars", "cards", "file", "include", "live", "pages", "python", "scene"])
    raise ValueError(f"{page}: no mark of the site is called {mark!r}; allowed: {allowed}")


def _include(words: str, page: str) -> str:
    name, *cuts = re.split(r" (?=after |before )", words)
    text = (ROOT / name).read_text(encoding="utf-8")
    for cut in cuts:
        side, _, limit = cut.partition(" ")
        if limit not in text:
            raise ValueError(f"{page}: {name} has no text {limit!r}")
        text = text.partition(limit)[2 if side == "after" else 0]
    return point_links(text, name, page)
