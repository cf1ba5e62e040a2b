"""What a run leaves behind: Markdown, JSON, CSV, pictures, and one page that holds all of it."""

from __future__ import annotations

import base64
import dataclasses
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.acceptance import Line
from harness.floor import Floor
from harness.pictures import draw_all
from harness.session import Row
from harness.summary import summary_sections
from harness.tables import (
    HEADINGS,
    acceptance_cells,
    csv_text,
    floor_cells,
    gather_untimed,
    growth_cells,
    markdown_table,
    row_cells,
)

__all__ = ["Report", "write_report"]

Cells = Sequence[Sequence[str]]

STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:75rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse;font-size:13px;margin:.5rem 0 1.5rem}td,th{padding:.15rem .6rem;"
    "border-bottom:1px solid #ddd;text-align:left}td{font-variant-numeric:tabular-nums}"
    "img{max-width:100%}pre{background:#f6f6f6;padding:.6rem;overflow:auto}"
)


@dataclass
class Report:
    """All that a run found; machine: what -> value; scripts: title -> text of the other scripts."""

    machine: dict[str, str]
    rows: list[Row]
    lines: list[Line]
    floor: Floor | None
    large: Mapping[int, Mapping[str, Any]]
    scripts: dict[str, str] = field(default_factory=dict)

    def sections(self) -> list[tuple[str, Cells]]:
        """Return title and cells of every table."""
        found: list[tuple[str, Cells]] = [
            ("Machine", [["what", "value"], *([k, v] for k, v in self.machine.items())]),
            ("Asked, measured, holds", acceptance_cells(self.lines)),
        ]
        if self.floor is not None:
            found.append(("Floor of this core", floor_cells(self.floor)))
        found += summary_sections(self.rows)
        for structure, members, quantity in dict.fromkeys(
            (row.structure, row.members, row.quantity) for row in self.rows
        ):
            chosen = [r for r in self.rows if (r.structure, r.quantity) == (structure, quantity)]
            base = next((row.baseline for row in chosen if row.baseline), "")
            title = f"{structure}, {members:,} members: {quantity}"
            title += f"; times against {base}" if base else ""
            found.append((title, [list(HEADINGS), *(row_cells(row) for row in gather_untimed(chosen))]))
        found.append(("Growth: exponents over the towers", growth_cells(self.rows)))
        return found


def write_report(report: Report, folder: Path) -> list[Path]:
    """Write bench.md, bench.json, bench.csv, the pictures and bench.html into `folder`; return the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    sections = [(title, cells) for title, cells in report.sections() if len(cells) > 1]
    pictures = draw_all(folder, report.rows, report.floor)
    texts = {
        "bench.md": _markdown(sections, report.scripts),
        "bench.json": json.dumps(_data(report), indent=1) + "\n",
        "bench.csv": csv_text(dataclasses.asdict(row) for row in report.rows),
        "bench.html": _page(sections, pictures, report.scripts),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [*(folder / name for name in texts), *pictures]


def _data(report: Report) -> dict[str, Any]:
    return {
        "machine": report.machine,
        "acceptance": [dataclasses.asdict(line) for line in report.lines],
        "floor": report.floor.lanes if report.floor else None,
        "large": report.large,
        "rows": [dataclasses.asdict(row) | {"ns_member": row.ns_member} for row in report.rows],
        "scripts": report.scripts,
    }


def _markdown(sections: Sequence[tuple[str, Cells]], scripts: Mapping[str, str]) -> str:
    parts = ["# Benchmarks\n", *(f"## {title}\n\n{markdown_table(cells)}" for title, cells in sections)]
    parts += [f"## {title}\n\n```\n{text.strip()}\n```\n" for title, text in scripts.items()]
    return "\n".join(parts)


def _page(sections: Sequence[tuple[str, Cells]], pictures: Sequence[Path], scripts: Mapping[str, str]) -> str:
    """Return one page without any file beside it."""
    images = [base64.b64encode(path.read_bytes()).decode("ascii") for path in pictures]
    shown = [
        f'<p><img alt="{path.stem}" src="data:image/png;base64,{image}"></p>'
        for path, image in zip(pictures, images, strict=True)
    ]
    tables = [f"<h2>{html.escape(title)}</h2>{_table(cells)}" for title, cells in sections]
    texts = [f"<h2>{html.escape(t)}</h2><pre>{html.escape(text)}</pre>" for t, text in scripts.items()]
    head = '<!doctype html><html lang="en"><meta charset="utf-8"><title>Benchmarks</title>'
    head += f"<style>{STYLE}</style>"
    return "\n".join([head, "<h1>Benchmarks</h1>", *tables[:3], *shown, *tables[3:], *texts, "</html>", ""])


def _table(cells: Cells) -> str:
    kept = [k for k in range(len(cells[0])) if any(row[k] for row in cells[1:])]
    rows = [
        "<tr>" + "".join(f"<{tag}>{html.escape(row[k])}</{tag}>" for k in kept) + "</tr>"
        for tag, row in [("th", cells[0]), *(("td", row) for row in cells[1:])]
    ]
    return f"<table>{''.join(rows)}</table>"
