"""A page as a real browser shows it: Debian's chromium without a window, found on the machine or not."""

import html
import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--enable-logging=stderr", "--virtual-time-budget=10000", "--window-size=1600,1000"),
)
# The page stands in a frame of the wanted width; this script, outside of it, measures what it shows.
WRAPPER = """<!doctype html><meta charset="utf-8"><title>wrapper</title>
<iframe id="frame" style="border:0;width:{width}px;height:900px" srcdoc="{page}"></iframe>
<script>
document.getElementById("frame").addEventListener("load", event => {{
  const page = event.target.contentDocument, root = page.documentElement;
  page.querySelectorAll("details").forEach(item => {{ item.open = true; }});
  const box = item => item.getBoundingClientRect();
  const ids = [...page.querySelectorAll("[id]")].map(item => item.id);
  const visible = item => box(item).width > 0 && box(item).height > 0;
  const images = [...page.images], drawings = [...page.querySelectorAll("figure svg")];
  const found = {{
    title: page.title,
    width: root.clientWidth,
    content_width: root.scrollWidth,
    figures: page.querySelectorAll("figure").length,
    images: images.length,
    images_shown: images.filter(item => item.complete && item.naturalWidth > 0 && visible(item)).length,
    drawings: drawings.length,
    drawings_shown: drawings.filter(item => visible(item) && item.querySelectorAll("path").length).length,
    tables: page.querySelectorAll("main .scroll table").length,
    tables_shown: [...page.querySelectorAll("main .scroll table")].filter(visible).length,
    doubled_ids: ids.filter((id, place) => ids.indexOf(id) !== place),
    lost_links: [...page.querySelectorAll("a")].map(item => item.getAttribute("href"))
      .filter(target => !target.startsWith("#") || !page.getElementById(target.slice(1))),
    outside: [...page.querySelectorAll("main > *, main section > *")]
      .filter(item => box(item).right > root.clientWidth + 1).map(item => item.className || item.tagName),
  }};
  const result = document.createElement("pre");
  result.id = "found";
  result.textContent = JSON.stringify(found);
  document.body.append(result);
}});
</script>
"""


def find_browser() -> str | None:
    """Return the command of an installed browser, None if there is none."""
    return next(filter(None, map(shutil.which, NAMES)), None)


def open_page(page: Path, width: int) -> dict[str, Any]:
    """Return what the page shows at a width [px]; `console` holds what the browser's console said."""
    browser = find_browser()
    assert browser is not None
    with tempfile.TemporaryDirectory() as folder:
        wrapper = Path(folder) / "wrapper.html"
        text = html.escape(page.read_text(encoding="utf-8"), quote=True)
        wrapper.write_text(WRAPPER.format(width=width, page=text), encoding="utf-8")
        done = subprocess.run(
            [browser, *OPTIONS, f"--user-data-dir={folder}/profile", "--dump-dom", wrapper.as_uri()],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, done.stderr
    result: dict[str, Any] = json.loads(html.unescape(found[1]))
    return result | {"console": re.findall(r".*:CONSOLE.*", done.stderr)}
