"""Scenes measured and written down: one page, one table of values, one data file."""

import csv
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tensegrity_codegen.report.pages.render_page import render_page
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.study import prepare_study
from tensegrity_codegen.studies.work_precision.measure import Row, set_problem
from tensegrity_codegen.studies.work_precision.page import build_page, say_recommendation
from tensegrity_codegen.studies.work_precision.scene_report import (
    Options,
    SceneReport,
    open_journal,
    report_scene,
)
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.extras import require_plot
from tensegrity_codegen.system.output_folder import write_folder
from tensegrity_codegen.system.progress import part_of
from tensegrity_codegen.system.resumption import Resumption

PAGE_NAME, TABLE_NAME, DATA_NAME = "report.html", "report.csv", "report.json"
MOST_SAMPLES = 100_000


@dataclass(frozen=True)
class WorkReport:
    """What was measured, and the files that it stands in."""

    scenes: tuple[SceneReport, ...]
    html: Path
    csv: Path
    data: Path

    def sentences(self) -> list[str]:
        """Return the recommendations of each scene, and how the verb simulate repeats these runs."""
        lines: list[str] = []
        for report in self.scenes:
            chosen = report.recommendations
            lines += [
                f"{report.problem.structure.name}: {say_recommendation(wanted, row, report.problem.t_end)}"
                for wanted, row in chosen.items()
            ]
            runs = dict.fromkeys(report.describe_simulation(row) for row in chosen.values())
            lines += [f"{report.problem.structure.name}: {run}" for run in runs if run]
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Return all values in JSON's types."""
        return {"scenes": [report.as_dict() for report in self.scenes]}


def write_report(
    structures: Sequence[Structure],
    folder: Path,
    *,
    t_end: float,
    samples: int,
    options: Options,
    progress: Callable[[float], None] | None = None,
    fresh: bool = False,
    overwrite: bool = False,
    notice: Callable[[Resumption], None] | None = None,
) -> WorkReport:
    """Measure the motions of some structures and write report.html, .csv and .json into `folder`.

    Rows go into a journal in the folder as soon as they are measured; a report that was interrupted and is
    asked for again goes on from there, unless `fresh`; `notice` is called with what is taken. Raises
    InvalidValueError for a time or number of samples out of range, DuplicateNameError for two scenes of one
    name, MissingExtraError without matplotlib, ConvergenceError where nothing certifies a reference,
    OutputError where files cannot be written or, without `overwrite`, exist.
    """
    if not 2 <= samples <= MOST_SAMPLES:
        raise InvalidValueError(
            "out of range", where="samples", given=samples, allowed=f"2 to {MOST_SAMPLES}"
        )
    require_plot()
    prepare_study(structures, t_end, folder, (PAGE_NAME, TABLE_NAME, DATA_NAME), overwrite=overwrite)
    reports = []
    for number, structure in enumerate(structures):
        move = part_of(progress, number / len(structures), 1.0 / len(structures))
        problem = set_problem(structure, t_end, samples)
        journal = open_journal(problem, options, folder / "journal", fresh=fresh, notice=notice)
        reports.append(report_scene(problem, options, journal, move))
    page = render_page(build_page(reports))
    found = WorkReport(tuple(reports), folder / PAGE_NAME, folder / TABLE_NAME, folder / DATA_NAME)
    data = json.dumps(found.as_dict(), indent=1, allow_nan=False) + "\n"
    files = {PAGE_NAME: page, TABLE_NAME: _csv(reports), DATA_NAME: data}
    write_folder(folder, {name: text.encode("utf-8") for name, text in files.items()}, overwrite=overwrite)
    return found


def _csv(reports: Sequence[SceneReport]) -> str:
    names = [item.name for item in fields(Row)]
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["scene", "t_end", *names])
    for report in reports:
        for row in report.rows:
            values = row.as_dict()
            writer.writerow(
                [report.problem.structure.name, report.problem.t_end, *(values[n] for n in names)]
            )
    return buffer.getvalue()
