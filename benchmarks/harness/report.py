"""What a run leaves behind: Markdown, JSON, CSV, pictures, and one page that holds all of it."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.acceptance import Floor, Line
from harness.page import build_page, can_draw, draw_rates, draw_sizes, draw_times
from harness.session import Row
from harness.tables import (
    HEADINGS,
    comparison_cells,
    csv_text,
    describe_finding,
    describe_rows,
    floor_cells,
    gather_untimed,
    growth_cells,
    large_cells,
    markdown_table,
    row_cells,
    summary_sections,
)
from harness.turns import draw_bars, publish
from tensegrity_codegen.report.pages.page import render_page
from tensegrity_codegen.report.pictures.canvas import PAPER

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


PAGE = "benchmarks.md"
ROWS = """\
## What the rows are

- **Ours**: the C functions of generated libraries, called from C with all their checks, named by emitter,
  compiler and flag set (`reference`: to be bit-equal to CasADi's virtual machine, `native` is for this
  CPU). A batch evaluates 8 states in one call; its figures are for one state.
- **CasADi C**: C that CasADi writes, by `-O3 -march=native -fno-semantic-interposition`: the unrolled SX
  expression, our own expression where there are at most 100 members, or an MX `map` over the members with
  sparse sums. Without the last of these options gcc does not inline CasADi's small functions in a shared
  library. **CasADi VM**: its virtual machine.
- **NumPy**: whole arrays, summed by a sparse incidence matrix or by `add.at`. **numba**: one loop over the
  members with fast math. **JAX**: `jit` in double precision on one core. All three are called from Python,
  as their users do.
- **MuJoCo**: the same structure as point masses on slide joints and tendons with springs. `mj_forward`,
  called from C, computes more than the force, and no stiffness.

All structures have point masses and no damping, so that all programs state the same physics; the tower is a
stack of prisms on an anchored ring. Candidates take turns; ratios are medians over rounds. Floors are the
arithmetic of one member's force: all in registers, or from and to the level 1 cache, with square root and
division or with `rsqrt14` and two Newton steps. Tables of the other quantities, bytes and seconds to compile
are in `output/bench/bench.md`.
"""


def write_document(report: Report, *, write: bool) -> None:
    """Print the page, and write it if asked to."""
    kept = ("node_force: ns", "States", "node_force: bytes")
    sections: list[tuple[str, Sequence[Sequence[str]]]] = [
        ("Against the fastest other way", comparison_cells(report.rows)),
        *(item for item in summary_sections(report.rows) if item[0].startswith(kept)),
        ("From a scene to a loaded library", large_cells(report.large)),
        *([("Floor of this core", floor_cells(report.floor))] if report.floor else []),
        ("Machine", [["what", "value"], *([k, v] for k, v in report.machine.items() if k != "run")]),
    ]
    tables = [f"## {title}\n\n{markdown_table(cells)}" for title, cells in sections if len(cells) > 1]
    bars = draw_bars("structure, quantity", "its time over ours")
    about = f"{ROWS}\n{describe_rows(report.rows)}"
    publish(PAGE, describe_finding(report.rows), bars, *tables, about, write=write)
