"""Write the table of docs/reproduction.md from the result of `reproduce`.

tensegrity-codegen reproduce all --out output/reproduction --json > output/reproduction.json
python benchmarks/reproduction_page.py output/reproduction.json
"""

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.turns import ROOT, markdown_head, markdown_row, replace_figures

from tensegrity_codegen.report.pages.page import CAUSES

DOCUMENT = ROOT / "docs" / "reproduction.md"
BEGIN, END = "<!-- figures: benchmarks/reproduction_page.py -->", "<!-- end of figures -->"
PAPERS = {
    "sk": "Savin and Khusainov (S&K)",
    "lin": "Lin, Li, Ji and Che (LIN)",
    "scs": "Sultan, Corless and Skelton (SCS)",
}
WORDS = {
    "agrees": "agrees",
    "differs": "differs",
    "unstated": "no numbers printed",
    "new": "not in the paper",
}
HEAD = markdown_head("in the paper", "what", "finding", "in numbers")


def write_tables(finding: str, papers: Mapping[str, Sequence[Mapping[str, str]]]) -> str:
    """Return Markdown: the finding and counts, then a table for each paper."""
    counts = Counter(row["verdict"] for rows in papers.values() for row in rows)
    parts = [
        f"**{finding}.** For {counts['unstated']} results the paper prints no numbers, and {counts['new']} "
        "are not in the papers."
    ]
    for name, rows in papers.items():
        lines = [f"## {PAPERS[name]}", "", HEAD]
        for row in rows:
            finding = ": ".join(filter(None, (WORDS[row["verdict"]], CAUSES.get(row["cause"]))))
            cells = (row["source"], row["title"], finding, row["result"])
            lines.append(markdown_row(*(cell.replace("|", "\\|") for cell in cells)))
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def main(arguments: Sequence[str]) -> None:
    """Replace what stands between the two marks of the page."""
    found: dict[str, Any] = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    replace_figures(DOCUMENT, BEGIN, END, write_tables(found["finding"], found["papers"]))


if __name__ == "__main__":
    main(sys.argv[1:])
