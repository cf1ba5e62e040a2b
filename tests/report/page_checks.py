"""Checks of every page of results: `check_static` reads its text, `check_in_browser` opens it."""

import re
from pathlib import Path
from typing import Any

import pytest

from tests.report.browser import find_browser
from tests.report.driver import Browser, Tab, running_browser

PROBE = Path(__file__).with_name("page_probe.js")
NO_BROWSER = "no chromium is installed: install the package `chromium`"


def in_browser(function: Any) -> Any:
    """Mark a test that opens pages in a browser: thorough, and skipped where there is none."""
    marked = pytest.mark.skipif(find_browser() is None, reason=NO_BROWSER)(function)
    return pytest.mark.thorough(marked)


def check_in_browser(page: Path, numbers: list[str]) -> None:
    """Assert that a browser shows all of a page at 400 and 1,400 px, in light and in dark.

    Nothing is written to the console, nothing is loaded, no window scrolls sideways, each column of each
    table can be reached, no name or number in them is broken, words have the contrast of WCAG 2 (4.5, large
    ones 3), and the heading states `numbers`.
    """
    with running_browser() as browser:
        for width in (400, 1400):
            light = _check(probe_page(browser, page, width, "light"), numbers)
            dark = _check(probe_page(browser, page, width, "dark"), numbers)
            assert light["paper"] > 0.8
            assert dark["paper"] < 0.05


def probe_page(browser: Browser, page: Path, width: int, scheme: str) -> dict[str, Any]:
    """Return what a page shows, with the complaints of the console and the requests."""
    tab = Tab(browser, width, 900, scheme)
    tab.open(page, "document.readyState === 'complete'")
    found: dict[str, Any] = tab.ask(f"(() => {{ {PROBE.read_text(encoding='utf-8')} }})()")
    return found | {"complaints": tab.complaints(), "requests": tab.requests(), "at": (width, scheme)}


def _check(found: dict[str, Any], numbers: list[str]) -> dict[str, Any]:
    for name in ("complaints", "requests", "weak", "hidden", "unhinted", "unnamed", "broken"):
        assert found[name] == [], (name, found)
    assert found["overflow"] <= 0, found
    assert found["unseen"] == found["lost"] == 0, found
    heading = found["heading"].replace("\N{NO-BREAK SPACE}", " ")
    assert found["title"].replace("\N{NO-BREAK SPACE}", " ").startswith(heading.strip())
    for number in numbers:
        assert re.search(rf"(?<![\d.,]){re.escape(number)}(?!\d)", heading), (number, heading)
    return found
