"""Build the documentation site: python docs/build_site.py --out output/site

Needs the extra `[docs]`. A warning of Sphinx is an error: exit code 1.
"""

import argparse
import importlib.util
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
NEEDED = ("sphinx", "myst_parser", "numpydoc", "furo")


def main(arguments: Sequence[str] | None = None) -> int:
    """Build all pages, and print how long it took."""
    parser = argparse.ArgumentParser(description="Build the documentation site.")
    parser.add_argument(
        "--out", type=Path, default=Path("output/site"), help="folder of the pages (output/site)"
    )
    parser.add_argument("--verbose", action="store_true", help="show the progress of Sphinx")
    chosen = parser.parse_args(arguments)
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        print(f"not installed: {', '.join(missing)}; pip install '.[docs]'", file=sys.stderr)
        return 2
    from site_pages.live_pages import write_live_pages
    from sphinx.cmd.build import build_main

    began = time.monotonic()
    print("Sphinx writes the pages; without a cache that takes minutes (--verbose names them)", flush=True)
    quiet = [] if chosen.verbose else ["-q"]
    cache = chosen.out.parent / f".{chosen.out.name}-cache"
    jobs = ["-j", str(min(os.cpu_count() or 1, 4))]
    code = build_main(
        ["-W", "--keep-going", *quiet, *jobs, "-b", "html", "-d", str(cache), str(HERE), str(chosen.out)]
    )
    if code == 0:
        failed = write_live_pages(chosen.out, cache / "live_pages.json")
        if failed:
            print(f"no live page of: {', '.join(failed)}; see the errors above", file=sys.stderr)
            return 1
        pages = len(list(chosen.out.rglob("*.html")))
        print(f"{pages} pages in {time.monotonic() - began:.0f} s: {(chosen.out / 'index.html').resolve()}")
    return code


if __name__ == "__main__":
    sys.exit(main())
