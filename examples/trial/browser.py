"""Serve a folder and open its page in a browser without a window: `python browser.py FOLDER MOTOR`.

Prints the lines of the page; exit code 1 where the page shows an error, which goes to stderr.
"""

import contextlib
import functools
import html
import http.server
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import urllib.parse
from collections.abc import Iterator
from pathlib import Path

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    "--virtual-time-budget=10000",
)
TIME_LIMIT = 120.0  # s


def find_browser() -> str | None:
    """Return the command of an installed browser, None if there is none."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *arguments: object) -> None:
        """Print no line for each request."""


@contextlib.contextmanager
def serve(folder: Path) -> Iterator[str]:
    """Serve a folder on a free port of this machine; the value is its address."""
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def read_page(browser: str, address: str, *options: str) -> str:
    """Return the document of a page after its scripts have run."""
    with tempfile.TemporaryDirectory() as profile:
        done = subprocess.run(
            [browser, *OPTIONS, *options, f"--user-data-dir={profile}", "--dump-dom", address],
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT,
            check=True,
        )
    return done.stdout


def read_text(document: str, name: str) -> str:
    """Return the text of the element with this id."""
    found = re.search(rf'<(\w+) id="{name}"[^>]*>(.*?)</\1>', document, re.DOTALL)
    return html.unescape(found[2]).strip() if found else ""


def main(folder: str, motor: str) -> int:
    """Print the lines of the page with this value of the motor; return the exit code."""
    browser = find_browser()
    if browser is None:
        sys.exit(f"none of these browsers is installed: {', '.join(BROWSERS)}")
    query = urllib.parse.urlencode({"motor": motor})
    with serve(Path(folder)) as address:
        document = read_page(browser, f"{address}/index.html?{query}")
    print(read_text(document, "rows"))
    error = read_text(document, "error")
    if error or 'id="done" hidden' in document:
        print(error or "the page did not come to its end", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
