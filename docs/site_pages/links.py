"""Links of a Markdown file, as a page of the site needs them.

In the repository a link leads to any file. The site has pages: a link to a file that is no page becomes the
name of the file, and one to a folder with a README.md leads to its page.
"""

import posixpath
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Files outside of docs/ that are pages.
PAGES = {
    "README.md": "docs/overview.md",
    "CONTRIBUTING.md": "docs/contributing.md",
    "CHANGELOG.md": "docs/changes.md",
    "examples/README.md": "docs/languages/README.md",
    "examples": "docs/languages/README.md",
}
FENCE = re.compile(r"(^```.*?^```$)", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
CODE = re.compile(r"(`[^`\n]+`)")


def point_links(text: str, origin: str, page: str) -> str:
    """Return Markdown of the file `origin`, with links that hold on `page`; both paths from the root."""

    def point(link: re.Match[str]) -> str:
        return _point(link[1], link[2], link[3], origin, page)

    parts = FENCE.split(text)
    for place in range(0, len(parts), 2):
        parts[place] = LINK.sub(point, parts[place])
    return "".join(parts)


def _point(image: str, words: str, target: str, origin: str, page: str) -> str:
    if re.match(r"[a-z]+:|#", target):
        return f"{image}[{words}]({target})"
    path, mark, anchor = target.partition("#")
    found = posixpath.normpath(posixpath.join(posixpath.dirname(origin), path))
    found = PAGES.get(found, found)
    if (ROOT / found).is_dir() and (ROOT / found / "README.md").exists():
        found = f"{found}/README.md"
    if found == page:
        return words
    if found.startswith("docs/") or not (ROOT / found).exists():
        relative = posixpath.relpath(found, posixpath.dirname(page))
        return f"{image}[{words}]({relative}{mark}{anchor})"
    return words if CODE.search(words) or words != path else f"`{words}`"
