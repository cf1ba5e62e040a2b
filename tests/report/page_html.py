"""What the text of a page holds, without a browser: tags, titles, tables, links."""

import html
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser

from tests.test_english import find_dialect

VOID = {"meta", "link", "br", "img", "path", "use"}
ADDRESSES = ("src", "href", "xlink:href", "srcset", "data", "action")
UNCLEAR = (r"\b[a-z]+_not_[a-z]+\b", r"\bAsked, measured, holds\b", r"\bholds\b\s*$")


@dataclass
class Grid:
    """A table: CSS classes of its box and of itself, headings, and the heading of each field of each row."""

    layout: str
    kind: str
    heads: list[str] = field(default_factory=list)
    rows: list[list[str | None]] = field(default_factory=list)


class PageHtml(HTMLParser):
    """Tags, ids, texts by tag, tables; `problems` names tags that are not closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[tuple[str, str]] = []
        self.problems: list[str] = []
        self.text: dict[str, list[str]] = {}
        self.tables: list[Grid] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        if tag == "table":
            boxes = [name for name in (kind for _, kind in self.open) if name.startswith("table")]
            self.tables.append(Grid(boxes[-1] if boxes else "", found.get("class") or ""))
        if tag == "tr" and self.tables:
            self.tables[-1].rows.append([])
        if tag == "td" and self.tables:
            self.tables[-1].rows[-1].append(found.get("data-head"))
        if tag == "th" and self.tables and any(name == "thead" for name, _ in self.open):
            self.tables[-1].heads.append("")
        if tag not in VOID:
            self.open.append((tag, found.get("class") or ""))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID and (not self.open or self.open.pop()[0] != tag):
            self.problems.append(tag)

    def handle_data(self, data: str) -> None:
        names = [name for name, _ in self.open]
        if names and names[-1] != "style":
            for name in {*names, "*"}:
                self.text.setdefault(name, []).append(data)
        if "th" in names and self.tables and "thead" in names and "table" in names:
            self.tables[-1].heads[-1] += data

    def words(self, tag: str) -> str:
        """Return the text inside all elements of a tag."""
        return re.sub(r"\s+", " ", "".join(self.text.get(tag, []))).strip()


def read_html(text: str) -> PageHtml:
    """Return the parsed page."""
    page = PageHtml()
    page.feed(text)
    return page


def check_static(text: str, numbers: list[str]) -> PageHtml:
    """Assert what every page of results has; its heading states `numbers` as they are written."""
    page = read_html(text)
    assert page.problems == []
    assert page.open == []
    _check_head(page, text)
    _check_heading(page, numbers)
    _check_addresses(page, text)
    for grid in page.tables:
        _check_grid(grid)
    for tag, attributes in page.tags:
        if tag == "img":
            assert attributes.get("alt"), "a picture without words for those who do not see it"
        if attributes.get("role") == "img":
            assert attributes.get("aria-label")
    for kind in ("h1", "h2", "h3", "p", "th", "td", "summary", "figcaption", "li", "dd"):
        words = page.words(kind)
        found = [pattern for pattern in UNCLEAR if re.search(pattern, words)]
        assert found + find_dialect(words) == [], (kind, words)
    return page


def _check_head(page: PageHtml, text: str) -> None:
    assert text.startswith("<!doctype html>")
    metas = {a.get("name") or a.get("http-equiv"): a.get("content") for tag, a in page.tags if tag == "meta"}
    assert metas["viewport"] == "width=device-width, initial-scale=1"
    assert metas["color-scheme"] == "light dark"
    assert (metas["Content-Security-Policy"] or "").startswith("default-src 'none'")
    assert "color-scheme: light dark" in text
    assert "@media (prefers-color-scheme: dark)" in text
    assert "@media print" in text


def _check_heading(page: PageHtml, numbers: list[str]) -> None:
    assert sum(tag == "h1" for tag, _ in page.tags) == 1
    heading, title = page.words("h1"), page.words("title")
    assert re.search(r"\d", heading), f"no number in the heading: {heading}"
    plain = heading.replace("\N{NO-BREAK SPACE}", " ")
    assert title.replace("\N{NO-BREAK SPACE}", " ").startswith(plain), (title, plain)
    missing = [number for number in numbers if not re.search(rf"(?<![\d.,]){re.escape(number)}(?!\d)", plain)]
    assert missing == [], (plain, missing)


def _check_addresses(page: PageHtml, text: str) -> None:
    """Assert that nothing is loaded from elsewhere, ids are unique and links have a target."""
    targets = [
        value or "" for _, attributes in page.tags for name, value in attributes.items()
        if name in ADDRESSES or name.startswith("on")
    ]  # fmt: skip
    assert [target for target in targets if not target.startswith(("#", "data:"))] == []
    assert re.findall(r"url\((?!#)[^)]*\)|@import", text) == []
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = {value for tag, a in page.tags for name, value in a.items() if tag == "a" and name == "href"}
    assert {html.unescape(value or "")[1:] for value in links} <= set(ids)


def _check_grid(grid: Grid) -> None:
    """Assert that each row has a field for each heading, named for cards."""
    if grid.kind == "summary":
        return
    assert grid.layout, "a table outside of a box that scrolls or becomes cards"
    assert all(head.strip() for head in grid.heads) or len(grid.heads) == 2, grid.heads
    for row in grid.rows[1:]:
        assert len(row) == len(grid.heads)
        assert None not in row
