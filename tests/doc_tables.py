"""Tables of the documentation that are written from records of the code."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
# What is generated in a page: from a mark to its end.
GENERATED = re.compile(r"<!-- ([\w ]+?)(?:: .*?)? -->\n.*?<!-- end of \1 -->", re.DOTALL)


def check_table(
    page: str, name: str, head: Sequence[str], rows: Iterable[Sequence[str]], write: bool
) -> None:
    """Compare the table between the comments of its name with what it should be; `write`: write it first."""
    path = DOCS / page
    place = re.compile(rf"(<!-- {name}: .*? -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    lines = [head, ["---"] * len(head), *rows]
    table = "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
    text = path.read_text(encoding="utf-8")
    expected = place.sub(lambda found: found[1] + table + found[2], text)
    assert table in expected, f"docs/{page} has no place for the table of {name}"
    if write:
        path.write_text(expected, encoding="utf-8", newline="\n")
    assert path.read_text(encoding="utf-8") == expected, "run this test with --update-golden"
