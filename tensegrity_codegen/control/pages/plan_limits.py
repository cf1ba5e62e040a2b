"""Sections of the page of a plan about its limits: tensions, clearance, stability, what binds."""

import math
from collections.abc import Iterator

import numpy as np

from tensegrity_codegen.control.pages.plans import describe_extremes
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.joined_series import joined_figure
from tensegrity_codegen.report.pages.page import Block, Paragraph, Section
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.runtime.records.plan_result import LIMIT_WORDS, Binding, PlanResult
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.system.arrays import FloatArray

MOST_LINES = 6  # in a diagram
PROGRESS = "progress [%]"


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
        tuple(blocks) or (Paragraph(f"{text[:1].upper()}{text[1:]}."),),
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
