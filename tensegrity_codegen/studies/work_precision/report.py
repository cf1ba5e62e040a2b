"""A report: recommendations, pictures of error against time, all rows; as a page, a table and a data file."""

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, choose_styles, method_series
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Command,
    Figure,
    Page,
    Paragraph,
    Section,
    diagram_figure,
    render_page,
)
from tensegrity_codegen.report.pages.page_table import make_table
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.study import prepare_study
from tensegrity_codegen.studies.work_precision.measure import (
    EQUATIONS,
    Row,
    find_fastest,
    find_front,
    set_problem,
)
from tensegrity_codegen.studies.work_precision.scene_report import (
    Options,
    SceneReport,
    compare_scene,
    describe_finding,
    describe_rows,
    open_journal,
    report_scene,
)
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.extras import require_plot
from tensegrity_codegen.system.journal import Resumption
from tensegrity_codegen.system.output_folder import write_folder
from tensegrity_codegen.system.progress import part_of
from tensegrity_codegen.system.provenance import describe_provenance

MAX_BEST = 8  # runs of a long table that are always visible
SHOWN = 1e1  # errors above are not drawn [m]
LEAD = (
    "Time is CPU time of the whole motion on one core, without building the library: of integration in C "
    "alone, but for 'simulate, auto', the call in Python that also checks its error. Error is the largest "
    "difference of a node coordinate to a reference that two methods certify."
)
PEERS = (
    "Median of five runs or more a setting. MuJoCo and SUNDIALS step in compiled code, called through their "
    "Python packages. MuJoCo takes elastic bars as springs and, (rigid bars), as rigid bodies. CVODE (C) of "
    "SUNDIALS evaluates our accelerations in C for this machine; CVODES and IDAS, through CasADi, these and "
    "their Jacobian, above 400 members the Jacobian by CasADi's virtual machine; SciPy calls our compiled "
    "accelerations from Python. After three tolerances or steps a setting of another program is tightened no "
    "further where another setting of it takes half the time for no larger error."
)


def build_page(reports: Sequence[SceneReport]) -> Page:
    """Return the page of some scenes."""
    names = ", ".join(report.problem.structure.name for report in reports)
    return Page(
        title=describe_finding([compare_scene(report) for report in reports]),
        subject=f"Error against run time of {names}",
        lead=f"{describe_rows(reports)} {LEAD}",
        chapters=tuple(_chapter(report, f"scene{number}") for number, report in enumerate(reports)),
        facts=(*describe_provenance(), PEERS),
        summary_heads=("part", "what", "result"),
    )


def say_recommendation(max_error: float, row: Row | None, t_end: float) -> str:
    """Return one plain sentence: the recommendation for an error of `max_error` [m]."""
    if row is None:
        return f"for {max_error:.0e} m: no method reaches it"
    name = "step" if row.kind == "step" else "rtol"
    setting = row.setting * t_end if row.kind == "step" else row.setting
    return (
        f"for {max_error:.0e} m: {row.formulation}, {row.method}, {name} {setting:.2g}: "
        f"{1e3 * row.seconds / t_end:.3g} ms a simulated second"
    )


def _chapter(report: SceneReport, anchor: str) -> Chapter:
    structure = report.problem.structure
    kicked = (
        " The scene is at rest: its nodes start with speeds that stretch no bar."
        if report.problem.is_kicked
        else ""
    )
    return Chapter(
        anchor=anchor,
        name=structure.name,
        title=f"{structure.n_members} members, {report.problem.t_end:g} s",
        citation=f"{structure.n_nodes} nodes, {structure.n_coordinates} free coordinates.{kicked}",
        sections=(
            _advice(report, anchor),
            _pictures(report, anchor),
            _all_rows(report, anchor),
            _who(report, anchor),
        ),
    )


def _advice(report: SceneReport, anchor: str) -> Section:
    t_end = report.problem.t_end
    chosen = [row for row in report.recommendations.values() if row is not None]
    best = say_recommendation(1e-6, report.recommendations[1e-6], t_end)
    table = make_table(
        "The fastest of our methods for an error, and the fastest other program",
        {"error wanted [m]": ".0e", "formulation": "", "method": "", "setting": ".1e", "error [m]": ".1e"}
        | {"CPU time [ms/s]": ".3g", "fastest other program": "", "its CPU time [ms/s]": ".3g"}
        | {"its time over ours": ".3g", "its bars": "", "ours with these": ""}
        | {"its time over that": ".3g"},
        (_advice_row(max_error, row, report) for max_error, row in report.recommendations.items()),
        note="The setting is the relative tolerance, or the step over the whole time. ms/s: milliseconds a "
        "simulated second. Bars: those of the scene, or rigid ones in their "
        "place, which some formulations correct by their stretch to first order.",
    )
    result = best if chosen else "no method reaches any of these errors"
    verb = f"tensegrity-codegen simulate {report.problem.structure.name}.toml "
    runs: dict[str, list[str]] = {}
    for run in dict.fromkeys(map(report.describe_simulation, chosen)):
        options, _, keys = run.partition(", with ")
        runs.setdefault(f"# {keys}", []).append(verb + options.removeprefix("simulate "))
    commands = "\n".join("\n".join([keys, *lines]) for keys, lines in runs.items())
    same: list[Block] = [Paragraph("These commands repeat the runs:"), Command(commands)] if runs else []
    return Section(f"{anchor}-advice", "", "What to use", "plain", result, (table, *same))


def _advice_row(max_error: float, row: Row | None, report: SceneReport) -> tuple[float | str | None, ...]:
    t_end = report.problem.t_end
    peer = find_fastest(report.rows, max_error, "peer")
    own_cells = (row.formulation, row.method, row.setting, row.error) if row else ("none", "", None, None)
    own_time = None if row is None else 1e3 * row.seconds / t_end
    if peer is None:
        return (max_error, *own_cells, own_time, "none", *[None] * 2, "", "none", None)
    alike = find_fastest(report.rows, max_error, "own", peer.replaces_bars)
    ratios = [None if candidate is None else peer.seconds / candidate.seconds for candidate in (row, alike)]
    like = (EQUATIONS[peer.replaces_bars], alike.contender if alike else "none", ratios[1])
    return (max_error, *own_cells, own_time, peer.contender, 1e3 * peer.seconds / t_end, ratios[0], *like)


def _pictures(report: SceneReport, anchor: str) -> Section:
    own_rows = [row for row in report.rows if row.group == "own"]
    peers = [row for row in report.rows if row.group == "peer"]
    formulations = list(dict.fromkeys(row.formulation for row in own_rows if row.is_good))
    best = {name: find_front([row for row in own_rows if row.formulation == name]) for name in formulations}
    figures = [_figure(best, report, f"{anchor}-own", "our formulations, each by the best of its methods")]
    if peers:
        best_peers = {name: find_front(rows) for name, rows in _by(peers, "program").items()}
        groups = {"ours, the fastest of all": find_front(own_rows), **best_peers}
        caption = "our fastest runs and other programs, each by the fastest of its methods and settings"
        figures.insert(0, _figure(groups, report, f"{anchor}-peers", caption))
    for number, name in enumerate(formulations):
        rows = _by([row for row in own_rows if row.formulation == name], "method")
        figures.append(_figure(rows, report, f"{anchor}-methods{number}", f"{name} by every method"))
    return Section(
        f"{anchor}-pictures", "", "Error against CPU time", "plain",
        f"{len(report.front)} of {len(report.rows)} runs are beaten by no other in both error and time",
        tuple(figures),
    )  # fmt: skip


def _by(rows: Sequence[Row], attribute: str) -> dict[str, list[Row]]:
    """Return rows by an attribute of theirs."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(getattr(row, attribute), []).append(row)
    return groups


def _figure(groups: Mapping[str, Sequence[Row]], report: SceneReport, name: str, what: str) -> Figure:
    """Return errors over times of groups of rows that came to their end, the titles being the groups'."""
    floor = max(report.reference.uncertainty, 1e-17)
    shown = {
        title: [row for row in rows if row.is_good and row.error < SHOWN] for title, rows in groups.items()
    }
    styles = choose_styles(shown)
    series = [
        method_series(
            title, [1e3 * row.seconds for row in rows], [max(row.error, floor) for row in rows], styles[title]
        )
        for title, rows in shown.items()
        if rows
    ]
    diagram = Diagram(
        "CPU time [ms]", "largest error of a coordinate [m]", series, log_x=True, log_y=True,
        horizontal=((floor, ""),), legend_columns=2,
    )  # fmt: skip
    caption = f"{report.problem.structure.name}: {what}; down and left is better"
    dotted = f"Dotted: to what the reference is certified, {format_number(floor, '.1e')} m."
    return diagram_figure(
        name, diagram, f"{caption}. {dotted}", f"Error against CPU time, logarithmic: {what}."
    )


def _all_rows(report: SceneReport, anchor: str) -> Section:
    columns = {"method or program": "", "setting": ".1e", "error [m]": ".1e", "CPU time [ms]": ".3g"}
    columns |= {"steps": "d", "evaluations": "d", "energy drift [J]": ".1e", "length error [m]": ".1e"}
    rows = [
        (
            *(row.contender, row.setting, row.error if np.isfinite(row.error) else None, 1e3 * row.seconds),
            *(row.n_steps or "–", row.n_evaluations or "–", row.energy_drift, row.length_error),
            row.status.replace("_", " "),
        )
        for row in report.rows
    ]
    best = sorted(report.front, key=lambda row: row.error)
    table = make_table(
        "Every run", columns | {"status": ""}, rows,
        note="A dash: not known, or this motion does not keep it.",
        head=tuple(report.rows.index(row) for row in best[:MAX_BEST]),
        head_note=f"{min(len(best), MAX_BEST)} of the {len(best)} that no other beats in error and time",
    )  # fmt: skip
    bad = sum(not row.is_good for row in report.rows)
    return Section(
        f"{anchor}-rows", "", "Everything measured", "plain",
        f"{len(rows)} runs, {bad} of which did not reach the end", (table,),
    )  # fmt: skip


def _who(report: SceneReport, anchor: str) -> Section:
    reference = report.reference
    text = (
        f"The reference is {reference.first}; {reference.second} agrees with it to "
        f"{format_number(reference.uncertainty, '.1e')} m at all samples."
    )
    blocks: list[Block] = [Paragraph(text)]
    if report.absent:
        columns = {"method or program": "", "why it is not measured": ""}
        caption = "Methods and programs without runs"
        blocks.append(make_table(caption, columns, report.absent.items(), folded="Not measured"))
    return Section(
        f"{anchor}-who", "", "The reference, and what is not measured", "plain",
        f"certified to {format_number(reference.uncertainty, '.1e')} m", tuple(blocks),
    )  # fmt: skip


PAGE_NAME, TABLE_NAME, DATA_NAME = "report.html", "report.csv", "report.json"
MAX_SAMPLES = 100_000


@dataclass(frozen=True)
class WorkReport:
    """The measurements, and the files that hold them."""

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
                f"{report.problem.structure.name}: {say_recommendation(max_error, row, report.problem.t_end)}"
                for max_error, row in chosen.items()
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
    asked for again goes on from there, unless `fresh`; `notice` is called with what is taken.
    """
    if not 2 <= samples <= MAX_SAMPLES:
        raise InvalidValueError("out of range", where="samples", given=samples, allowed=f"2 to {MAX_SAMPLES}")
    require_plot()
    prepare_study(structures, t_end, folder, (PAGE_NAME, TABLE_NAME, DATA_NAME), overwrite=overwrite)
    reports = []
    for number, structure in enumerate(structures):
        move = part_of(progress, number / len(structures), 1.0 / len(structures))
        problem = set_problem(structure, t_end, samples)
        journal = open_journal(problem, options, folder / "journal", fresh=fresh, notice=notice)
        reports.append(report_scene(problem, options, journal, move))
    page = render_page(build_page(reports))
    report = WorkReport(tuple(reports), folder / PAGE_NAME, folder / TABLE_NAME, folder / DATA_NAME)
    data = json.dumps(report.as_dict(), indent=1, allow_nan=False) + "\n"
    files = {PAGE_NAME: page, TABLE_NAME: _csv(reports), DATA_NAME: data}
    write_folder(folder, {name: text.encode("utf-8") for name, text in files.items()}, overwrite=overwrite)
    return report


def _csv(reports: Sequence[SceneReport]) -> str:
    names = [field.name for field in fields(Row)]
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
