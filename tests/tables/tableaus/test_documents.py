"""The table of explicit methods in the documentation is that of the records."""

import re
from pathlib import Path

from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.tableaus import EXPLICIT

PAGE = Path(__file__).resolve().parents[3] / "docs" / "embedding.md"
PLACE = re.compile(r"(<!-- explicit methods: .*? -->\n).*?(<!-- end of explicit methods -->)", re.DOTALL)


def table() -> str:
    rows = [
        f"| `{name}` | {item.title} | {item.order} | {item.stages} | {INTEGRATORS[name].dense_title} "
        f"| {item.source} |"
        for name, item in EXPLICIT.items()
    ]
    head = "| name | method | order | evaluations a step | samples between steps by | source |"
    return "".join(f"{line}\n" for line in (head, "|---" * 6 + "|", *rows))


def test_the_table_of_explicit_methods_is_written_from_the_records(update_golden: bool) -> None:
    text = PAGE.read_text(encoding="utf-8")
    expected = PLACE.sub(lambda found: found[1] + table() + found[2], text)
    if update_golden:
        PAGE.write_text(expected, encoding="utf-8", newline="\n")
    assert PAGE.read_text(encoding="utf-8") == expected, "run this test with --update-golden"
    assert table() in expected
