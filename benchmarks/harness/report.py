"""What a run leaves behind: Markdown, JSON, CSV, pictures, and one page that holds all of it."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.acceptance import Line
from harness.comparison import comparison_cells
from harness.floor import Floor
from harness.page import build_page
from harness.pictures import can_draw, draw_rates, draw_sizes, draw_times
from harness.session import Row
from harness.summary import large_cells, summary_sections
from harness.tables import (
    HEADINGS,
    csv_text,
    floor_cells,
    gather_untimed,
    growth_cells,
    markdown_table,
    row_cells,
)
from tensegrity_codegen.report.pages.render_page import render_page
from tensegrity_codegen.report.pictures.palette import PAPER

Cells = Sequence[Sequence[str]]
DPI = 120


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
            ("Against the fastest other way", comparison_cells(self.rows)),
        ]
        found.append(("From a scene to a loaded library", large_cells(self.large)))
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
    page = build_page(report.rows, report.machine, report.floor, report.large, report.scripts)
    texts = {
        "bench.md": _markdown(sections, report.scripts),
        "bench.json": json.dumps(_data(report), indent=1) + "\n",
        "bench.csv": csv_text(dataclasses.asdict(row) for row in report.rows),
        "bench.html": render_page(page),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [*(folder / name for name in texts), *_save_pictures(report, folder)]


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


def _save_pictures(report: Report, folder: Path) -> list[Path]:
    """Write the pictures of the page as PNG too; return their paths, none without matplotlib."""
    if not can_draw():
        return []
    quantities = dict.fromkeys(row.quantity for row in report.rows)
    drawings = [
        *(drawing for name in quantities for drawing in draw_times(report.rows, name, report.floor)),
        *draw_sizes(report.rows),
        *draw_rates(report.rows),
    ]
    paths = [folder / f"{drawing.name}.png" for drawing in drawings]
    for path, drawing in zip(paths, drawings, strict=True):
        drawing.figure.savefig(path, dpi=DPI, facecolor=PAPER)
    return paths
