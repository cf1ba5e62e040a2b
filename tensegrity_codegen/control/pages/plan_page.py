"""A plan as a page: outcome, shapes along the path, targets, rest lengths, tensions, the limits that bind."""

import math
from collections.abc import Iterator

import numpy as np

from tensegrity_codegen.control.pages.plans import describe_extremes, describe_plan_finding
from tensegrity_codegen.report.analysis_page import tabulate_elongation
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Figure,
    Page,
    Paragraph,
    Remark,
    Section,
    as_sentence,
    choose_looks,
    command_section,
    joined_figure,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, find_largest, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import draw_motion, draw_picture, draw_tensions
from tensegrity_codegen.report.pictures.draw import pad_tension
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.records.plan_result import LIMIT_WORDS, Binding, PlanResult
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import name_list
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION

N_SHAPES = 4  # pictures of the path
MAX_LINES = 6  # in a diagram
MAX_LETTERS = 24  # of a name in a legend of two columns
SIGNS = "Tensions are positive, compressions negative."
PROGRESS = "progress [%]"


def build_plan_page(plan: PlanResult, structure: Structure, limits: Limits, command: str = "") -> Page:
    """Return the page of a plan."""
    sections = (
        *([_shapes(plan, structure)] if plan.n_steps else []),
        _targets(plan),
        *_proof(plan, structure),
        *([_rest_lengths(plan), *build_limit_sections(plan, limits)] if plan.n_steps else []),
        *([command_section(command)] if command else []),
    )
    counts = (
        f"{describe_count(len(plan.node_name), 'node')}, "
        f"{describe_count(len(plan.member_name), 'member')}, "
        f"{describe_count(len(plan.actuator_name), 'actuator')}"
    )
    return Page(
        subject=f"Plan of {structure.name}",
        title=describe_plan_finding(plan, limits),
        lead=f"{as_sentence(plan.message)} {SIGNS}",
        chapters=(Chapter("plan", structure.name, "", f"{counts}.", sections),),
        facts=(f"tensegrity_codegen {VERSION}.", "Equations, signs and statuses: docs/planning.md."),
    )


def _shapes(plan: PlanResult, structure: Structure) -> Section:
    """Return the shape at the end, which stands beside the heading, and some before it, equally spaced."""
    fractions = plan.progress[-1] * np.linspace(0.0, 1.0, N_SHAPES)
    nearest = np.abs(plan.progress[:, None] - fractions).argmin(axis=0)
    rows = [plan.n_steps, *np.unique(nearest[nearest < plan.n_steps]).tolist()]
    drawn = pad_tension(plan.member_tension, structure)
    among = (plan.node_position[rows], drawn[rows])
    figures = []
    for row in rows:
        caption = f"Progress {format_short(100 * plan.progress[row])} %: {_name_targets(plan, row)}."
        shadow = None
        if row == plan.n_steps:
            caption, shadow = f"{caption[:-1]}; dotted: the start.", plan.node_position[0]
        picture = draw_tensions(
            structure, plan.node_position[row], drawn[row], "member tension [N]", among=among, shadow=shadow
        )
        data = {"node_position": plan.node_position[row].tolist()}
        figures.append(Figure(draw_picture(picture, f"shape{row}"), caption, caption, data))
    return Section("shapes", "", "Shapes along the path", "plain", "", tuple(figures))


def _name_targets(plan: PlanResult, row: int) -> str:
    shown = [
        f"{name} {format_short(float(value), 4)} {unit}".strip()
        for name, value, unit in zip(plan.target_name, plan.target[row], plan.target_unit, strict=True)
    ]
    return name_list(shown, 3)


def _targets(plan: PlanResult) -> Section:
    has_path = len(plan.target) > 0
    rows = tuple(
        (
            text_cell(name),
            *(number_cell(float(plan.target[row, k]) if has_path else None, ".6g") for row in (0, -1)),
            number_cell(float(plan.goal[k]), ".6g"),
            text_cell(plan.target_unit[k]),
        )
        for k, name in enumerate(plan.target_name)
    )
    heads = (Column("target", numeric=False), Column("start"), Column("reached"), Column("goal"))
    blocks: list[Block] = [Remark("differs", as_sentence(sentence)) for sentence in plan.warnings]
    blocks.append(Table("Values of the targets", (*heads, Column("unit", numeric=False)), rows))
    for unit in dict.fromkeys(plan.target_unit) if plan.n_steps else ():
        chosen = [k for k, target_unit in enumerate(plan.target_unit) if target_unit == unit][:MAX_LINES]
        series = [
            Series(plan.target_name[k], 100 * plan.progress, plan.target[:, k], color=n)
            for n, k in enumerate(chosen)
        ]
        goals = dict.fromkeys(float(plan.goal[k]) for k in chosen)
        marks = tuple((goal, f"goal {format_short(goal, 4)} {unit}".rstrip()) for goal in goals)
        label = f"target [{unit}]" if unit else "target [SI]"
        diagram = Diagram(PROGRESS, label, series, horizontal=marks, legend_columns=2)
        caption = "Values of the targets along the path."
        blocks.append(joined_figure(f"targets{len(blocks)}", diagram, caption, caption))
    return Section("targets", "", "Targets", "plain", "", tuple(blocks))


def _rest_lengths(plan: PlanResult) -> Section:
    moved = plan.change - plan.change[0]
    order = np.argsort(-np.abs(moved).max(axis=0), kind="stable")[:MAX_LINES]
    looks = choose_looks(plan.actuator_name[k] for k in sorted(order))
    series = [
        Series(name, 100 * plan.progress, 1000 * moved[:, plan.actuator_name.index(name)], style, color)
        for name, (color, style) in looks.items()
    ]
    few = "" if len(plan.actuator_name) <= MAX_LINES else f" of the {MAX_LINES} that move most"
    caption = f"Changes of rest lengths of the actuators{few}."
    diagram = Diagram(PROGRESS, "change of rest length [mm]", series)
    # The table of all actuators.
    rows = tuple(
        (
            text_cell(name),
            number_cell(float(plan.rest_length[0, k]), ".6f"),
            number_cell(float(plan.rest_length[-1, k]), ".6f"),
            number_cell(1000 * float(moved[-1, k]), "+.3f"),
        )
        for k, name in enumerate(plan.actuator_name)
    )
    columns = (
        Column("actuator", numeric=False),
        Column("start", "m"),
        Column("end", "m"),
        Column("change", "mm"),
    )
    summary = f"largest change {format_short(1000 * float(np.abs(moved).max()))} mm"
    head = find_largest(np.abs(moved[-1]))
    table = Table("Rest lengths", columns, rows, head=head, head_note="those that change most")
    blocks = (joined_figure("rest", diagram, caption, summary), table)
    return Section("rest-lengths", "", "Rest lengths", "plain", summary, blocks)


def _proof(plan: PlanResult, structure: Structure) -> Iterator[Section]:
    proof = plan.certificate
    if not isinstance(proof, Certificate):
        return
    summary = f"{len(proof.shortening)} cables shorten, no cable lengthens, no bar changes its length"
    why = Paragraph(
        "Tensions t that balance loads f satisfy t . e = f . d in all displacements d, where e = A^T d are "
        "the changes of length. In these displacements f . d is zero or positive, and t . e zero or negative "
        "as no cable is in compression. One of them is not zero where the cables that must be in tension "
        "are: so there are no such tensions at this shape."
    )
    blocks: list[Block] = [why]
    if plan.proof_position is not None and plan.proof_displacement is not None:
        picture = draw_motion(structure, plan.proof_position, plan.proof_displacement)
        data = {"displacement": plan.proof_displacement.tolist()}
        blocks.append(
            Figure(draw_picture(picture, "proof"), f"The motion, enlarged: {summary}.", summary, data)
        )
    blocks.append(tabulate_elongation(proof, plan.member_name, "+.9f"))
    yield Section("proof", "", "Why there is no plan", "plain", summary, tuple(blocks))


# Sections of the page of a plan about its limits: tensions, clearance, stability, what binds.


def build_limit_sections(plan: PlanResult, limits: Limits) -> Iterator[Section]:
    """Yield tensions, distances between bars if there are any, stability, and what binds."""
    yield _tensions(plan, limits)
    if plan.bar_distance.shape[1]:
        yield _clearance(plan, limits)
    yield _stiffness(plan, limits)
    yield _binding(plan)


def _tensions(plan: PlanResult, limits: Limits) -> Section:
    cables = np.flatnonzero(plan.is_cable)
    names = [name for name in _binding_members(plan) if plan.is_cable[plan.member_name.index(name)]]
    series = []
    if len(cables):
        series = [
            _line(plan, "least of the cables", plan.member_tension[:, cables].min(axis=1), 0),
            _line(plan, "largest of the cables", plan.member_tension[:, cables].max(axis=1), 1),
        ]
    for name in names[: MAX_LINES - len(series)]:
        series.append(
            _line(plan, name, plan.member_tension[:, plan.member_name.index(name)], len(series), "dashed")
        )
    bounds = (("least", limits.least_tension), ("largest", limits.most_tension))
    marks = [
        (value, f"limit: {bound} tension {format_short(value)} N")
        for bound, values in bounds
        for value in np.unique(values[cables][np.isfinite(values[cables])])[:3].tolist()
    ]
    diagram = Diagram(PROGRESS, "tension [N]", series, horizontal=tuple(marks), legend_columns=2)
    summary = describe_extremes(plan)[0] if len(cables) else "no cables"
    dashed = any(line.style == "dashed" for line in series)
    caption = f"Tensions of the cables, with their limits{'; dashed: cables that limit a step' * dashed}."
    figure = joined_figure("tension", diagram, caption, summary)
    return Section("tensions", "", "Tensions", "plain", summary, (figure,))


def _clearance(plan: PlanResult, limits: Limits) -> Section:
    nearest = np.argsort(plan.bar_distance.min(axis=0), kind="stable")[:MAX_LINES]
    series = [
        _line(plan, plan.bar_pair_name[k], 1000 * plan.bar_distance[:, k], n)
        for n, k in enumerate(sorted(nearest.tolist()))
    ]
    bound = 1000 * limits.clearance
    marks = ((bound, f"limit: clearance {format_short(bound)} mm"),) if math.isfinite(bound) else ()
    longest = max(map(len, plan.bar_pair_name))
    columns = 2 if longest <= MAX_LETTERS else 1
    diagram = Diagram(
        PROGRESS, "distance between bars [mm]", series, horizontal=marks, legend_columns=columns
    )
    summary = f"least distance {format_short(1000 * float(plan.bar_distance.min()))} mm"
    caption = "Distances between the surfaces of the nearest bars."
    figure = joined_figure("clear", diagram, caption, summary)
    return Section("clearance", "", "Clearance", "plain", summary, (figure,))


def _stiffness(plan: PlanResult, limits: Limits) -> Section:
    bound = limits.least_stiffness
    marks = ((bound, f"limit {format_short(bound)} N/m"),) if math.isfinite(bound) else ()
    series = [_line(plan, "", plan.smallest_eigenvalue, 0)]
    diagram = Diagram(PROGRESS, "smallest eigenvalue [N/m]", series, horizontal=marks)
    summary = f"stable: smallest eigenvalue {format_short(float(plan.smallest_eigenvalue.min()))} N/m"
    caption = "Smallest eigenvalue of the tangent stiffness without rigid motions: positive where stable."
    figure = joined_figure("stiff", diagram, caption, summary)
    return Section("stiffness", "", "Stability", "plain", summary, (figure,))


def _binding(plan: PlanResult) -> Section:
    columns = (Column("progress", "%"), Column("limit", numeric=False), Column("of", numeric=False))
    rows = []
    for step, bindings in enumerate(plan.binding):
        for limit, names in _group(bindings).items():
            value = number_cell(100 * float(plan.progress[step]), ".2f")
            rows.append((value, text_cell(LIMIT_WORDS[limit]), text_cell(names)))
    blocks: list[Block] = []
    summary = "no limit binds along the path"
    if rows:
        summary = f"limits bind in {sum(1 for bindings in plan.binding if bindings)} of {plan.n_steps} steps"
        blocks.append(Table("Limits that bind in the step to a point", columns, tuple(rows)))
    # The limits at the end of a blocked path.
    if plan.block is not None:
        gained = tuple(
            (
                text_cell(LIMIT_WORDS[binding.limit]),
                text_cell(binding.name),
                text_cell(f"{binding.bound:.6g} {binding.unit}"),
                number_cell(100 * binding.multiplier, ".4g"),
            )
            for binding in plan.block.binding
        )
        heads = (
            Column("limit", numeric=False),
            Column("of", numeric=False),
            Column("value"),
            Column("progress for a unit", "% per N, m or N/m"),
        )
        summary = f"blocked at {format_short(100 * plan.block.progress)} % of the way"
        note = "First what gains most where it is eased by one per cent of the limit."
        blocks.append(Table("Where the path is blocked", heads, gained, note))
    return Section("binding", "", "What binds", "plain", summary, tuple(blocks))


def _line(plan: PlanResult, name: str, values: FloatArray, color: int, style: str = "line") -> Series:
    return Series(name, 100 * plan.progress, values, "dashed" if style == "dashed" else "line", color)


def _binding_members(plan: PlanResult) -> list[str]:
    """Return the members whose tensions limit steps, those of the end first."""
    kinds = ("least_tension", "most_tension", "yield", "buckling")
    bindings = [binding for step in reversed(plan.binding) for binding in step]
    bindings = [*(plan.block.binding if plan.block else ()), *bindings]
    return list(dict.fromkeys(binding.name for binding in bindings if binding.limit in kinds))


def _group(bindings: tuple[Binding, ...]) -> dict[str, str]:
    names: dict[str, list[str]] = {}
    for binding in bindings:
        names.setdefault(binding.limit, []).append(binding.name)
    return {limit: ", ".join(name for name in of if name) for limit, of in names.items()}
