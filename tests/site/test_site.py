"""The documentation site, built: no warning, links, search, widths in a browser, light and dark."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tests.live.pages import require_three
from tests.report.browser import find_browser
from tests.report.driver import Tab, running_browser

ROOT = Path(__file__).resolve().parents[2]
pytestmark = [pytest.mark.thorough, pytest.mark.timeout(1200)]
in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")
LOADED = "document.readyState === 'complete'"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for name in ("sphinx", "myst_parser", "numpydoc", "furo"):
        pytest.importorskip(
            name, reason=f"{name} is not installed: pip install '.[docs]'", exc_type=ImportError
        )
    require_three()  # the gallery's pages contain it
    folder = tmp_path_factory.mktemp("docs") / "site"
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "build_site.py"), "--out", str(folder)],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr
    assert re.search(r"\d+ pages in \d+ s", done.stdout)
    return folder


class Page(HTMLParser):
    """What a page links to, and the places in it that a link can lead to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for key, value in attributes:
            if key in ("href", "src") and value:
                self.links.append(value)
            if key in ("id", "name") and value:
                self.places.add(value)


def test_every_link_leads_somewhere(site: Path) -> None:
    pages = {path: Page(path) for path in site.rglob("*.html")}
    assert len(pages) > 90
    lost = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or link == "#":
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            if not target.exists() or (place and target in pages and place not in pages[target].places):
                lost.append((path.relative_to(site).as_posix(), link))
    assert lost == []


@in_browser
@pytest.mark.parametrize("word", ["slack", "wasm", "buckling"])
def test_the_search_finds(site: Path, word: str) -> None:
    with running_browser() as browser:
        tab = Tab(browser, 1400, 900, "light")
        tab.send("Page.navigate", url=f"{(site / 'search.html').as_uri()}?q={word}")
        tab.wait("document.querySelectorAll('#search-results li a').length > 0")
        found = tab.ask("[...document.querySelectorAll('#search-results li a')].map(a => a.pathname)")
        assert tab.requests() == []
    assert all(Path(unquote(name)).exists() for name in found)
    texts = [re.sub(r"<[^>]+>", "", Path(unquote(name)).read_text(encoding="utf-8")) for name in found]
    assert any(word in text.lower() for text in texts)


@in_browser
def test_no_page_is_wider_than_a_phone(site: Path) -> None:
    wide = {}
    with running_browser() as browser:
        tab = Tab(browser, 400, 800, "light")
        for path in sorted(site.rglob("*.html")):
            tab.send("Page.navigate", url=path.as_uri())
            tab.wait(f"location.pathname === {path.as_uri()[7:]!r} && {LOADED}")
            width = tab.ask("document.scrollingElement.scrollWidth")
            if width > 400:
                wide[path.relative_to(site).as_posix()] = width
        assert tab.requests() == []
    assert wide == {}


@in_browser
def test_pages_are_light_or_dark_as_the_reader_prefers(site: Path) -> None:
    shades = {}
    with running_browser() as browser:
        for scheme in ("light", "dark"):
            tab = Tab(browser, 400, 800, scheme)
            tab.open(site / "model.html", LOADED)
            color = tab.ask("getComputedStyle(document.body).backgroundColor")
            shades[scheme] = sum(map(int, re.findall(r"\d+", color)[:3]))
    assert shades["light"] > 600 > 150 > shades["dark"]
