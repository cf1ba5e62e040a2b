"""Three papers recomputed by `reproduce`, as the tables of docs/reproduction.md.

python benchmarks/reproduction_page.py [--write]

A difference is "paper wrong" where a printed formula or count does not hold, "data missing" where what was
computed with is not printed, "we differ" where our model leaves out what was measured; an agreement is "ours
corrected" where it needs data that were corrected here.
"""

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from harness.turns import ROOT, draw_bars, find_about, markdown_head, markdown_row, publish, table_text

from tensegrity_codegen.report.pages.page import CAUSES

PAGE = "reproduction.md"
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


def write_tables(papers: Mapping[str, Sequence[Mapping[str, str]]]) -> list[str]:
    """Return Markdown: a chart and its table of verdicts, then a table for each paper."""
    counts = {PAPERS[name]: Counter(row["verdict"] for row in rows) for name, rows in papers.items()}
    rows = [(name, *(found[verdict] for verdict in WORDS)) for name, found in counts.items()]
    parts = [draw_bars("paper", ", ".join(WORDS.values())), table_text(("paper", *WORDS.values()), rows)]
    for name, results in papers.items():
        lines = [f"## {PAPERS[name]}", "", HEAD]
        for row in results:
            finding = ": ".join(filter(None, (WORDS[row["verdict"]], CAUSES.get(row["cause"]))))
            cells = (row["source"], row["title"], finding, row["result"])
            lines.append(markdown_row(*(cell.replace("|", "\\|") for cell in cells)))
        parts.append("\n".join(lines))
    return parts


def main() -> None:
    """Recompute the papers, and write the page if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"write docs/{PAGE}")
    chosen = parser.parse_args()
    folder = ROOT / "output" / "reproduction"
    command = [sys.executable, "-m", "tensegrity_codegen", "reproduce", "all", "--out", str(folder), "--json"]
    done = subprocess.run([*command, "--overwrite"], stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    publish(PAGE, found["finding"], *write_tables(found["papers"]), find_about(__doc__), write=chosen.write)


if __name__ == "__main__":
    main()
