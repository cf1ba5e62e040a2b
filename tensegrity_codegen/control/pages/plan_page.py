"""A plan as a page: outcome, shapes along the path, targets, rest lengths, tensions, what binds."""

import math
from collections.abc import Iterator

import numpy as np

from tensegrity_codegen.control.pages.plans import describe_extremes, describe_plan_finding
from tensegrity_codegen.report.analysis_page import tabulate_elongation
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.joined_series import choose_looks, joined_figure
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Figure,
    Page,
    Paragraph,
    Remark,
    Section,
    as_sentence,
    command_section,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import draw_motion, draw_picture, draw_tensions
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.records.plan_result import LIMIT_WORDS, Binding, PlanResult
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION

N_SHAPES = 4  # pictures of the path
MOST_LINES = 6  # in a diagram
LEAD = {
    "found": "Changes of rest lengths move the structure through stable equilibria to its target.",
    "blocked": "Changes of rest lengths move the structure through stable equilibria towards its target, "
    "until it is blocked. Another path may exist: this one proves nothing about others.",
    "infeasible": "It is proved that no plan reaches the target within the limits.",
}
POINTS = " Every point is an equilibrium within all limits. Tensions are positive, compressions negative."
STATUS = {"found": "target reached", "blocked": "path blocked", "infeasible": "target impossible"}
PROGRESS = "progress [%]"


def build_plan_page(found: PlanResult, structure: Structure, limits: Limits, command: str = "") -> Page:
    """Return the page of a plan.

    structure: what is drawn, its members first those of the plan (then edges of bodies); limits: those of
    the members of the plan; command: the command line that makes the page.
    """
    path: list[Section] = []
    if found.n_steps:
        path = [_shapes(found, structure), _targets(found), _rest_lengths(found)]
        path += build_limit_sections(found, limits)
    sections = (
        _outcome(found),
        *_proof(found, structure),
        *path,
        *([command_section(command)] if command else []),
    )
    counts = (
        f"{describe_count(len(found.node_name), 'node')}, "
        f"{describe_count(len(found.member_name), 'member')}, "
        f"{describe_count(len(found.actuator_name), 'actuator')}"
    )
    return Page(
        subject=f"Plan of {structure.name}",
        title=describe_plan_finding(found, limits),
        lead=LEAD[found.status] + (POINTS if found.n_steps else ""),
        chapters=(Chapter("plan", structure.name, STATUS[found.status], f"{counts}.", sections),),
        facts=(f"tensegrity_codegen {VERSION}.", "Equations, signs and statuses: docs/planning.md."),
        summary_heads=("part", "what", "result"),
    )


def _outcome(found: PlanResult) -> Section:
    rows = tuple(
        (
            text_cell(name),
            *(number_cell(value, ".6g") for value in (*_ends(found, k), float(found.goal[k]))),
            text_cell(found.target_unit[k]),
        )
        for k, name in enumerate(found.target_name)
    )
    heads = (Column("target", numeric=False), Column("start"), Column("reached"), Column("goal"))
    blocks: list[Block] = [Paragraph(as_sentence(found.message))]
    blocks += [Remark("differs", as_sentence(text)) for text in found.warnings]
    blocks.append(Table("Targets", (*heads, Column("unit", numeric=False)), rows))
    blocks += [Paragraph(as_sentence(text)) for text in describe_extremes(found)]
    if found.time is not None and found.n_steps:
        blocks.append(Paragraph(f"The plan takes {format_short(float(found.time[-1]))} s."))
    return Section("outcome", "all", "Outcome", "plain", STATUS[found.status], tuple(blocks))


def _ends(found: PlanResult, row: int) -> tuple[float | None, float | None]:
    if not len(found.target):
        return None, None
    return float(found.target[0, row]), float(found.target[-1, row])


def _shapes(found: PlanResult, structure: Structure) -> Section:
    rows = np.unique(np.linspace(0, found.n_steps, min(N_SHAPES, found.n_steps + 1)).round().astype(int))
    drawn = np.pad(
        found.member_tension,
        ((0, 0), (0, structure.n_members - found.member_tension.shape[1])),
        constant_values=np.nan,
    )
    among = (found.node_position[rows], drawn[rows])
    figures = []
    for row in rows:
        caption = f"Progress {format_short(100 * found.progress[row])} %: {_name_targets(found, int(row))}."
        picture = draw_tensions(
            structure, found.node_position[row], drawn[row], "member tension [N]", among=among
        )
        data = {"node_position": found.node_position[row].tolist()}
        figures.append(Figure(draw_picture(picture, f"shape{row}"), caption, caption, data))
    text = f"{len(figures)} of {found.n_steps + 1} points"
    return Section("shapes", "path", "Shapes along the path", "plain", text, tuple(figures))


def _name_targets(found: PlanResult, row: int) -> str:
    shown = [
        f"{name} {format_short(float(value), 4)} {unit}".strip()
        for name, value, unit in zip(found.target_name, found.target[row], found.target_unit, strict=True)
    ]
    return ", ".join(shown[:3]) + (f" and {len(shown) - 3} more" if len(shown) > 3 else "")


def _targets(found: PlanResult) -> Section:
    figures: list[Figure] = []
    for unit in dict.fromkeys(found.target_unit):
        rows = [k for k, other in enumerate(found.target_unit) if other == unit][:MOST_LINES]
        series = [
            Series(found.target_name[k], 100 * found.progress, found.target[:, k], color=n)
            for n, k in enumerate(rows)
        ]
        goals = dict.fromkeys(float(found.goal[k]) for k in rows)
        marks = tuple((goal, f"goal {format_short(goal, 4)} {unit}".rstrip()) for goal in goals)
        label = f"target [{unit}]" if unit else "target [SI]"
        diagram = Diagram(PROGRESS, label, series, horizontal=marks, legend_columns=2)
        caption = "Values of the targets along the path."
        figures.append(joined_figure(f"targets{len(figures)}", diagram, caption, caption))
    count = len(found.target_name)
    shown = _name_targets(found, -1)
    text = f"{shown} at the end" if count <= 3 else f"{count} values"
    return Section("targets", "targets", "Targets", "plain", text, tuple(figures))


def _rest_lengths(found: PlanResult) -> Section:
    moved = found.change - found.change[0]
    order = np.argsort(-np.abs(moved).max(axis=0), kind="stable")[:MOST_LINES]
    looks = choose_looks(found.actuator_name[k] for k in sorted(order))
    series = [
        Series(name, 100 * found.progress, 1000 * moved[:, found.actuator_name.index(name)], style, color)
        for name, (color, style) in looks.items()
    ]
    few = "" if len(found.actuator_name) <= MOST_LINES else f" of the {MOST_LINES} that move most"
    caption = f"Changes of rest lengths of the actuators{few}."
    diagram = Diagram(PROGRESS, "change of rest length [mm]", series)
    rows = tuple(
        (
            text_cell(name),
            number_cell(float(found.rest_length[0, k]), ".6f"),
            number_cell(float(found.rest_length[-1, k]), ".6f"),
            number_cell(1000 * float(moved[-1, k]), "+.3f"),
        )
        for k, name in enumerate(found.actuator_name)
    )
    columns = (
        Column("actuator", numeric=False),
        Column("start", "m"),
        Column("end", "m"),
        Column("change", "mm"),
    )
    text = f"largest change {format_short(1000 * float(np.abs(moved).max()))} mm"
    farthest = tuple(np.argsort(-np.abs(moved[-1]), kind="stable")[:8].tolist())
    table = Table("Rest lengths", columns, rows, head=farthest, head_note="those that change most")
    blocks = (joined_figure("rest", diagram, caption, text), table)
    return Section("rest-lengths", "actuators", "Rest lengths", "plain", text, blocks)


def _proof(found: PlanResult, structure: Structure) -> Iterator[Section]:
    proof = found.certificate
    if not isinstance(proof, Certificate):
        return
    text = f"{len(proof.shortening)} cables shorten, no cable lengthens, no bar changes its length"
    why = Paragraph(
        "Tensions t that balance loads f satisfy t . e = f . d in all displacements d, where e = A^T d are "
        "the changes of length. In these displacements f . d is zero or positive, and t . e zero or negative "
        "as no cable is in compression. One of them is not zero where the cables that must be in tension "
        "are: so there are no such tensions at this shape."
    )
    blocks: list[Block] = [why]
    if found.proof_position is not None and found.proof_displacement is not None:
        picture = draw_motion(structure, found.proof_position, found.proof_displacement)
        data = {"displacement": found.proof_displacement.tolist()}
        blocks.append(Figure(draw_picture(picture, "proof"), f"The motion, enlarged: {text}.", text, data))
    blocks.append(tabulate_elongation(proof, found.member_name, "+.9f"))
    yield Section("proof", "proof", "Why there is no plan", "plain", text, tuple(blocks))


# Sections of the page of a plan about its limits: tensions, clearance, stability, what binds.


def build_limit_sections(found: PlanResult, limits: Limits) -> Iterator[Section]:
    """Yield tensions, distances between bars where there are any, stability, and what binds."""
    yield _tensions(found, limits)
    if found.bar_distance.shape[1]:
        yield _clearance(found, limits)
    yield _stiffness(found, limits)
    yield _binding(found)


def _tensions(found: PlanResult, limits: Limits) -> Section:
    cables = np.flatnonzero(found.is_cable)
    names = [name for name in _binding_members(found) if found.is_cable[found.member_name.index(name)]]
    series = []
    if len(cables):
        series = [
            _line(found, "least of the cables", found.member_tension[:, cables].min(axis=1), 0),
            _line(found, "largest of the cables", found.member_tension[:, cables].max(axis=1), 1),
        ]
    for name in names[: MOST_LINES - len(series)]:
        series.append(
            _line(found, name, found.member_tension[:, found.member_name.index(name)], len(series), "dashed")
        )
    bounds = (("least", limits.least_tension), ("largest", limits.most_tension))
    marks = [
        (value, f"limit: {word} tension {format_short(value)} N")
        for word, values in bounds
        for value in np.unique(values[cables][np.isfinite(values[cables])])[:3].tolist()
    ]
    diagram = Diagram(PROGRESS, "tension [N]", series, horizontal=tuple(marks), legend_columns=2)
    text = describe_extremes(found)[0] if len(cables) else "no cables"
    caption = "Tensions of the cables, with their limits; dashed: cables that limit a step."
    return Section(
        "tensions", "limits", "Tensions", "plain", text, (joined_figure("tension", diagram, caption, text),)
    )


def _clearance(found: PlanResult, limits: Limits) -> Section:
    nearest = np.argsort(found.bar_distance.min(axis=0), kind="stable")[:MOST_LINES]
    series = [
        _line(found, found.bar_pair_name[k], 1000 * found.bar_distance[:, k], n)
        for n, k in enumerate(sorted(nearest.tolist()))
    ]
    bound = 1000 * limits.clearance
    marks = ((bound, f"limit: clearance {format_short(bound)} mm"),) if math.isfinite(bound) else ()
    diagram = Diagram(PROGRESS, "distance between bars [mm]", series, horizontal=marks, legend_columns=2)
    text = f"least distance {format_short(1000 * float(found.bar_distance.min()))} mm"
    caption = "Distances between the surfaces of the nearest bars."
    return Section(
        "clearance", "limits", "Clearance", "plain", text, (joined_figure("clear", diagram, caption, text),)
    )


def _stiffness(found: PlanResult, limits: Limits) -> Section:
    bound = limits.least_stiffness
    marks = ((bound, f"limit {format_short(bound)} N/m"),) if math.isfinite(bound) else ()
    series = [_line(found, "", found.smallest_eigenvalue, 0)]
    diagram = Diagram(PROGRESS, "smallest eigenvalue [N/m]", series, horizontal=marks)
    text = f"stable: smallest eigenvalue {format_short(float(found.smallest_eigenvalue.min()))} N/m"
    caption = "Smallest eigenvalue of the tangent stiffness without rigid motions: positive where stable."
    return Section(
        "stiffness", "limits", "Stability", "plain", text, (joined_figure("stiff", diagram, caption, text),)
    )


def _binding(found: PlanResult) -> Section:
    columns = (Column("progress", "%"), Column("limit", numeric=False), Column("of", numeric=False))
    rows = []
    for step, items in enumerate(found.binding):
        for limit, names in _group(items).items():
            value = number_cell(100 * float(found.progress[step]), ".2f")
            rows.append((value, text_cell(LIMIT_WORDS[limit]), text_cell(names)))
    blocks: list[Block] = []
    text = "no limit binds along the path"
    if rows:
        text = f"limits bind in {sum(1 for items in found.binding if items)} of {found.n_steps} steps"
        blocks.append(Table("Limits that bind in the step to a point", columns, tuple(rows)))
    if found.block is not None:
        gained = tuple(
            (
                text_cell(LIMIT_WORDS[item.limit]),
                text_cell(item.name),
                text_cell(f"{item.bound:.6g} {item.unit}"),
                number_cell(100 * item.multiplier, ".4g"),
            )
            for item in found.block.binding
        )
        heads = (
            Column("limit", numeric=False),
            Column("of", numeric=False),
            Column("value"),
            Column("progress for a unit", "% per N, m or N/m"),
        )
        text = f"blocked at {format_short(100 * found.block.progress)} % of the way"
        blocks.append(Table("Where the path is blocked", heads, gained))
    return Section(
        "binding",
        "limits",
        "What binds",
        "plain",
        text,
        tuple(blocks) or (Paragraph(as_sentence(text)),),
    )


def _line(found: PlanResult, name: str, values: FloatArray, color: int, style: str = "line") -> Series:
    return Series(name, 100 * found.progress, values, "dashed" if style == "dashed" else "line", color)


def _binding_members(found: PlanResult) -> list[str]:
    """Return the members whose tensions limit steps, those of the end first."""
    kinds = ("least_tension", "most_tension", "yield", "buckling")
    items = [item for step in reversed(found.binding) for item in step]
    items = [*(found.block.binding if found.block else ()), *items]
    return list(dict.fromkeys(item.name for item in items if item.limit in kinds))


def _group(items: tuple[Binding, ...]) -> dict[str, str]:
    names: dict[str, list[str]] = {}
    for item in items:
        names.setdefault(item.limit, []).append(item.name)
    return {limit: ", ".join(name for name in of if name) for limit, of in names.items()}
